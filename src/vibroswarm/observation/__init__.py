"""Readings: a value and a class for every row of a motion table."""
