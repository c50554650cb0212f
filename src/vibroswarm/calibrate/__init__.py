"""Calibration: how alike recordings and simulations are, and in what they differ."""
