"""Scenarios: their fields, their files, and the users' code that they name."""
