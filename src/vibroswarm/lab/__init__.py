"""The laboratory: recordings of robots, videos of them, and scenarios fitted to them."""
