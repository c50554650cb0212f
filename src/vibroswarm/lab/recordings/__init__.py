"""Recordings of robots: read into the tables of a simulation, replayed and measured."""
