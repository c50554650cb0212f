"""vibroswarm."""
