"""Studies: many runs of scenarios that differ in some fields; planning, running, storing and reporting them."""
