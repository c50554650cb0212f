"""The event-driven engine: robots are looked at only when something can happen to them."""
