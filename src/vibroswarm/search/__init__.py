"""Search for good parameters: spaces, objectives, methods, and validation on fresh runs.

The names below are imported when they are first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
