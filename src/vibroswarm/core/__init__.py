"""Foundations: compiled kernels, addressed random numbers, files, table schemas."""
