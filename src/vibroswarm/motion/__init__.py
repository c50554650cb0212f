"""Where and when robots sampled: one contract, many sources."""
