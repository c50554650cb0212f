"""Loading a module only when it is used.

SciPy's special functions name all that NumPy offers, and so load ``numpy.f2py``, a compiler of Fortran: a tenth of the
time of a short command.
"""

from __future__ import annotations

import sys
from importlib.util import LazyLoader, find_spec, module_from_spec


def put_off(package: str, name: str) -> None:
    """Load a module of a package only when it is used; the package itself is imported now."""
    full_name = f"{package}.{name}"
    if full_name in sys.modules:
        return
    spec = find_spec(full_name)
    if spec is None or spec.loader is None:
        return
    spec.loader = LazyLoader(spec.loader)
    module = module_from_spec(spec)
    sys.modules[full_name] = module
    setattr(sys.modules[package], name, module)  # as an import does
    spec.loader.exec_module(module)
