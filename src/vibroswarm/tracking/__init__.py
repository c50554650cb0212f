"""Videos of an overhead camera: rendered from a result, and tracked into a recording."""
