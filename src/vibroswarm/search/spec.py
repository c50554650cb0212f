"""Define a search: space, objectives, method and budget; read and write it as TOML.

    seed = 1
    start = ["paper-empirical"]             # presets, or tables of values; always among the first candidates
    [scenario]
    preset = "paper"
    [space]
    "walk.walk_duration_scale_ms" = { from = 0, to = 20000 }
    [objective]
    cost = "authors_code"
    [search]
    method = "pso"
    [pso]
    particles = 25

All other keys are those of a study; its blocks of varied fields are the cases in which every candidate is evaluated,
such as several floors. The default space is the paper's, with P0, the paper's empirical parameters, as the start.

A search first runs its method. Then, unless it has several objectives, its best candidates (finalists) compete in a
race on further runs (see ``race``). Both are paid from the budget. Last, the winner is scored on fresh runs, in
addition to the budget (see ``validation``).
"""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from types import NoneType
from typing import Any, Final

import numpy as np

from vibroswarm.core.untrusted_files import parsed_toml, read_text
from vibroswarm.errors import (
    InputError,
    check_choice,
    check_kind,
    check_known_keys,
    in_file,
    keep_plain,
    whole_number_of,
)
from vibroswarm.inference.outcomes import truth_on
from vibroswarm.scenario import plugins
from vibroswarm.scenario.presets import preset_names
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.search import methods, optuna_samplers  # noqa: F401  (the second registers methods)
from vibroswarm.search.evaluate import NUMBERS
from vibroswarm.search.objective import Objective, objectives_from
from vibroswarm.search.pso import PsoSettings
from vibroswarm.search.space import PAPER, Point, Space, Values
from vibroswarm.study.cells import Cell
from vibroswarm.study.spec import Study, as_toml, with_fields

KEYS: Final = ("space", "objective", "search", "pso", "start")
"""Keys that a search adds to those of a study."""
START: Final = "paper-empirical"
"""The preset of P0."""
MOST_CASES: Final = 100
"""Largest number of cases of a search."""
FINAL_SHARE: Final = 0.4
"""Share of the budget for the race. It is large since the relative error of a mean + sd of these costs is about
1.5 / sqrt(runs): to distinguish candidates that differ by 10 % takes hundreds of runs of each."""


@dataclass(frozen=True)
class SearchSettings:
    """Settings of a search that all methods share."""

    method: str = "pso"
    """Name of a method, or ``FILE.py:NAME`` (see ``methods``)."""
    evaluations: int = 20
    """Runs per candidate, for methods other than pso, which has its own setting."""
    budget: int | None = None
    """Total runs of the search; pso makes as many iterations as fit. Default: 15,000, those of the paper's 50
    iterations."""
    final: int | None = None
    """Runs of the race of the finalists, part of the budget; with 0 there is no race. With several objectives it must
    be 0. Default: 40 % of the budget, but 0 with several objectives or with the paper's swarm."""
    finalists: int = 12
    """Largest number of finalists."""
    surface: bool = True
    """Whether minima of a response surface are finalists too."""
    numbers: str = "independent"
    """``independent`` runs for each evaluation, or ``common`` runs for all candidates (see ``evaluate``)."""
    fresh: int = 2000
    """Runs on which the winner is validated, in addition to the budget."""

    def __post_init__(self) -> None:
        """Check all settings.

        Raises:
            InputError: naming the setting that is wrong.
        """
        keep_plain(self)
        if plugins.is_code(self.method):  # the dataclass is frozen
            object.__setattr__(self, "method", plugins.resolve_code("method", self.method))
        else:
            methods.method(self.method)  # raises if there is no such method
        check_choice(self.numbers, "search.numbers", NUMBERS)
        if not isinstance(self.surface, bool):
            raise InputError(f"{self.surface!r} is wrong; give true or false", field="search.surface")
        for name, low in (("evaluations", 1), ("budget", 1), ("final", 0), ("finalists", 1), ("fresh", 2)):
            value = getattr(self, name)
            # ``budget`` and ``final`` may be None: ``Search`` computes their defaults from its other parts.
            if value is not None or name not in ("budget", "final"):
                whole_number_of(value, f"search.{name}", low, 10**9)

    @property
    def method_name(self) -> str:
        """The method's name without its file."""
        return plugins.name_in(self.method) if plugins.is_code(self.method) else self.method

    @property
    def takes_several(self) -> bool:
        """Whether the method can minimise several objectives; code that is not loaded is taken to."""
        found = methods.known().get(self.method_name)
        return found is None or found.several


@dataclass(frozen=True)
class Search:
    """The definition of a search, see the head of this module.

    Raises:
        InputError: naming what is wrong, and what would be right.
    """

    study: Study = field(default_factory=Study)
    """The scenario, the cases (its cells), the seed and the source of motion; its number of runs is ignored."""
    space: Space = field(default_factory=lambda: Space.of(PAPER))
    """The fields that are searched over, with their bounds."""
    objectives: tuple[Objective, ...] = (Objective(),)
    """What is minimised: one objective, or several with the method nsga2."""
    settings: SearchSettings = field(default_factory=SearchSettings)
    """Method, budget and other settings that do not depend on the method."""
    pso: PsoSettings = field(default_factory=PsoSettings)
    """Settings of the particle swarm; other methods do not read them, except for the default budget."""
    start: tuple[str | Mapping[str, Any], ...] | None = None
    """Given points to begin with: names of presets, or tables with values of the space's fields. Default: the paper's
    P0 in the paper's space, none in other spaces."""

    def __post_init__(self) -> None:
        """Check that the parts of the search fit together.

        Raises:
            InputError: naming the field that is wrong.
        """
        kinds = {"study": Study, "space": Space, "settings": SearchSettings, "pso": PsoSettings}
        for name, kind in kinds.items():
            check_kind(getattr(self, name), kind, name, f"a {kind.__name__}")
        check_kind(self.objectives, (tuple, list), "objectives", "a tuple of objectives")
        for one in self.objectives:
            check_kind(one, Objective, "objectives", "an Objective")
        if not self.objectives:
            raise InputError("is empty; name a cost", field="objective")
        if len(self.objectives) > 1 and not self.settings.takes_several:
            raise InputError("several objectives need the method nsga2", field="search.method")
        if len(self.objectives) > 1 and self.final_runs:
            raise InputError(
                f"{self.final_runs} is wrong: with several objectives there is no race; give 0, or leave this out",
                field="search.final",
            )
        if len(self.study.cells) > MOST_CASES:
            raise InputError(f"has {len(self.study.cells)} cases; at most {MOST_CASES}", field="study")
        for cell in self.study.cells:
            if both := [name for name in self.space.names if name in cell.point]:
                raise InputError("is searched over, and varied by the cases too", field=both[0])
        for cell in self.study.cells:
            check_scenario(cell.scenario, "floor.source")
        self._check_choices_fit()
        _ = self.starts  # computed only to raise an error if a start is wrong
        if self.settings.method == "pso" and len(self.starts) > self.pso.particles:
            raise InputError(f"{len(self.starts)} starts for {self.pso.particles} particles", field="start")
        # computed only to raise an error if the budget is too small
        _ = self.pso_settings, self.search_budget
        self._check_starts_fit()
        if self.is_as_ran:
            if self.settings.numbers != "independent":
                raise InputError(
                    'noise = "as-ran" numbers its runs itself; leave this out', field="search.numbers"
                )
            if self.final_runs:
                raise InputError('noise = "as-ran" has no race; leave this out', field="search.final")

    def _check_choices_fit(self) -> None:
        """Check the choices of each field: one that fits nowhere, such as a misspelt name, would waste its runs.

        A choice is tried at three points of the other fields, since it may fit only some of their values.

        Raises:
            InputError: a choice is wrong at all of them.
        """
        points = [self.space.values(np.full(self.space.size, u)) for u in (0.0, 0.5, 1.0)]
        for one in self.space:
            for choice in one.choices:
                errors = [self._error_with({**values, one.name: choice}) for values in points]
                # Of a list it is the field of one of its values.
                wrong = [error for error in errors if error and f"{error.field}.".startswith(f"{one.name}.")]
                if len(wrong) == len(points):
                    raise InputError(wrong[0].reason, field=f"space.{one.name}")

    def _error_with(self, values: Values) -> InputError | None:
        """Return why the first case cannot have these values; None if it can."""
        try:
            self.cases[0].scenario.with_values(values)
        except InputError as error:
            return error
        return None

    def _check_starts_fit(self) -> None:
        """Check that methods other than pso have enough runs to evaluate every start.

        Raises:
            InputError: the budget is too small; the message says how large it must be.
        """
        evaluations, starts = self.settings.evaluations, len(self.starts)
        # A method makes at least one point, even if the budget is smaller than its runs (``BatchSampler``).
        if self.settings.method == "pso" or starts <= max(self.search_budget // evaluations, 1):
            return
        needed = starts * evaluations
        words = f"{starts} starts take {needed} runs ({evaluations} each)"
        if self.final_runs:
            words += f", besides the {self.final_runs} of the race"
        # The default number of runs of the race grows with the budget.
        needed = (
            math.ceil(needed / (1.0 - FINAL_SHARE))
            if self.settings.final is None and self.final_runs
            else needed + self.final_runs
        )
        raise InputError(
            f"{self.budget} runs are too few: {words}; raise the budget to {needed}, or give fewer starts",
            field="search.budget",
        )

    @classmethod
    def from_toml(
        cls,
        text: str,
        *,
        name: str = "search",
        folder: str | Path | None = None,
        method: str | None = None,
        cost: str | None = None,
        budget: int | None = None,
        noise: str | None = None,
    ) -> Search:
        """Read a search from TOML text.

        Args:
            text: TOML. name: of the text, for messages.
            folder: where the files that the text names are looked for: scenario, floors and code.
            method: replaces the method of the text. If neither the text nor this argument gives a method, it is nsga2
                for several objectives, else pso.
            cost: name of the cost of a single objective that replaces all objectives of the text. It keeps two settings
                of the first of them: its statistic, and whether the score is that of the worst case or the mean over
                cases (``over``).
            budget, noise: replace the budget and ``pso.noise`` of the text.
        Raises:
            InputError: the text is not TOML, or has an unknown or invalid entry, which the message names.
        """
        check_kind(text, str, name, "TOML text")
        values = parsed_toml(text, name)
        search_values = {key: values.pop(key) for key in KEYS if key in values}
        with plugins.search_beside(folder):
            block, start = map(
                plugins.resolve_codes, (search_values.get("space"), search_values.get("start"))
            )
        study = _study_beside(block, values, folder)
        check_kind(block, (Mapping, NoneType), "space", "a table of fields with bounds")
        check_kind(start, (list, NoneType), "start", "a list of presets or of tables of values")
        objectives = objectives_from(search_values.get("objective", {}))
        settings = search_values.get("search", {})
        if isinstance(settings, Mapping):  # anything else is refused by ``_settings`` below
            defaults = {"method": "nsga2"} if len(objectives) > 1 else {}
            replaced = {"method": method, "budget": budget}
            settings = defaults | dict(settings) | {k: v for k, v in replaced.items() if v is not None}
        swarm = search_values.get("pso", {})
        if noise is not None and isinstance(swarm, Mapping):
            swarm = {**swarm, "noise": noise}
        if cost is not None:
            objectives = (Objective(cost, statistic=objectives[0].statistic, over=objectives[0].over),)
        with plugins.search_beside(folder):
            made = _settings(SearchSettings, settings, "search")
        return cls(
            study=study,
            space=Space.of(PAPER if block is None else block),
            objectives=objectives,
            settings=made,
            pso=_settings(PsoSettings, swarm, "pso"),
            start=None if start is None else tuple(start),
        )

    @classmethod
    def read(
        cls,
        path: str | Path,
        *,
        method: str | None = None,
        cost: str | None = None,
        budget: int | None = None,
        noise: str | None = None,
    ) -> Search:
        """Read a search from the TOML file ``path``.

        ``method``, ``cost``, ``budget`` and ``noise``, if given, replace those of the file, see ``from_toml``.

        Files that the search names (scenario, floors, code) are looked for in the folder of this file.

        Raises:
            InputError: the file cannot be read, or something in it is wrong.
        """
        path = Path(path)
        text = read_text(path, "a search", filled=True)
        with in_file(path):
            return cls.from_toml(
                text,
                name=str(path),
                folder=path.parent,
                method=method,
                cost=cost,
                budget=budget,
                noise=noise,
            )

    def to_values(self) -> dict[str, Any]:
        """Return the search as nested tables for TOML, from which ``from_toml`` reads a search with the same hash.

        The tables are self-contained: they name no floor files, and include the default start. Of a cost that is a
        function they have only the name, which ``from_toml`` refuses.
        """
        values: dict[str, Any] = tomllib.loads(self.study.to_toml())
        values.pop("runs", None)  # of a study; a search has a budget
        values["start"] = list(self._start)
        values["space"] = self.space.to_block()
        blocks = [objective.as_values() for objective in self.objectives]
        values["objective"] = blocks[0] if len(blocks) == 1 else blocks
        values["search"] = {k: v for k, v in vars(self.settings).items() if v is not None}  # TOML has no null
        # ``crash_share`` is left out if it is 0: the hash is computed from these values, and searches that were written
        # before this setting existed must keep their hash.
        swarm = {k: v for k, v in vars(self.pso).items() if k != "crash_share" or v}
        return values | {"pso": swarm}

    def to_toml(self) -> str:
        """Write the search as TOML; ``from_toml`` reads one with the same hash, and the fields in the same order.

        Raises:
            InputError: its cost is a function, which a file cannot hold.
        """
        if any(objective.function is not None for objective in self.objectives):
            raise InputError(
                "a cost that is a function cannot be written to a file; search without a folder",
                field="objective",
            )
        return as_toml(self.to_values())

    def with_settings(self, **changed: Any) -> Search:
        """Copy the search with some ``SearchSettings`` ``changed``."""
        return replace(self, settings=replace(self.settings, **changed))

    @property
    def seed(self) -> int:
        """Seed of all random numbers."""
        return self.study.seed

    @property
    def cases(self) -> tuple[Cell, ...]:
        """The scenarios in which every candidate is evaluated."""
        return self.study.cells

    @property
    def selected(self) -> tuple[list[Scenario], str, str]:
        """Scenarios, source of motion and method."""
        return [cell.scenario for cell in self.cases], self.study.motion, self.settings.method

    @property
    def code_used(self) -> tuple[list[Scenario], *tuple[str, ...]]:
        """Scenarios, source of motion, method and choices of the space, whose code ``result.write_code`` writes."""
        choices = [value for one in self.space for value in one.choices if plugins.is_code(value)]
        return *self.selected, *choices

    @cached_property
    def starts(self) -> list[Point]:
        """The starts as points in the unit cube.

        Raises:
            InputError: a start lies outside the bounds, lacks a field, is an unknown preset, or is neither the name of
                a preset nor a table.
        """
        points = []
        for entry in self._start:
            if isinstance(entry, str):
                check_choice(entry, "start", preset_names())
                entry = self.space.values_of(preset(entry))
            elif not isinstance(entry, Mapping):
                raise InputError(f"{entry!r} is neither a preset nor a table of values", field="start")
            try:
                points.append(self.space.point(dict(_flat(entry))))
            except InputError as error:
                raise InputError(str(error), field="start") from None
        return points

    @property
    def _start(self) -> tuple[str | Mapping[str, Any], ...]:
        """The field ``start`` or, if it is None, the default: P0 in the paper's space, no start in other spaces."""
        if self.start is not None:
            return self.start
        return (START,) if self.space == Space.of(PAPER) else ()

    @property
    def budget(self) -> int:
        """Total runs of the search; by default those of a particle swarm with the settings ``pso``."""
        return self.settings.budget or self.pso.runs_an_iteration * self.pso.iterations

    @property
    def final_runs(self) -> int:
        """Runs of the race of the finalists.

        By default ``FINAL_SHARE`` of the budget, but 0 with several objectives, or with the paper's swarm, that is with
        ``pso.noise`` "fixed" or "as-ran".
        """
        if self.settings.final is not None:
            return self.settings.final
        if len(self.objectives) > 1 or (self.settings.method == "pso" and self.pso.keeps_scores):
            return 0
        return int(FINAL_SHARE * self.budget)

    @property
    def search_budget(self) -> int:
        """Runs of the budget that are left for the method, after those of the race are subtracted.

        Raises:
            InputError: no run is left for the method.
        """
        left = self.budget - self.final_runs
        if left < 1:
            raise InputError(
                f"{self.budget} runs are not more than the {self.final_runs} of the race; "
                "raise the budget, or lower search.final",
                field="search.budget",
            )
        return left

    @property
    def is_as_ran(self) -> bool:
        """Whether the search runs as the paper's program did."""
        return self.settings.method == "pso" and self.pso.noise == "as-ran"

    @property
    def pso_settings(self) -> PsoSettings:
        """Settings of the swarm, with the number of iterations that fits into the budget.

        If the method is not pso, the settings are returned as given.

        Raises:
            InputError: the budget is too small for one iteration.
        """
        if self.settings.method != "pso":
            return self.pso
        iterations = self.search_budget // self.pso.runs_an_iteration
        if iterations < 1:
            race = f", and the {self.final_runs} of the race" if self.final_runs else ""
            raise InputError(
                f"{self.budget} runs are too few for one iteration, which takes {self.pso.runs_an_iteration}{race}",
                field="search.budget",
            )
        return replace(self.pso, iterations=iterations)

    @property
    def search_runs(self) -> int:
        """Runs that the method makes, without the race: its whole budget, or for pso the whole iterations that fit."""
        if self.settings.method == "pso":
            return self.pso_settings.runs_an_iteration * self.pso_settings.iterations
        return self.search_budget

    @cached_property
    def hash(self) -> str:
        """16 hexadecimal digits that identify the search, computed from its values and the hash of its study.

        The hash of the study also depends on the version of the format of scenarios, which the values lack. All
        settings count, also those that change no run of the search, such as ``fresh``. Of a cost that is a function
        only the name counts: two different functions with one name give the same hash.
        """
        text = json.dumps(self.to_values(), sort_keys=True, default=str)  # ``str``: of types that JSON lacks
        return hashlib.sha256(f"{text} {self.study.hash}".encode()).hexdigest()[:16]


def differences(there: Search, given: Search) -> list[str]:
    """Describe each field in which two searches differ, such as "seed is 1 there and 2 here".

    Args:
        there: the search that a folder holds. given: the search that was to be run there.
    """
    old, new = dict(_flat(there.to_values())), dict(_flat(given.to_values()))
    # their order is that of the coordinates of a point; as the hash leaves it out, it is compared here
    order = "order of the fields of space"
    old[order], new[order] = there.space.names, given.space.names
    return [
        f"{name} is {old.get(name, 'not set')!r} there and {new.get(name, 'not set')!r} here"
        for name in dict.fromkeys([*old, *new])
        if old.get(name) != new.get(name)
    ]


def _flat(values: Mapping[str, Any], before: str = "") -> list[tuple[str, Any]]:
    """Flatten nested tables to pairs (dotted name, value); ``before`` is put before each name."""
    items: list[tuple[str, Any]] = []
    for key, value in values.items():
        name = f"{before}{key}"
        items += _flat(value, f"{name}.") if isinstance(value, Mapping) else [(name, value)]
    return items


def _settings(kind: Any, block: Any, name: str) -> Any:
    """Make settings of the dataclass ``kind`` from the table ``block``, which the file calls ``name``."""
    check_kind(block, Mapping, name, "a table of settings")
    check_known_keys(block, name, [f.name for f in fields(kind)])
    return kind(**block)


def _study_beside(space: Any, values: dict[str, Any], folder: str | Path | None) -> Study:
    """Return the study of a search's file, whose base may fit together only with values that are searched over.

    A base that does not fit, or whose own value of such a field is wrong, gets the first of these values, which every
    candidate replaces.

    Args:
        space: the block ``space``, of any kind. values: the keys of a study. folder: as of ``from_toml``.
    Raises:
        InputError: something is wrong; the message is that of the base alone.
    """
    try:
        return Study.from_values(values, folder=folder)
    except InputError:
        base = values.get("scenario")
        if isinstance(space, Mapping) and isinstance(base, Mapping):
            with suppress(InputError):
                first = {one.name: one.value(0.0) for one in Space.of(space)}
                fitting = {**values, "scenario": with_fields(base, first)}
                return Study.from_values(fitting, folder=folder)
        raise


def check_scenario(scenario: Scenario, where: str) -> None:
    """Refuse a scenario in which no decision is right in any run, since no cost is defined there.

    Only the floor of run 0 is checked. It stands for all runs if all runs have the same floor, or if the task asks for
    the fill ratio, which is the same on all random floors of a scenario. For other tasks on random floors, the right
    decision may differ between runs, and nothing is refused here.

    Raises:
        InputError: no decision is right; the message names the field ``where``.
    """
    floor = scenario.floor_for(0, 0)  # seed 0, run 0
    same_answer = not scenario.floor.drawn_by_run or scenario.task.name == "fill_ratio"
    if same_answer and truth_on(scenario, floor) is None:
        reason = (
            "the fill ratio is the decision boundary itself, where "
            if scenario.task.name == "fill_ratio"
            else ""
        )
        raise InputError(f"{reason}no decision is right", field=where)
