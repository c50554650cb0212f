"""Searching for good parameters: spaces, objectives, methods that ask and are told, and what is true afterwards."""
