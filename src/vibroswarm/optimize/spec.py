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

The default space is the paper's, with P0 as the start. Blocks of varied fields, as in a study, are the cases in which
every candidate is evaluated, such as several floors.
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.untrusted_files import parsed_toml, read_text
from vibroswarm.errors import InputError, check_choice, nearest, whole_number_of
from vibroswarm.inference.outcomes import truth_on
from vibroswarm.optimize.evaluate import NUMBERS
from vibroswarm.optimize.objective import Objective, objectives_from
from vibroswarm.optimize.pso import PsoSettings
from vibroswarm.optimize.space import PAPER, Point, Space
from vibroswarm.scenario.presets import preset_names
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.study.spec import Cell, Study

FORMAT: Final = 2
METHODS: Final = ("pso", "random", "sobol", "tpe", "gp", "cmaes", "nsga2")
OF_OPTUNA: Final = ("tpe", "gp", "nsga2")
KEYS: Final = ("space", "objective", "search", "pso", "start")
START: Final = "paper-empirical"
MOST_CASES: Final = 100
FINAL_SHARE: Final = 0.4
"""Of the budget, run by the finalists: a mean + sd of these costs is known to 1.5 / sqrt(runs), so 10 % take many."""


@dataclass(frozen=True)
class SearchSettings(NotebookView):
    """Settings of a search that all methods share.

    Args:
        method: one of ``METHODS``.
        evaluations: runs per candidate, for methods other than pso, which has its own.
        budget: total runs of the search; pso makes as many iterations as fit. Default: 15,000, those of the paper's
            50 iterations.
        final: runs of the race of the finalists, part of the budget (0: no race); by default 40 %.
        finalists: number of finalists.
        surface: whether minima of a response surface are finalists too.
        numbers: ``independent`` runs for each evaluation, or ``common`` ones.
        fresh: runs on which the winner is validated, in addition to the budget.
        dashboard: write a copy for Optuna's dashboard; by default only for Optuna's methods.
    """

    method: str = "pso"
    evaluations: int = 20
    budget: int | None = None
    final: int | None = None
    finalists: int = 12
    surface: bool = True
    numbers: str = "independent"
    fresh: int = 2000
    dashboard: bool | None = None

    def __post_init__(self) -> None:
        check_choice(self.method, "search.method", METHODS)
        check_choice(self.numbers, "search.numbers", NUMBERS)
        for name in ("surface", "dashboard"):
            if not isinstance(getattr(self, name), bool | None):
                raise InputError(f"{getattr(self, name)!r}: true or false", field=f"search.{name}")
        for name, low in (("evaluations", 1), ("budget", 1), ("final", 0), ("finalists", 1), ("fresh", 2)):
            if (value := getattr(self, name)) is not None:
                whole_number_of(value, f"search.{name}", low, 10**9)


@dataclass(frozen=True)
class Search(NotebookView):
    """The definition of a search, see the head of this module.

    Args:
        study: the scenario and the cases (its cells), the seed and the source of motion; its runs are ignored.
        space: fields with bounds. objectives: one, or several for nsga2.
        settings: method, budget and others. pso: settings of that method.
        start: presets by name, or values of the space's fields. Default: the paper's P0 in the paper's space.
    Raises:
        InputError: naming what is wrong, and what would be right.
    """

    study: Study = field(default_factory=Study)
    space: Space = field(default_factory=lambda: Space.of(PAPER))
    objectives: tuple[Objective, ...] = (Objective(),)
    settings: SearchSettings = field(default_factory=SearchSettings)
    pso: PsoSettings = field(default_factory=PsoSettings)
    start: tuple[str | Mapping[str, Any], ...] | None = None

    def __post_init__(self) -> None:
        if not self.objectives:
            raise InputError("is empty; name a cost", field="objective")
        if len(self.objectives) > 1 and self.settings.method != "nsga2":
            raise InputError("several objectives need the method nsga2", field="search.method")
        if len(self.study.cells) > MOST_CASES:
            raise InputError(f"has {len(self.study.cells)} cases; at most {MOST_CASES}", field="study")
        for cell in self.study.cells:
            if both := [name for name in self.space.names if name in cell.point]:
                raise InputError("is searched over, and varied by the cases too", field=both[0])
        for cell in self.study.cells:
            check_scenario(cell.scenario, "floor.source")
        _ = self.starts
        if self.settings.method == "pso" and len(self.starts) > self.pso.particles:
            raise InputError(f"{len(self.starts)} starts for {self.pso.particles} particles", field="start")
        _ = self.pso_settings, self.search_budget
        if self.is_as_ran:
            if self.settings.numbers != "independent":
                raise InputError(
                    'noise = "as-ran" numbers its runs itself; leave this out', field="search.numbers"
                )
            if self.final_runs:
                raise InputError('noise = "as-ran" has no race; leave this out', field="search.final")

    @classmethod
    def from_toml(
        cls,
        text: str,
        *,
        name: str = "search",
        folder: str | Path | None = None,
        method: str | None = None,
    ) -> Search:
        """Read a search from TOML text.

        Args:
            text: TOML. name: its name in errors. folder: that of the floor files it names.
            method: overrides that of the text; the default for several objectives is nsga2.
        Raises:
            InputError: not TOML, or an unknown or invalid entry, which is named.
        """
        values = parsed_toml(text, name)
        own = {key: values.pop(key) for key in KEYS if key in values}
        # The other keys are those of a study, which names an unknown one; a misspelt key of a search is named here.
        study_keys = [f.name for f in fields(Study)]
        for key in values:
            if nearest(key, KEYS) and not nearest(key, [*study_keys, "scenario", "grid", "list"]):
                raise InputError(f"there is no such key{nearest(key, KEYS)}", field=key)
        study = Study.from_values(values, name=name, folder=folder)
        block = own.get("space")
        if block is not None and not isinstance(block, Mapping):
            raise InputError("is a table of fields with bounds", field="space")
        start = own.get("start")
        if start is not None and not isinstance(start, list):
            raise InputError("is a list of presets or of tables of values", field="start")
        objectives, settings = objectives_from(own.get("objective", {})), own.get("search", {})
        if isinstance(settings, Mapping):
            defaults = {"method": "nsga2"} if len(objectives) > 1 else {}
            settings = defaults | dict(settings) | ({} if method is None else {"method": method})
        return cls(
            study=study,
            space=Space.of(PAPER if block is None else block),
            objectives=objectives,
            settings=_settings(SearchSettings, settings, "search"),
            pso=_settings(PsoSettings, own.get("pso", {}), "pso"),
            start=None if start is None else tuple(start),
        )

    @classmethod
    def read(cls, path: str | Path, *, method: str | None = None) -> Search:
        """Read a search from the TOML file ``path``, optionally with another ``method``; floor files are beside it.

        Raises:
            InputError: it cannot be read, or something in it is wrong.
        """
        path = Path(path)
        return cls.from_toml(read_text(path, "a search"), name=str(path), folder=path.parent, method=method)

    def to_values(self) -> dict[str, Any]:
        """Return the self-contained values for TOML."""
        values: dict[str, Any] = tomllib.loads(self.study.to_toml())
        values["start"] = list(self._start)
        values["space"] = self.space.to_block()
        blocks = [objective.as_values() for objective in self.objectives]
        values["objective"] = blocks[0] if len(blocks) == 1 else blocks
        values["search"] = {k: v for k, v in vars(self.settings).items() if v is not None}
        swarm = {k: v for k, v in vars(self.pso).items() if k != "crash_share" or v}  # older searches lack it
        return values | {"pso": swarm}

    def to_toml(self) -> str:
        """Write the search as TOML; ``from_toml`` reads an equal one.

        Raises:
            InputError: its cost is a function, which a file cannot hold.
        """
        import tomli_w

        if any(objective.function is not None for objective in self.objectives):
            raise InputError("a cost that is a function cannot be written to a file", field="objective")
        return tomli_w.dumps(self.to_values())

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

    @cached_property
    def starts(self) -> list[Point]:
        """The starts as points in the unit cube.

        Raises:
            InputError: a start outside the bounds, an unknown preset.
        """
        points = []
        for entry in self._start:
            if isinstance(entry, str):
                if entry not in preset_names():
                    raise InputError(
                        f"there is no preset '{entry}'{nearest(entry, preset_names())}", field="start"
                    )
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
        if self.start is not None:
            return self.start
        return (START,) if self.space == Space.of(PAPER) else ()

    @property
    def budget(self) -> int:
        """Total runs of the search; by default those of the paper's swarm."""
        return self.settings.budget or self.pso.runs_an_iteration * self.pso.iterations

    @property
    def final_runs(self) -> int:
        """Runs of the race of the finalists: none with several objectives, or with the paper's method."""
        if self.settings.final is not None:
            return self.settings.final
        if len(self.objectives) > 1 or (self.settings.method == "pso" and self.pso.keeps_scores):
            return 0
        return int(FINAL_SHARE * self.budget)

    @property
    def search_budget(self) -> int:
        """Runs before the race.

        Raises:
            InputError: none are left.
        """
        left = self.budget - self.final_runs
        if left < 1:
            raise InputError(
                f"{self.budget} runs are not more than the {self.final_runs} of the race",
                field="search.budget",
            )
        return left

    @property
    def is_as_ran(self) -> bool:
        """Whether it runs as the paper's program did."""
        return self.settings.method == "pso" and self.pso.noise == "as-ran"

    @property
    def has_dashboard(self) -> bool:
        """Whether a copy for Optuna's dashboard is written."""
        requested = self.settings.dashboard
        return self.settings.method in OF_OPTUNA if requested is None else requested

    @property
    def pso_settings(self) -> PsoSettings:
        """Settings of the swarm, with as many iterations as fit into the budget.

        Raises:
            InputError: the budget is too small for one.
        """
        if self.settings.method != "pso":
            return self.pso
        iterations = self.search_budget // self.pso.runs_an_iteration
        if iterations < 1:
            raise InputError(
                f"{self.search_budget} runs are too few for one iteration, which takes {self.pso.runs_an_iteration}",
                field="search.budget",
            )
        return replace(self.pso, iterations=iterations)

    @property
    def search_runs(self) -> int:
        """Runs of the method, without the race."""
        if self.settings.method == "pso":
            return self.pso_settings.runs_an_iteration * self.pso_settings.iterations
        return self.search_budget

    @cached_property
    def hash(self) -> str:
        """16 hexadecimal digits that identify the search."""
        values = self.to_values()
        values.pop("runs", None)
        text = json.dumps(values, sort_keys=True, default=str)
        return hashlib.sha256(f"{text} {self.study.hash}".encode()).hexdigest()[:16]


def differences(there: Search, given: Search) -> list[str]:
    """Say in which fields two searches differ."""
    old, new = dict(_flat(there.to_values())), dict(_flat(given.to_values()))
    return [
        f"{name} is {old.get(name, 'not set')!r} there and {new.get(name, 'not set')!r} here"
        for name in dict.fromkeys([*old, *new])
        if old.get(name) != new.get(name)
    ]


def _flat(values: Mapping[str, Any], before: str = "") -> list[tuple[str, Any]]:
    """Flatten nested tables to (dotted name, value) pairs."""
    items: list[tuple[str, Any]] = []
    for key, value in values.items():
        name = f"{before}{key}"
        items += _flat(value, f"{name}.") if isinstance(value, Mapping) else [(name, value)]
    return items


def _settings(kind: Any, block: Any, name: str) -> Any:
    """Read a table of settings into a dataclass; refuse unknown names."""
    if not isinstance(block, Mapping):
        raise InputError("is a table", field=name)
    known = [f.name for f in fields(kind)]
    for key in block:
        if key not in known:
            raise InputError(f"there is no such setting{nearest(key, known)}", field=f"{name}.{key}")
    return kind(**block)


def check_scenario(scenario: Scenario, where: str) -> None:
    """Refuse a scenario in which no decision is right, since no cost is defined there.

    If the answer may differ between runs, as for other tasks than the fill ratio on random floors, nothing is refused.
    """
    floor = scenario.floor_for(0, 0)
    alike = not scenario.floor.drawn_by_run or scenario.task.name == "fill_ratio"  # the answer, for all runs
    if alike and truth_on(scenario, floor) is None:
        reason = (
            "the fill ratio is the decision boundary itself, where "
            if scenario.task.name == "fill_ratio"
            else ""
        )
        raise InputError(f"{reason}no decision is right", field=where)
