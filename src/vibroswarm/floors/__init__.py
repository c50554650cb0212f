"""Floors: patterns, files, difficulty, and floors designed to a given difficulty.

Names are imported on first use, so that importing this package loads neither Pillow nor SciPy.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
