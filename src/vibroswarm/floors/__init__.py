"""Floors: patterns, files, difficulty, and floors designed to a given difficulty; names are imported on first use."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
