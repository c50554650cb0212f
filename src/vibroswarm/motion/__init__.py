"""Where and when robots sampled: one protocol, several sources."""
