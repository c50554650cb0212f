"""Odometry, and where each robot believes it was, for every row of a motion table."""
