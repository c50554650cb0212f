"""The paper computed anew: its figures and tables, and a verdict on each of its claims."""
