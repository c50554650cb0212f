"""The program of a scenario's robots as plain Python: ``robot_program`` with the scenario's parts in its open names.

Nothing is translated or compiled: functions keep their code, and only the global names that they read are bound anew.
"""

from __future__ import annotations

import builtins
import math
import types
from typing import Any

import numpy as np

from vibroswarm.core.rng import uniform
from vibroswarm.export import robot_program
from vibroswarm.export.assembly import RobotParts
from vibroswarm.export.c_program import structs_of
from vibroswarm.export.c_types import BOOL, CArray, Struct
from vibroswarm.export.source import is_function, plain


def plain_program(parts: RobotParts, mathematics: Any = math) -> types.ModuleType:
    """Return the program; its ``Robot()`` and ``Message()`` make rows of zeros.

    Args:
        mathematics: what its functions call in place of ``math``.
    """
    structs, bound = structs_of(parts), dict[Any, Any]()
    module = types.ModuleType("plain_program")
    space = vars(module)

    def bind(value: Any) -> Any:
        if value is math:
            return mathematics
        if not is_function(value) or value is uniform:
            return value
        function = plain(parts.replaced.get(plain(value), value))
        if function not in bound:
            read, code = function.__globals__, function.__code__
            is_template = read is vars(robot_program)
            names = space if is_template else {"__builtins__": builtins}
            bound[function] = types.FunctionType(code, names, function.__name__, None, function.__closure__)
            if not is_template:
                names.update({name: bind(read[name]) for name in code.co_names if name in read})
        return bound[function]

    names = {name: value for name, value in vars(robot_program).items() if not name.startswith("__")} | {
        **parts.hooks,
        "PARAMS": types.SimpleNamespace(**parts.params),
        "WORLD": parts.world,
        "WALKER": parts.walker,
        "SENSING": parts.sensing,
        "BORDERS": parts.borders,
        "SENSOR": None if parts.classifier is None else types.SimpleNamespace(**parts.classifier.params),
        "RMS_THRESHOLD": parts.rms_threshold,
        "SENSING_BLIND_MS": parts.blind_ms,
    }
    space.update({name: bind(value) for name, value in names.items()})
    space.update(Message=lambda: zero(structs["Message"]), Robot=lambda: zero(structs["Robot"]))
    return module


class Whole(np.ndarray[Any, Any]):
    """Whole numbers that are computed with as those of C, and cut to the bits of their type when they are stored."""

    def __getitem__(self, index: Any) -> Any:
        element = super().__getitem__(index)
        return np.int64(element) if isinstance(element, np.integer) else element

    def __setitem__(self, index: Any, value: Any) -> None:
        super().__setitem__(index, np.asarray(value).astype(self.dtype))


def zero(kind: Any) -> Any:
    """Return the zero of a type of C: arrays of NumPy, and rows whose fields are attributes."""
    if isinstance(kind, CArray):
        if isinstance(kind.element, Struct):
            return [zero(kind.element) for _ in range(kind.shape[0])]
        if kind.element.endswith("_t"):  # whole numbers of some width, which wrap as in C
            return np.zeros(kind.shape, dtype=kind.element.removesuffix("_t")).view(Whole)
        return np.zeros(kind.shape, dtype=type(zero(kind.element)))
    if isinstance(kind, Struct):
        return types.SimpleNamespace(**{name: zero(field) for name, field in kind.fields})
    return False if kind == BOOL else 0 if kind.startswith(("vs_int", "int", "uint")) else 0.0
