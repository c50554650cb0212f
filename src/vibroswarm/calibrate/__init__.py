"""Calibration: compare recordings with simulations, and fit scenarios to recordings."""
