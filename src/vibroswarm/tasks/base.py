"""What a task is: a question about a floor to which the answer is yes (1) or no (0), and what is true.

A task is one file: parameters, and one plain function, called once for each floor.

    class Params:                             # [task.NAME] of a scenario, one field a line, with bounds
        least: Annotated[int, Field(ge=1)] = 4

    def truth(floor, asked, p): ...           # 1: yes, 0: no, None: neither decision is right

``floor`` is a ``Floor`` (``floor.tiles``: (rows, columns) of 0 and 1, top row first), ``asked`` an ``Asked``, ``p`` the
Params. The robots' strategies do not see the task: they decide 0 or 1 by their own rule, and this says which is right.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from pydantic import BaseModel

from vibroswarm.errors import CodeError, InputError, shown
from vibroswarm.floors.floor import Floor
from vibroswarm.registry import Registry
from vibroswarm.strategies.base import NAME, NoParams, as_params
from vibroswarm.strategies.written import where


class Asked(NamedTuple):
    """What a task may need beside the floor: the arena, m; the share of its tiles that vibrate; the boundary."""

    width_m: float
    height_m: float
    fill_ratio: float
    decision_boundary: float


@dataclass(frozen=True)
class Task:
    """A task, see the head of this module.

    Args:
        name: as scenarios call it. truth: the function. params: class of annotated fields. about: the question.
        answers: what the decisions 0 and 1 say; ``{boundary}`` stands for the decision boundary in percent.
    """

    name: str
    truth: Callable[[Floor, Asked, Any], int | None]
    params: type = NoParams
    about: str = ""
    answers: tuple[str, str] = ("no", "yes")
    source: str = field(default="", compare=False)
    """The text of the file it comes from, where that is not of this package."""
    code: str = field(default="", compare=False)
    """That file's name, this one's name in it, and its hash."""

    def __post_init__(self) -> None:
        if not NAME.fullmatch(self.name):
            raise InputError(
                f"{shown(self.name)} is no name; small letters, digits and underscores", field="name"
            )
        if not callable(self.truth):
            raise InputError("has no function truth(floor, asked, p)", field=f"task '{self.name}'")
        object.__setattr__(self, "params", as_params(self.params, self.name))

    def answer(self, floor: Floor, asked: Asked, params: BaseModel) -> int | None:
        """The right decision on a floor: 1, 0, or None where neither is.

        Raises:
            CodeError: the function raised, or gave something else.
        """
        try:
            found = self.truth(floor, asked, params)
        except Exception as error:  # whatever a function of the user's raises
            if not self.code:
                raise
            file = self.truth.__code__.co_filename
            lines = [one.lineno for one in traceback.extract_tb(error.__traceback__) if one.filename == file]
            raise CodeError(f"{where(self.truth, lines[-1])}: {type(error).__name__}: {error}") from None
        if found is not None and not (
            isinstance(found, int | np.integer | np.bool_) and int(found) in (0, 1)
        ):
            raise CodeError(f"{where(self.truth)}: gives {shown(found)}; 0, 1 or None")
        return None if found is None else int(found)


_registry = Registry[Task]("task", "task.name")
register, forget, names, known, task = (
    _registry.register,
    _registry.forget,
    _registry.names,
    _registry.known,
    _registry.get,
)
