"""Reproduction of the paper: its figures and tables, and a verdict on each of its claims."""
