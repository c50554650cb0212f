"""Define a search: space, objectives, method and budget; read and write it as TOML.

    seed = 1
    start = ["paper-empirical", "a/best.toml"]   # presets, scenarios, or tables of values
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
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
from pydantic import Field, ValidationError

from vibroswarm.core.frozen_model import FrozenModel
from vibroswarm.core.untrusted_files import parsed_toml, read_text
from vibroswarm.errors import InputError, in_file
from vibroswarm.scenario import plugins
from vibroswarm.scenario.choices import field_error
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.search import methods
from vibroswarm.search.objective import Objective, objectives_from
from vibroswarm.search.pso import KEEPING, PsoSettings
from vibroswarm.search.space import PAPER, Point, Space, Values
from vibroswarm.study.spec import Study, as_toml

KEYS: Final = ("space", "objective", "search", "pso", "start")
"""Keys that a search adds to those of a study."""
START: Final = "paper-empirical"
"""The preset of P0."""
FINAL_SHARE: Final = 0.4
"""Share of the budget for the finalists. It is large since the relative error of a mean + sd of these costs is about
1.5 / sqrt(runs): to distinguish candidates that differ by 10 % takes hundreds of runs of each."""
AMOUNTS: Final = {"budget", "final", "finalists", "fresh"}
"""Settings that may change when a search is continued."""


class SearchSettings(FrozenModel):
    """Settings of a search that all methods share."""

    method: str = "pso"
    """Name of a method, or ``FILE.py:NAME`` (see ``methods``)."""
    evaluations: Annotated[int, Field(ge=1)] = 20
    """Runs per candidate, for methods other than pso, which has its own setting."""
    budget: Annotated[int | None, Field(ge=1)] = None
    """Total runs of the search. Default: those of the swarm's iterations, the paper's 15,000."""
    final: Annotated[int | None, Field(ge=0)] = None
    """Runs of the finalists, part of the budget. Default: 40 % of it, but 0 with the paper's swarm."""
    finalists: Annotated[int, Field(ge=1)] = 12
    """Largest number of finalists."""
    fresh: Annotated[int, Field(ge=2)] = 2000
    """Runs on which the winner is validated, in addition to the budget."""


@dataclass(frozen=True)
class Search:
    """The definition of a search, see the head of this module."""

    study: Study = field(default_factory=Study)
    """The scenario, the cases (its cells), the seed and the source of motion; its number of runs is ignored."""
    space: Space = field(default_factory=lambda: Space.of(PAPER))
    objectives: tuple[Objective, ...] = (Objective(),)
    """What is minimised: one objective, or several with the method nsga2."""
    settings: SearchSettings = field(default_factory=SearchSettings)
    pso: PsoSettings = field(default_factory=PsoSettings)
    start: tuple[str | Mapping[str, Any], ...] | None = None
    """Points to begin with: presets, files of scenarios, or tables of values. Default: P0 in the paper's space."""

    def __post_init__(self) -> None:
        method = methods.method(self.settings.method)
        if len(self.objectives) > 1 and not method.several:
            raise InputError("several objectives need the method nsga2", field="search.method")
        for name in self.space.names:
            if name in self.study.varied:
                raise InputError("is searched over, and varied by the cases too", field=name)
        self._check_bounds()
        if self.search_budget < 1 or (self.noise and self.pso_iterations < 1):
            raise InputError(
                f"{self.budget} runs are too few, {self.final_runs} of them final runs", field="search.budget"
            )

    def _check_bounds(self) -> None:
        """Refuse bounds and choices outside the range of a field, whatever the other fields are."""
        corners = [self.space.values(np.full(len(self.space.names), u)) for u in (0.5, 0.0, 1.0)]
        for dimension in self.space:
            name = dimension.name
            for value in dimension.choices or (dimension.value(0.0), dimension.value(1.0)):
                if all((why := self._refusal(name, {**corner, name: value})) for corner in corners):
                    raise InputError(why, field=f"space.{name}")

    def _refusal(self, name: str, values: Values) -> str:
        """Return why a scenario refuses a field with these values; empty: it does not."""
        try:
            self.study.cells[0].scenario.with_values(values)
        except InputError as error:
            return error.reason if f"{error.field}.".startswith(f"{name}.") else ""
        return ""

    @classmethod
    def from_toml(
        cls,
        text: str,
        *,
        name: str = "search",
        folder: str | Path | None = None,
        cost: str | None = None,
        noise: str | None = None,
        **settings: Any,
    ) -> Search:
        """Read a search from TOML text.

        Args:
            folder: where the files that the text names are. cost: replaces all objectives by one, with the statistic
                of the first. noise, settings: replace ``pso.noise`` and settings of ``[search]``, unless None.
        """
        values = parsed_toml(text, name)
        own = {key: values.pop(key) for key in KEYS if key in values}
        objectives = objectives_from(own.get("objective", {}))
        if cost is not None:
            objectives = (Objective(cost, objectives[0].statistic),)
        given = {"method": "nsga2" if len(objectives) > 1 else "pso"} | own.get("search", {})
        given |= {key: value for key, value in settings.items() if value is not None}
        with plugins.search_beside(folder):
            block = plugins.resolve_codes(own.get("space", PAPER))
            if plugins.is_code(given["method"]):
                given["method"] = plugins.resolve_code("method", given["method"])
        start = own.get("start")
        if start is not None:  # files are beside the search's
            start = tuple(str(Path(folder or "", s)) if str(s).endswith(".toml") else s for s in start)
        return cls(
            study=Study.from_values(values, folder=folder),
            space=Space.of(block),
            objectives=objectives,
            settings=_model(SearchSettings, given, "search"),
            pso=_model(PsoSettings, own.get("pso", {}) | ({"noise": noise} if noise else {}), "pso"),
            start=start,
        )

    @classmethod
    def read(cls, path: str | Path, **replaced: Any) -> Search:
        """Read a search from a TOML file; files that it names are beside it. ``replaced``: see ``from_toml``."""
        path = Path(path)
        with in_file(path):
            text = read_text(path, "a search")
            return cls.from_toml(text, name=str(path), folder=path.parent, **replaced)

    def to_toml(self) -> str:
        """Write the search as TOML, self-contained; of a cost of one's own it has the name."""
        values: dict[str, Any] = tomllib.loads(self.study.to_toml())
        values.pop("runs", None)  # of a study; a search has a budget
        values |= {
            "start": [self.space.values(point) for point in self.starts],
            "space": self.space.to_block(),
            "objective": [objective.as_values() for objective in self.objectives],
            "search": self.settings.model_dump(exclude_none=True),
            "pso": self.pso.model_dump(),
        }
        return as_toml(values)

    def with_settings(self, **changed: Any) -> Search:
        """Copy the search with some ``SearchSettings`` changed."""
        return replace(self, settings=SearchSettings(**{**self.settings.model_dump(), **changed}))

    @property
    def noise(self) -> str:
        """How the swarm treats noise (``PsoSettings.noise``); empty with other methods."""
        return self.pso.noise if self.settings.method == "pso" else ""

    @property
    def codes(self) -> list[str]:
        """References to users' code: motion, choices, and what scenarios name."""
        choices = [value for one in self.space for value in one.choices if plugins.is_code(value)]
        return [
            self.study.motion,
            *choices,
            *(code for cell in self.study.cells for code in cell.scenario.codes),
        ]

    @cached_property
    def starts(self) -> list[Point]:
        """The starts as points in the unit cube."""
        default = (START,) if self.space == Space.of(PAPER) else ()
        return [self._point(one) for one in (default if self.start is None else self.start)]

    def _point(self, start: str | Mapping[str, Any]) -> Point:
        if isinstance(start, str):
            scenario = Scenario.read(start) if start.endswith(".toml") else preset(start)
            start = self.space.values_of(scenario)
        return self.space.point(start)

    @property
    def budget(self) -> int:
        """Total runs of the search; by default those of the swarm's iterations."""
        return self.settings.budget or self.pso.runs_an_iteration * self.pso.iterations

    @property
    def final_runs(self) -> int:
        """Runs of the finalists; none with several objectives, and by default none with the paper's swarm."""
        if len(self.objectives) > 1:
            return 0
        default = 0 if self.noise in KEEPING else int(FINAL_SHARE * self.budget)
        return default if self.settings.final is None else self.settings.final

    @property
    def search_budget(self) -> int:
        """Runs of the budget that are left for the method."""
        return self.budget - self.final_runs

    @property
    def pso_iterations(self) -> int:
        """Iterations of the swarm that fit into the budget."""
        return self.search_budget // self.pso.runs_an_iteration

    @cached_property
    def hash(self) -> str:
        """16 hexadecimal digits of all but ``AMOUNTS``, which may change when the search is continued."""
        starts = [self.space.values(point) for point in self.starts]
        costs = [(objective.as_values(), objective.source) for objective in self.objectives]
        settings, pso = self.settings.model_dump(exclude=AMOUNTS), self.pso.model_dump(exclude={"iterations"})
        parts = [self.study.hash, starts, self.space.to_block(), costs, settings, pso]
        text = json.dumps(parts, sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def _model(kind: Any, values: Mapping[str, Any], name: str) -> Any:
    try:
        return kind(**values)
    except ValidationError as error:
        raise field_error(error, lambda wrong: "", f"{name}.") from None
