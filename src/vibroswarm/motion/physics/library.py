"""MuJoCo: loaded when first needed, and its functions as addresses that kernels call.

Kernels get the functions as arguments (ctypes function pointers), since compiled code that holds their addresses as
constants cannot be cached on disk. Pointers are passed as integers.
"""

from __future__ import annotations

import ctypes
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, NamedTuple

from vibroswarm.errors import InputError

MAJOR: Final = "4"
"""Major version of MuJoCo whose functions these are."""

ADDRESS: Final = ctypes.c_ssize_t
NUMBER: Final = ctypes.c_int
SIGNATURES: Final = {
    "mj_step": (None, ADDRESS, ADDRESS),
    "mj_kinematics": (None, ADDRESS, ADDRESS),
    "mj_ray": (ctypes.c_double, *5 * (ADDRESS,), NUMBER, NUMBER, ADDRESS, ADDRESS),
}
"""Result and arguments. ``mj_ray``: model, data, point, direction, groups of geoms, static geoms too, body left out,
geom hit, normal there."""


class Calls(NamedTuple):
    """MuJoCo's functions as kernels call them."""

    step: Any
    kinematics: Any
    ray: Any


@cache
def mujoco() -> Any:
    """Return the module ``mujoco``.

    Raises:
        InputError: it is not installed, or of a version whose functions may be others.
    """
    try:
        import mujoco as module
    except ImportError:
        raise InputError(
            "needs MuJoCo, which is not installed: pip install 'vibroswarm[physics]'", field="motion"
        ) from None
    found = version("mujoco")
    if found.partition(".")[0] != MAJOR:
        raise InputError(
            f"needs MuJoCo {MAJOR}, and {found} is installed: pip install 'vibroswarm[physics]'",
            field="motion",
        )
    if module.get_mju_user_warning() is None:  # else MuJoCo writes a file into the working directory
        module.set_mju_user_warning(lambda message: None)
    return module


@cache
def calls() -> Calls:
    """Return MuJoCo's functions.

    Raises:
        InputError: MuJoCo is not installed, or its library is not where it should be.
    """
    folder = Path(mujoco().__file__).parent
    files = sorted(folder.glob("*mujoco*.so*")) + sorted(folder.glob("*mujoco*.d*l*"))
    for file in files:
        library = ctypes.CDLL(str(file))
        if hasattr(library, "mj_step"):
            # MuJoCo's module for Python reads the clock for MuJoCo's timers, in a tenth of the time of a step.
            ctypes.c_void_p.in_dll(library, "mjcb_time").value = None
            return Calls(*(_function(library, name) for name in SIGNATURES))
    raise InputError(f"there is no library of MuJoCo in '{folder}'; install it again", field="motion")


def _function(library: ctypes.CDLL, name: str) -> Any:
    function = getattr(library, name)
    function.restype, *function.argtypes = SIGNATURES[name]
    return function
