"""The protocol of tasks: a question about a floor, its answers by name, and the true one.

A task is one file: parameters, and one plain function, called once for each floor.

    class Params:                             # [task.NAME] of a scenario, one field per line, with bounds
        least: Annotated[int, Field(ge=1)] = 4

    def truth(floor, asked, p): ...           # 1: yes, 0: no, None: no decision is right

``floor`` is a ``Floor``, ``asked`` an ``Asked``, ``p`` the Params. ``floor.tiles`` are kinds such as 0 and 1, (rows,
columns), top row first; ``floor.share_within(kind, asked.width_m, asked.height_m)`` is a kind's share. The robots'
strategies do not see the task: they decide by their own rule, and the task says which decision is right. A question
with other answers than no and yes names them: the decision is an index into ``answers``, which may be a function of the
number of kinds.

A task may ask for a number instead, such as a share: ``estimated`` says which, ``truth`` returns it, and what counts is
how near the robots' estimates are (``statistics.figures``, ``estimate_error`` and others). No decision is then right.

A task may be asked anew after each answer of a robot (``asked_anew``). What is right then depends on the robot:
``asked.start`` is the floor at its last answer 1, and a run has no right decision
(``statistics.over_time`` judges each answer).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from pydantic import BaseModel

from vibroswarm.core.registry import Registry
from vibroswarm.core.user_code import errors_in
from vibroswarm.errors import CodeError, shown
from vibroswarm.floors.floor import Floor
from vibroswarm.strategies.base import Plugin
from vibroswarm.strategies.static_analysis import refuse_chance


class Asked(NamedTuple):
    """What a task may need beside the floor; lengths in m."""

    width_m: float
    """Width of the arena."""
    height_m: float
    """Height of the arena."""
    fill_ratio: float
    """Share of the tiled area inside the arena that vibrates (``Floor.fill_ratio_within``)."""
    decision_boundary: float
    """``decision.decision_boundary`` of the scenario: strategies decide whether the fill ratio is above it."""
    kinds: int = 2
    """Number of kinds of tile."""
    start: Floor | None = None
    """The floor at time 0, or at the robot's last answer 1 if the task is asked anew; the floor itself, unless it has
    changed since."""


@dataclass(frozen=True, kw_only=True)
class Task(Plugin):
    """A task, see the module's docstring.

    Args:
        truth: the function ``truth`` of the module's docstring. about: the question, for messages and lists. answers:
            what the decisions 0, 1 and so on mean, or a function of the number of kinds that returns this;
            ``{boundary}`` is replaced by the decision boundary in percent. estimated: the number that is asked for, in
            words, such as "share of tiles that vibrate", or a function of the parameters that returns it; empty: the
            task asks for a decision. check: optional, a function like ``truth`` that raises an ``InputError`` if the
            question makes no sense on a floor. asked_anew: a function of the parameters, whether each robot is asked
            anew once its decision becomes 1. presumed: the answer that is right at time 0 on every floor; an undecided
            robot counts as giving it; None: there is no such answer. Another first answer is a false change
            (``statistics.over_time``). scored: optional, a function like ``truth`` that returns the number by
            which the estimates of robots are scored that decide as well; without it that is the fill ratio.
    """

    truth: Callable[[Floor, Asked, Any], Any]
    answers: tuple[str, ...] | Callable[[int], tuple[str, ...]] = ("no", "yes")
    estimated: str | Callable[[Any], str] = ""
    check: Callable[[Floor, Asked, Any], None] | None = None
    asked_anew: Callable[[Any], bool] | None = None
    presumed: int | None = None
    scored: Callable[[Floor, Asked, Any], Any] | None = None

    def __post_init__(self) -> None:
        """Check the name (``Plugin``), and that no function draws random numbers."""
        super().__post_init__()
        refuse_chance(vars(self).values(), "the truth follows from the floor")

    def answers_of(self, kinds: int) -> tuple[str, ...]:
        """Return the meaning of each decision, with this number of kinds of tile."""
        return self.answers(kinds) if callable(self.answers) else self.answers

    def answer(self, floor: Floor, asked: Asked, params: BaseModel) -> int | None:
        """Return the right decision on a floor, an index into the answers, or None if no decision is right.

        None is right for all robots of a run if a number is asked for, or if each robot is asked anew.

        Args:
            asked: what the task may need beside the floor. params: the task's parameters.
        Raises:
            CodeError: ``truth`` returned something other than such an index or None; or it raised an error, and the
                task was loaded from a user's file (``Plugin.code``). The message names the line.
            Exception: an error of any other task's ``truth``, unchanged.
        """
        return None if self.lacks_truth(params) else self.answer_of_robot(floor, asked, params)

    def is_asked_anew(self, params: BaseModel) -> bool:
        """Return whether what is right for a robot depends on its own last answer."""
        return self.asked_anew is not None and bool(self.asked_anew(params))

    def lacks_truth(self, params: BaseModel) -> bool:
        """Return whether no decision is right for all robots of a run, on any floor."""
        return bool(self.estimated) or self.is_asked_anew(params)

    def answer_of_robot(self, floor: Floor, asked: Asked, params: BaseModel) -> int | None:
        """Return the right decision of one robot, which was last asked on ``asked.start``; else as ``answer``."""
        count = len(self.answers_of(asked.kinds))
        with errors_in(self.code):
            answer = self.truth(floor, asked, params)
        if answer is not None and not (
            isinstance(answer, int | np.integer | np.bool_) and 0 <= answer < count
        ):
            raise CodeError(f"task '{self.name}': returned {shown(answer)}; return 0 to {count - 1} or None")
        return None if answer is None else int(answer)

    def number(self, floor: Floor, asked: Asked, params: BaseModel) -> float:
        """Return the number against which estimates are scored; arguments and errors are those of ``answer``."""
        with errors_in(self.code):
            return float((self.scored or self.truth)(floor, asked, params))


_registry = Registry[Task]("task", "task.name")
register, forget, names, known, task = (
    _registry.register,
    _registry.forget,
    _registry.names,
    _registry.known,
    _registry.get,
)
