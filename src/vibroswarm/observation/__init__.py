"""Readings: an energy and a bit for every row of a motion table."""
