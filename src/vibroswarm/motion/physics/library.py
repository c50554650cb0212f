"""Access to MuJoCo: its module, loaded when first needed, and its C functions for kernels.

Kernels get them as arguments: code that contains their addresses as constants could not be cached on disk.
"""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

from vibroswarm.core.optional_library import needed
from vibroswarm.errors import InputError

ADDRESS: Final = ctypes.c_ssize_t
NUMBER: Final = ctypes.c_int
SIGNATURES: Final = {
    "mj_step": (None, ADDRESS, ADDRESS),
    "mj_kinematics": (None, ADDRESS, ADDRESS),
    "mj_ray": (ctypes.c_double, *5 * (ADDRESS,), NUMBER, NUMBER, ADDRESS, ADDRESS),
}
"""Types of the result (None: no result) and of the arguments. The arguments of ``mj_step`` and ``mj_kinematics`` are
model and data; those of ``mj_ray`` are model, data, start, direction, groups of geoms to be seen, whether static geoms
are seen, a body to be left out, and where to write the number and the normal of the geom that is hit."""


class Calls(NamedTuple):
    """MuJoCo's functions ``mj_step``, ``mj_kinematics`` and ``mj_ray`` for kernels, in the order of ``SIGNATURES``."""

    step: Any
    kinematics: Any
    ray: Any


@cache
def mujoco() -> Any:
    """Return the module ``mujoco``, with its warnings turned off: runs read and report them themselves."""
    module = needed("mujoco", "physics", "motion")
    # Without a handler of warnings, MuJoCo writes them into a file in the working directory. One that the user has set
    # is left.
    if module.get_mju_user_warning() is None:
        module.set_mju_user_warning(lambda message: None)
    return module


@cache
def calls() -> Calls:
    """Load MuJoCo's shared library; return its functions for kernels."""
    folder = Path(mujoco().__file__).parent
    # Libraries of Linux (.so.VERSION), and of macOS and Windows (.dylib, .dll).
    files = sorted(folder.glob("*mujoco*.so*")) + sorted(folder.glob("*mujoco*.d*l*"))
    for file in files:
        library = ctypes.CDLL(str(file))
        if hasattr(library, "mj_step"):  # else it is another library, such as a plugin
            # MuJoCo's Python module installs a clock for timers that are not used here. Reading it takes a tenth of the
            # time of a step, so it is removed.
            ctypes.c_void_p.in_dll(library, "mjcb_time").value = None
            return Calls(*(_function(library, name) for name in SIGNATURES))
    raise InputError(f"there is no library of MuJoCo in '{folder}'; install it again", field="motion")


def _function(library: ctypes.CDLL, name: str) -> Any:
    function = getattr(library, name)
    function.restype, *function.argtypes = SIGNATURES[name]
    return function
