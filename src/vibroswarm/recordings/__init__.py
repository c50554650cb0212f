"""Recordings of robots: read into the tables of a simulation, and the threshold of their bits."""
