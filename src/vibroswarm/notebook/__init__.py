"""What notebooks show of public objects."""
