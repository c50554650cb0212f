"""Define a study: a scenario, varied fields, the number of runs of each cell, and a seed; read and write it as TOML.

    runs = 1000
    [scenario]
    preset = "paper"
    [grid]
    "floor.source" = ["random:0.44", "random:0.48"]
    "strategy.name" = ["none", "positive", "soft"]

All cells have the same seed: run 17 of one cell has the motion and the noise of run 17 of another, so that cells are
compared in pairs.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import vibroswarm.simulation  # noqa: F401  (makes the engines known)
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.rng import SEED_LIMIT
from vibroswarm.core.untrusted_files import parsed_toml, read_text
from vibroswarm.errors import (
    InputError,
    check_choice,
    check_format,
    check_kind,
    nearest,
    path_of,
    shown,
    whole_number_of,
)
from vibroswarm.floors.source import family, is_random, resolve
from vibroswarm.motion.source import source
from vibroswarm.observation.decision_boundary import readings_boundary
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.study.factors import (
    BLOCKS,
    LABEL,
    PRESET,
    Point,
    fields_in_words,
    flat,
    names_of,
    points_of,
    value_in_words,
    with_whole,
    words_of_points,
)
from vibroswarm.study.precision import Precision

if TYPE_CHECKING:
    from vibroswarm.study.runner import Progress
    from vibroswarm.study.study_result import StudyResult

FORMAT: Final = 2
"""Version of the study's file; that of its folder is in ``store``."""

KEYS: Final = (
    "format",
    "name",
    "runs",
    "until",
    "figure",
    "max_runs",
    "seed",
    "motion",
    "keep",
    "scenario",
    "floors",
    *BLOCKS,
)
SOURCE: Final = "floor.source"
KEEP: Final = ("samples",)
MOST_RUNS: Final = 100_000_000


@dataclass(frozen=True)
class Cell(NotebookView):
    """One scenario of a study: its number, its values of the varied fields, and the scenario.

    ``words`` has each varied value as text, with enough digits to distinguish it from the others of the study.
    """

    number: int
    point: Point
    scenario: Scenario
    words: Mapping[str, str] = field(default_factory=dict, compare=False)
    name: str = ""
    """A name that no other cell has; the scenario's strategy if nothing is varied."""

    def __repr__(self) -> str:
        return f"Cell({self.number}, {shown(self.name)})"

    def words_of(self, fields: Iterable[str]) -> str:
        """Write some of the varied values: ``random:0.44, soft, eta 1250``."""
        return fields_in_words({name: self.words[name] for name in fields if name in self.words})


@dataclass(frozen=True)
class Study(NotebookView):
    """Many runs of scenarios that differ in some fields.

    Args:
        base: a ``Scenario``, or sections of one as in its file, which may name a ``preset``.
        vary: blocks of varied fields, see ``factors``; empty: one cell.
        runs: runs per cell; ``None`` with ``until``.
        until: runs are added until the interval of a figure is this narrow, see ``precision``.
        seed: of all cells. motion: source of motion, by name.
        keep: "samples": the store also saves a table of samples.
        floors: floors by name, rows of 0 and 1 from the top; ``floor.source`` may name them.
        name: a title.
        folder: the folder of floor files that are named.
    Raises:
        InputError: naming what is wrong, and what would be right.
    """

    base: Mapping[str, Any] | Scenario = field(default_factory=dict)
    vary: Mapping[str, Any] = field(default_factory=dict)
    runs: int | None = 100
    until: Precision | None = None
    seed: int = 1
    motion: str = "event"
    keep: tuple[str, ...] = ()
    floors: Mapping[str, Sequence[str]] = field(default_factory=dict)
    name: str = ""
    folder: Path | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        if isinstance(self.base, Scenario):
            object.__setattr__(self, "base", self.base.model_dump(exclude_none=True))
        if not isinstance(self.base, Mapping):
            raise InputError("is a scenario, or its sections by name", field="base")
        check_kind(self.vary, Mapping, "vary", "a table of blocks, such as {'grid': {field: values}}")
        check_kind(self.name, str, "name", "a text")
        check_kind(self.motion, str, "motion", "the name of a source of motion")
        check_kind(self.keep, (tuple, list), "keep", "a list of tables")
        if self.until is not None:
            check_kind(self.until, Precision, "until", "a Precision")
        if self.folder is not None:
            object.__setattr__(self, "folder", path_of(self.folder, "folder"))
        if (self.runs is None) == (self.until is None):
            raise InputError("give either a number of runs or a precision", field="runs")
        if self.runs is not None:
            object.__setattr__(self, "runs", whole_number_of(self.runs, "runs", 1, MOST_RUNS))
        object.__setattr__(self, "seed", whole_number_of(self.seed, "seed", 0, SEED_LIMIT - 1))
        object.__setattr__(self, "floors", _floors(self.floors))
        object.__setattr__(
            self, "vary", {k: with_whole(plugins.resolve_codes(v)) for k, v in self.vary.items()}
        )
        if plugins.is_code(self.motion):
            object.__setattr__(self, "motion", plugins.resolve_code("motion", self.motion))
        else:
            source(self.motion)
        for table in self.keep:
            check_choice(table, "keep", KEEP)
        if any(PRESET in point for point in self._points) and set(Scenario.model_fields) <= set(
            self._sections
        ):
            raise InputError(
                "a complete scenario overrides every preset; give only the fields that are the same in all cells",
                field=PRESET,
            )
        for cell in self.cells:
            readings_boundary(cell.scenario)  # refused here, before anything is simulated

    def __repr__(self) -> str:
        cells, varied = len(self.cells), ", ".join(self.varied)
        runs = (
            f"until {self.until.figure} is known"
            if self.runs is None and self.until
            else f"{self.runs:,} runs"
        )
        name = f"{shown(self.name)}, " if self.name else ""
        vary = f", varied: {varied}" if varied else ""
        return f"Study({name}{cells} cell{'s' * (cells != 1)}, {runs} each, seed {self.seed}{vary})"

    @classmethod
    def of(cls, scenario: Scenario, runs: int = 100, seed: int = 1, **grid: Sequence[Any]) -> Study:
        """Make a study of a scenario.

        Args:
            scenario: what does not vary. runs: of each cell. seed: of all cells.
            grid: varied fields, every combination; a dot is two underscores: ``strategy__name=["none", "soft"]``.
        Raises:
            InputError: an unknown field, or a value that is wrong.
        """
        for name, values in grid.items():
            if isinstance(values, str | bytes | Mapping) or not isinstance(values, Iterable):
                raise InputError(f"{shown(values)} is not a list of values", field=name.replace("__", "."))
        vary = {name.replace("__", "."): [plain_value(v) for v in values] for name, values in grid.items()}
        return cls(scenario, {"grid": vary} if vary else {}, runs, seed=seed)

    @classmethod
    def from_toml(cls, text: str, *, name: str = "study", folder: str | Path | None = None) -> Study:
        """Read a study from TOML text.

        Args:
            text: TOML. name: what errors call it. folder: where files of floors that it names lie.
        Raises:
            InputError: not TOML, or naming what is wrong in it.
        """
        check_kind(text, str, name, "TOML text")
        return cls.from_values(parsed_toml(text, name), name=name, folder=folder)

    @classmethod
    def from_values(
        cls, values: Mapping[str, Any], *, name: str = "study", folder: str | Path | None = None
    ) -> Study:
        """Make a study from the values of its TOML.

        Args:
            values: the tables and keys. name: what errors call it. folder: where files of floors that it names lie.
        Raises:
            InputError: naming what is wrong, and what would be right.
        """
        check_kind(values, Mapping, name, "a table of values")
        folder = None if folder is None else path_of(folder, "folder")
        with plugins.search_beside(folder):
            return cls._from_values(values, name, folder)

    @classmethod
    def _from_values(cls, values: Mapping[str, Any], name: str, folder: str | Path | None) -> Study:
        """Build a study from the values of its file."""
        plugins.remember_code_names(values)
        blocks = {key: plugins.resolve_codes(values[key]) for key in values if key in BLOCKS}
        for key in values:
            if key not in KEYS:
                raise InputError(f"there is no such key{nearest(key, KEYS)}", field=key)
        check_format(values.get("format", FORMAT), FORMAT, name)
        base = values.get("scenario", {})
        if isinstance(base, str):
            base = Scenario.read(Path(folder or ".") / base).model_dump(exclude_none=True)
        elif isinstance(base, Mapping):
            base = plugins.resolve_codes(base)  # before its parameters are looked for among what is varied
        else:
            raise InputError(
                "is a table, as in a scenario file, or the name of such a file", field="scenario"
            )
        until = values.get("until")
        precision = None
        if until is not None:
            precision = Precision.from_words(until, values.get("figure"), values.get("max_runs"))
        elif both := [key for key in ("figure", "max_runs") if key in values]:
            raise InputError("goes with 'until'", field=both[0])
        for key, kind, words in (("name", str, "text"), ("motion", str, "text"), ("keep", list, "list")):
            if key in values and not isinstance(values[key], kind):
                raise InputError(f"{values[key]!r} is not a {words}", field=key)
        return cls(
            base=base,
            vary=blocks,
            runs=values.get("runs", None if until is not None else 100),
            until=precision,
            seed=values.get("seed", 1),
            motion=values.get("motion", "event"),
            keep=tuple(values.get("keep", ())),
            floors=values.get("floors", {}),
            name=values.get("name", ""),
            folder=None if folder is None else Path(folder),
        )

    @classmethod
    def read(cls, path: str | Path) -> Study:
        """Read a study from the TOML file ``path``; floor files that it names are beside it.

        Raises:
            InputError: it cannot be read, or something in it is wrong.
        """
        path = path_of(path)
        return cls.from_toml(read_text(path, "a study"), name=str(path), folder=path.parent)

    def to_toml(self) -> str:
        """Write the study as TOML; ``from_toml`` reads one with the same cells, runs and seed.

        The text is self-contained: it includes floors from files and all fields of the scenario.
        """
        return self._toml

    @cached_property
    def _toml(self) -> str:
        """Write the study as TOML."""
        values: dict[str, Any] = {"format": FORMAT, "seed": self.seed}
        values |= {"name": self.name} if self.name else {}
        values |= {"runs": self.runs} if self.until is None else self.until.as_values()
        values |= {"motion": self.motion} if self.motion != "event" else {}
        values |= {"keep": list(self.keep)} if self.keep else {}
        floors = {name: list(rows) for name, rows in self._named_floors.items()}
        values |= {"scenario": self._with_tables(self._whole_base)} | ({"floors": floors} if floors else {})
        return as_toml(values | dict(self.vary))

    def _with_tables(self, base: dict[str, Any]) -> dict[str, Any]:
        """Add the default parameters of user code that cells name: the cells must be the same if it is not loaded."""
        tables = copy_of(base)
        for cell in self.cells:
            for part in cell.scenario.choices:
                if part.code is not None:
                    tables.setdefault(part.kind, {}).setdefault(part.name, part.defaults)
        return tables

    def with_runs(self, runs: int) -> Study:
        """Return the same study with a number of runs, in place of its own number or precision."""
        return replace(self, runs=runs, until=None)

    @cached_property
    def cells(self) -> tuple[Cell, ...]:
        """One cell for each combination of varied values, numbered in their order."""
        words = words_of_points(self._points)
        scenarios = [self._scenario(point) for point in self._points]
        names = names_of(words, [scenario.strategy.name for scenario in scenarios])
        return tuple(
            Cell(k, *each) for k, each in enumerate(zip(self._points, scenarios, words, names, strict=True))
        )

    def run(
        self, folder: str | Path | None = None, *, progress: Progress | bool = True, **how: Any
    ) -> StudyResult:
        """Run the study, or continue it.

        Args:
            folder: where it is saved; by default in a temporary folder that is removed with the result.
            progress: whether a bar is shown in a terminal or notebook; or a function that is called with the progress.
            how: ``executor``, ``workers``, ``job``, ``mixed``, ``allow_failures``, see ``study_result.run``.
        Raises:
            InputError: the folder is of another study, or was changed. RunError: runs failed, or workers are gone.
        """
        from vibroswarm.study.study_result import run_with_bar

        return run_with_bar(self, folder, progress, how)

    @property
    def varied(self) -> list[str]:
        """The varied fields, in order of first use."""
        return list(dict.fromkeys(name for cell in self.cells for name in cell.point))

    @cached_property
    def codes(self) -> tuple[str, ...]:
        """User code that its cells or its motion need, as ``plugins`` names it."""
        return tuple(sorted({self.motion, *(code for cell in self.cells for code in cell.scenario.codes)}))

    @cached_property
    def hash(self) -> str:
        """16 hexadecimal digits that depend on cells, seed and saved tables, but not on the number of runs."""
        data = [FORMAT, self.seed, self.motion, sorted(self.keep), [c.scenario.hash for c in self.cells]]
        points = [sorted((k, repr(v)) for k, v in c.point.items()) for c in self.cells]
        if len({cell.scenario.run.t_end_s for cell in self.cells}) > 1:
            data.append("one motion for several ends")  # before, each had its own, and groups other numbers
        return hashlib.sha256(json.dumps([data, points]).encode()).hexdigest()[:16]

    @cached_property
    def _named_floors(self) -> dict[str, tuple[str, ...]]:
        """Rows of 0 and 1 of the study's own floors and of those that it names from files, by name; no patterns."""
        floors = {name: tuple(rows) for name, rows in self.floors.items()}
        of_base = self._sections.get("floor", {})
        of_base = of_base if isinstance(of_base, Mapping) and "tiles" not in of_base else {}
        for name in [of_base.get("source"), *(point.get(SOURCE) for point in self._points)]:
            if isinstance(name, str) and name not in floors and not is_random(name) and family(name) is None:
                size = (of_base.get("rows"), of_base.get("columns"))
                shape = size if isinstance(size[0], int) and isinstance(size[1], int) else None
                path = (self.folder or Path()) / name
                tiles, _ = resolve(str(path) if path.is_file() else name, shape)  # type: ignore[arg-type]
                floors[name] = tuple("".join("1" if tile else "0" for tile in row) for row in tiles)
        return floors

    @property
    def _sections(self) -> Mapping[str, Any]:
        assert not isinstance(self.base, Scenario)
        return self.base

    @cached_property
    def _whole_base(self) -> dict[str, Any]:
        """All fields of the scenario, so that a version with other defaults reads the same study.

        Only the given fields if presets are varied, since a complete scenario would override them, or if the base is
        valid only together with varied fields.
        """
        if not any(PRESET in point for point in self._points):
            with suppress(InputError):  # a base may be wrong alone and right in each cell
                return self._scenario({}).model_dump(exclude_none=True)
        return dict(self._sections)

    @cached_property
    def _points(self) -> list[Point]:
        return points_of(self.vary)

    def _scenario(self, point: Point) -> Scenario:
        """Build the scenario of a point."""
        base = copy_of(self._sections)
        if PRESET in point:
            base[PRESET] = point[PRESET]
        values = {k: v for k, v in point.items() if k not in (PRESET, LABEL)}
        try:
            floor = base.get("floor")
            if isinstance(floor, dict) and "tiles" not in floor and floor.get("source") in self._named_floors:
                floor["tiles"] = self._named_floors[floor["source"]]
            if SOURCE in values:
                values.setdefault("floor.tiles", self._named_floors.get(values[SOURCE]))
            return Scenario.from_base(base).with_values(values)
        except InputError as error:
            if not point:
                raise
            words = ", ".join(f"{k} = {value_in_words(v)}" for k, v in point.items())
            raise InputError(f"{error} (in the cell with {words})") from None


def as_toml(values: Mapping[str, Any]) -> str:
    """Write a study's values as TOML; blocks and fields keep their order, which is that of the cells."""
    import tomli_w

    parts = [tomli_w.dumps({k: v for k, v in values.items() if k not in BLOCKS})]
    for name in (name for name in values if name in BLOCKS):
        head, tables = (f"[[{name}]]", values[name]) if name == "list" else (f"[{name}]", [values[name]])
        for table in tables:
            parts.append(
                "\n".join([head, *(f"{json.dumps(k)} = {_inline(v)}" for k, v in flat(table).items())])
            )
    return "\n".join(parts) + "\n"


def _inline(value: Any) -> str:
    """Write a value as TOML; a range on one line, since a table would move after the fields that follow it."""
    import tomli_w

    if type(value) is int:
        return str(value)
    if type(value) is float and math.isfinite(value):
        return repr(value)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{name} = {_inline(part)}" for name, part in value.items()) + " }"
    return tomli_w.dumps({"v": value}).removeprefix("v = ").strip()


def plain_value(value: Any) -> Any:
    """Convert a NumPy number to a Python number."""
    return value.item() if hasattr(value, "item") and hasattr(value, "dtype") else value


def copy_of(base: Mapping[str, Any]) -> dict[str, Any]:
    """Copy a base so that its sections can be changed."""
    return {k: dict(v) if isinstance(v, Mapping) else v for k, v in base.items()}


def _floors(values: Any) -> dict[str, tuple[str, ...]]:
    """Check the table of named floors."""
    if not isinstance(values, Mapping):
        raise InputError("is a table of floors by name", field="floors")
    for name, rows in values.items():
        if is_random(name) or family(name) is not None:
            raise InputError(
                "is the name of a pattern or of a random floor; give this one a name of its own",
                field=f"floors.{name}",
            )
        if not isinstance(rows, list | tuple) or not all(isinstance(row, str) for row in rows):
            raise InputError(
                "a floor is a list of rows of 0 and 1, the top row first", field=f"floors.{name}"
            )
    return {name: tuple(rows) for name, rows in values.items()}
