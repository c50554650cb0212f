"""Define a study: a scenario, varied fields, the number of runs of each cell, and a seed; read and write it as TOML.

    runs = 1000
    [scenario]
    preset = "paper"
    [grid]
    "floor.source" = ["random:0.44", "random:0.48"]
    "strategy.name" = ["none", "positive", "soft"]

All cells have the same seed: run 17 of one cell has the motion and the noise of run 17 of another cell, as far as their
settings allow. So cells are compared run by run.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from vibroswarm.core.atomic_io import MANIFEST, write_files
from vibroswarm.core.folders import manifest_text, read_manifest
from vibroswarm.core.rng import SEED_LIMIT
from vibroswarm.core.untrusted_files import parsed_toml, read_text
from vibroswarm.errors import InputError, check_kind, check_known_keys, in_file, whole_number_of
from vibroswarm.floors.source import beside, family, fields_of_file, is_generated
from vibroswarm.motion.source import source
from vibroswarm.observation.decision_boundary import readings_boundary
from vibroswarm.scenario import plugins
from vibroswarm.scenario.fields import rows_as_text
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.study.cells import (
    BLOCKS,
    LABEL,
    PRESET,
    Cell,
    Point,
    fields_in,
    names_of,
    points_of,
    value_as_text,
)
from vibroswarm.study.precision import Precision
from vibroswarm.study.run import MOST_RUNS, opened, run
from vibroswarm.study.runs import Runs

OF_UNTIL: Final = ("figure", "max_runs")
"""Keys that a study's file may have together with ``until``."""
KEYS: Final = ("name", "runs", "until", *OF_UNTIL, "seed", "motion", "scenario", "floors", *BLOCKS)
"""Keys of a study's file."""
SOURCE: Final = "floor.source"
"""The field that names the floor: ``random:0.48``, a pattern, or a file."""
TILES: Final = "floor.tiles"
"""The field with a floor's kinds of tile."""
MARKER: Final = "study.toml"
"""File of a study in the folder of its runs."""


@dataclass(frozen=True)
class Study:
    """Many runs of scenarios that differ in some fields.

    Args:
        base: a ``Scenario``, or sections of one as in its file, which may name a ``preset``.
        vary: blocks of varied fields, see ``cells``; empty: one cell.
        runs: number of runs of each cell; None if ``until`` is given.
        until: runs are added until the interval of a figure is this narrow, see ``precision``.
        seed: the seed, which is the same for all cells.
        motion: name of the source of motion.
        floors: floors by name, each a list of rows of 0 and 1, or of values, the top row first; ``floor.source`` may
            name them.
        name: a title.
        folder: folder of the floor files that the study names; None: the current folder.
    Raises:
        InputError: something is wrong.
    """

    base: Mapping[str, Any] | Scenario = field(default_factory=dict)
    vary: Mapping[str, Any] = field(default_factory=dict)
    runs: int | None = 100
    until: Precision | None = None
    seed: int = 1
    motion: str = "event"
    floors: Mapping[str, Any] = field(default_factory=dict)
    name: str = ""
    folder: Path | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        if (self.runs is None) == (self.until is None):
            raise InputError("give either a number of runs or a precision", field="runs")
        if self.runs is not None:
            whole_number_of(self.runs, "runs", 1, MOST_RUNS)
        whole_number_of(self.seed, "seed", 0, SEED_LIMIT - 1)
        if not plugins.is_code(self.motion):
            source(self.motion)  # raises if there is no such source
        for cell in self.cells:
            readings_boundary(cell.scenario)  # raises if robots cannot test their readings against it

    @classmethod
    def of(cls, scenario: Scenario, runs: int = 100, seed: int = 1, **grid: Iterable[Any]) -> Study:
        """Make a study of a scenario with every combination of some values.

        Args:
            scenario: gives the fields that are not varied. runs: of each cell. seed: of all cells.
            grid: the values of each varied field; the dot of the field's name is written as two underscores:
                ``strategy__name=["none", "soft"]``.
        Raises:
            InputError: an unknown field, or a value that is wrong.
        """
        vary = {name.replace("__", "."): list(values) for name, values in grid.items()}
        return cls(base=scenario, vary={"grid": vary} if vary else {}, runs=runs, seed=seed)

    @classmethod
    def read(cls, path: str | Path) -> Study:
        """Read a study from the TOML file ``path``; floor files that it names are beside it.

        Raises:
            InputError: it cannot be read, or something in it is wrong.
        """
        path = Path(path)
        with in_file(path):
            values = parsed_toml(read_text(path, "a study"), str(path))
            return cls.from_values(values, folder=path.parent)

    @classmethod
    def from_values(cls, values: Mapping[str, Any], *, folder: str | Path | None = None) -> Study:
        """Make a study from the values of its TOML."""
        folder = None if folder is None else Path(folder)
        check_known_keys(values, "study", KEYS)
        with plugins.search_beside(folder):
            motion = values.get("motion", "event")
            if plugins.is_code(motion):
                motion = plugins.resolve_code("motion", motion)
            values = {**plugins.resolve_codes(values), "motion": motion}
        base = values.get("scenario", {})
        if isinstance(base, str):
            base = Scenario.read((folder or Path()) / base)
        until = None
        if "until" in values:
            until = Precision.of(values["until"], **{key: values.get(key) for key in OF_UNTIL})
        given = {key: values[key] for key in ("name", "seed", "motion", "floors") if key in values}
        blocks = {key: values[key] for key in values if key in BLOCKS}
        runs = values.get("runs", None if until else 100)
        return cls(base, blocks, runs, until, folder=folder, **given)

    def to_toml(self) -> str:
        """Write the study as TOML; ``read`` reads one with the same cells, runs and seed, wherever the file is."""
        values: dict[str, Any] = {"name": self.name} if self.name else {}
        values |= {"runs": self.runs} if self.until is None else self.until.as_values()
        values |= {"seed": self.seed, "motion": self.motion, "scenario": self._whole_base()}
        if self._floors:
            values["floors"] = self._floors
        return as_toml(values | dict(self.vary))

    def _whole_base(self) -> dict[str, Any]:
        """Return all fields of the base, and the default parameters of user code, so that no other default matters."""
        base = self._sections
        if not any(PRESET in point for point in self._points):
            with suppress(InputError):  # it may fit together only with the values that vary
                base = self._base({}, {}).model_dump(exclude_none=True)
        for part in (part for cell in self.cells for part in cell.scenario.choices if part.code is not None):
            base.setdefault(part.kind, {}).setdefault(part.selected, part.entry.params().model_dump())
        return base

    def with_runs(self, runs: int) -> Study:
        """Return the same study with this number of runs per cell instead of its own number or precision."""
        return replace(self, runs=runs, until=None)

    def run(self, folder: str | Path | None = None, **how: Any) -> Runs:
        """Run the study, or continue it; in a folder, write its file too.

        Args:
            folder: where runs are saved; by default they are removed with the result.
            how: ``executor``, ``workers``, ``shard``, ``progress``, see ``run.run``.
        """
        place = None if folder is None else Path(folder)
        if place is not None:
            about = manifest_text("study", hash=self.hash)
            write_files(place, {MARKER: self.to_toml(), MANIFEST: about})
        return run(self.cells, folder=place, **self._settings, **how)

    @classmethod
    def open(cls, folder: Path) -> tuple[Study, Runs]:
        """Return the study in a folder, and its runs that are there."""
        read_manifest(folder, "study")
        study = cls.read(folder / MARKER)
        return study, opened(study.cells, folder=folder, **study._settings)

    @property
    def _settings(self) -> dict[str, Any]:
        values = {name: getattr(self, name) for name in ("seed", "motion", "until", "name")}
        return values | {"runs": self.runs or 1}

    @cached_property
    def cells(self) -> tuple[Cell, ...]:
        """One cell for each combination of varied values, numbered from 0."""
        scenarios = [self._scenario(point) for point in self._points]
        cells = [Cell(k, *both) for k, both in enumerate(zip(self._points, scenarios, strict=True))]
        names = names_of([cell.texts for cell in cells], [one.strategy.name for one in scenarios])
        return tuple(replace(cell, name=name) for cell, name in zip(cells, names, strict=True))

    @cached_property
    def varied(self) -> list[str]:
        """The varied fields, in order of first use."""
        return list(dict.fromkeys(name for cell in self.cells for name in cell.point))

    @cached_property
    def hash(self) -> str:
        """16 hexadecimal digits of cells, seed and source of motion, but not of the number of runs and the name."""
        what = [self.seed, self.motion, [[cell.scenario.hash, cell.point] for cell in self.cells]]
        text = json.dumps(what, sort_keys=True, default=list)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def _sections(self) -> dict[str, Any]:
        base = self.base.model_dump(exclude_none=True) if isinstance(self.base, Scenario) else self.base
        return {name: dict(part) if isinstance(part, Mapping) else part for name, part in base.items()}

    @cached_property
    def _points(self) -> list[Point]:
        points = points_of(plugins.resolve_codes(self.vary))
        return [point | {TILES: rows_as_text(point[TILES])} if TILES in point else point for point in points]

    @cached_property
    def _floors(self) -> dict[str, Any]:
        """Rows of the floors that the study defines or reads from files, by name."""
        floors = {name: rows_as_text(rows) for name, rows in self.floors.items()}
        section = self._sections.get("floor", {})
        if "tiles" in section or "values" in section:
            section = {}
        shape: Any = (section.get("rows"), section.get("columns"))
        for one in ({f"floor.{name}": value for name, value in section.items()}, *self._points):
            name = one.get(SOURCE)
            has_rows = not one.keys().isdisjoint((TILES, "floor.values"))
            if name is None or has_rows or name in floors or is_generated(name) or family(name):
                continue
            file = beside(name, self.folder or Path())
            found = fields_of_file(file, None if None in shape else shape, section.get("image_threshold"))
            floors[name] = found["tiles"] or found["values"]
        return floors

    def _base(self, preset: dict[str, Any], values: Mapping[str, Any]) -> Scenario:
        """Return the scenario in which a point replaces the preset and values."""
        base = with_fields(self._sections | preset, values)
        floor = base.get("floor", {})
        if "tiles" not in floor and "values" not in floor and floor.get("source") in self._floors:
            base["floor"] = {**floor, **fields_of_floor(self._floors[floor["source"]])}
        return Scenario.from_base(base)

    @cached_property
    def _shared_base(self) -> Scenario:
        return self._base({}, {})

    def _scenario(self, point: Point) -> Scenario:
        """Return the scenario of a cell: the base with the values of its point."""
        values = {k: v for k, v in point.items() if k not in (PRESET, LABEL)}
        try:
            if SOURCE in values:  # tiles of the base are those of another floor
                rows = fields_of_floor(self._floors.get(values[SOURCE]))
                values = {f"floor.{name}": of_floor for name, of_floor in rows.items()} | values
            own = {PRESET: point[PRESET]} if PRESET in point else {}
            try:
                base = self._base(own, {}) if own else self._shared_base
            except InputError:  # the base alone need not fit together
                base = self._base(own, values)
            return base.with_values(values)
        except InputError as error:
            if not point:
                raise
            texts = ", ".join(f"{k} = {value_as_text(v)}" for k, v in point.items())
            raise InputError(f"{error} (in the cell with {texts})") from None


def as_toml(values: Mapping[str, Any]) -> str:
    """Write the values of a study or search as TOML, blocks last.

    Blocks and their fields keep their order, since the order of the cells, and of a point's coordinates, follows from
    it. Names of fields are written with dots, in quotes.
    """
    import tomli_w

    blocks = (*BLOCKS, "space")
    parts = [tomli_w.dumps({k: v for k, v in values.items() if k not in blocks})]
    for name in (name for name in values if name in blocks):
        # The block ``list`` is an array of tables, each with the head [[list]]; every other block is one table.
        head, tables = (f"[[{name}]]", values[name]) if name == "list" else (f"[{name}]", [values[name]])
        for table in tables:
            fields = fields_in(table, name, (LABEL,))
            # A name in quotes is written alike in JSON and in TOML.
            lines = (f"{json.dumps(each)} = {_inline(value)}" for each, value in fields.items())
            parts.append("\n".join([head, *lines]))
    return "\n".join(parts) + "\n"


def _inline(value: Any) -> str:
    """Write a value as TOML, as it stands after ``name =``; a range as an inline table, which keeps its place."""
    import tomli_w

    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{name} = {_inline(part)}" for name, part in value.items()) + " }"
    return tomli_w.dumps({"v": value}).removeprefix("v = ").strip()


def with_fields(base: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return a base with fields set, by dotted names such as ``strategy.soft.eta``; None leaves a field out."""
    found = dict(base)
    for name, value in values.items():
        *tables, last = name.split(".")
        part = found
        for at, table in enumerate(tables, 1):
            check_kind(part.get(table, {}), Mapping, ".".join(tables[:at]), "a table of fields")
            part[table] = part = dict(part.get(table, {}))
        part.pop(last, None)
        if value is not None:
            part[last] = value
    return found


def fields_of_floor(rows: Any) -> dict[str, Any]:
    """Return the fields of a scenario's floor that hold its rows; None without rows, for a floor that its name says."""
    has_values = rows is not None and any(not isinstance(row, str) for row in rows)
    return {"tiles": None if has_values else rows, "values": rows if has_values else None}
