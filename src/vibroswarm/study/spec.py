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
import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import vibroswarm.simulation  # noqa: F401  (makes the engines known)
from vibroswarm.core.notebook_view import study_verbs
from vibroswarm.core.rng import SEED_LIMIT
from vibroswarm.core.untrusted_files import parsed_toml, read_text
from vibroswarm.errors import (
    InputError,
    check_choice,
    check_kind,
    in_file,
    keep_plain,
    shown,
    whole_number_of,
)
from vibroswarm.floors.source import beside, family, fields_of_file, is_generated
from vibroswarm.motion.source import source
from vibroswarm.observation.decision_boundary import readings_boundary
from vibroswarm.scenario import plugins
from vibroswarm.scenario.fields import rows_as_text
from vibroswarm.scenario.scenario import Scenario, changes
from vibroswarm.study.factors import (
    BLOCKS,
    LABEL,
    PRESET,
    Point,
    check_names,
    fields_in_words,
    flat,
    names_of,
    points_of,
    value_in_words,
    words_of_points,
)
from vibroswarm.study.precision import Precision
from vibroswarm.study.scenario_words import refuse_without_effect

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
    "level",
    "seed",
    "motion",
    "keep",
    "scenario",
    "floors",
    *BLOCKS,
)
"""Keys of a study's file."""


OF_UNTIL: Final = ("figure", "max_runs", "level")
"""Keys that a study's file may have only together with ``until``, in the order of ``Precision.from_words``."""


SOURCE: Final = "floor.source"
"""The field that names the floor: ``random:0.48``, a pattern, or a file."""
TILES: Final = "floor.tiles"
"""The field with a floor's kinds of tile."""
OF_ROWS: Final = frozenset(("tiles", "values"))
"""Fields of a floor that hold its rows."""
Rows = tuple[str, ...] | tuple[tuple[float, ...], ...]
"""Rows of a floor, the top row first: a text of kinds of tile each, or values of tiles."""


KEEP: Final = ("samples",)
"""Tables that a study may save besides the outcomes of robots."""


MOST_RUNS: Final = 100_000_000
"""Most runs of a cell."""


@dataclass(frozen=True)
class Cell:
    """One scenario of a study: its number, its values of the varied fields (``point``), and the scenario.

    ``words`` has each varied value as text, with enough digits to distinguish it from the field's other values.
    """

    number: int
    point: Point
    scenario: Scenario
    words: Mapping[str, str] = field(default_factory=dict, compare=False)
    name: str = ""
    """A name that no other cell has; the scenario's strategy if nothing is varied."""

    @cached_property
    def hash(self) -> str:
        """Hash of the scenario."""
        return self.scenario.hash

    def words_of(self, fields: Iterable[str]) -> str:
        """Write the cell's values of these fields: ``random:0.44, soft, eta 1250``; fields not varied are left out."""
        return fields_in_words({name: self.words[name] for name in fields if name in self.words})


@dataclass(frozen=True)
class Study:
    """Many runs of scenarios that differ in some fields.

    Args:
        base: a ``Scenario``, or sections of one as in its file, which may name a ``preset``.
        vary: blocks of varied fields, see ``factors``; empty: one cell.
        runs: number of runs of each cell; None if ``until`` is given.
        until: runs are added until the interval of a figure is this narrow, see ``precision``.
        seed: the seed, which is the same for all cells.
        motion: name of the source of motion.
        keep: further tables that the store saves: "samples" or nothing.
        floors: floors by name, each a list of rows of 0 and 1, or of values, the top row first; ``floor.source`` may
            name them.
        name: a title.
        folder: folder of the floor files that the study names; None: the current folder.
        command: the words of the command that continues the study, for its folder's manifest; empty: ``evaluate``.
    Raises:
        InputError: something is wrong; the message names it, and says what would be right.
    """

    base: Mapping[str, Any] | Scenario = field(default_factory=dict)
    vary: Mapping[str, Any] = field(default_factory=dict)
    runs: int | None = 100
    until: Precision | None = None
    seed: int = 1
    motion: str = "event"
    keep: tuple[str, ...] = ()
    floors: Mapping[str, Sequence[str] | Sequence[Sequence[float]]] = field(default_factory=dict)
    name: str = ""
    folder: Path | None = field(default=None, compare=False)
    command: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        """Check all fields and bring each into one form.

        The base becomes sections by name, the folder a ``Path``, ``runs`` and ``seed`` Python integers, ``keep`` and
        the rows of ``floors`` tuples. References to user code in ``vary`` and ``motion`` get the hash of the code
        (``plugins.resolve_codes``). Those in the base get it when the scenarios of the cells are made.

        The dataclass is frozen, so a field can be set only by ``object.__setattr__``.
        """
        keep_plain(self)
        if isinstance(self.base, Scenario):
            object.__setattr__(self, "base", self.base.model_dump(exclude_none=True))
        check_kind(self.base, Mapping, "base", "a scenario, or its sections by name")
        check_kind(self.vary, Mapping, "vary", "a table of blocks, such as {'grid': {field: values}}")
        check_kind(self.name, str, "name", "a text")
        check_kind(self.command, str, "command", "a text")
        check_kind(self.motion, str, "motion", "the name of a source of motion")
        check_kind(self.keep, (tuple, list), "keep", "a list of tables")
        object.__setattr__(self, "keep", tuple(self.keep))
        if self.until is not None:
            check_kind(
                self.until,
                Precision,
                "until",
                "a vibroswarm.study.precision.Precision, such as Precision(0.02)",
            )
        if self.folder is not None:
            object.__setattr__(self, "folder", Path(self.folder))
        if (self.runs is None) == (self.until is None):
            raise InputError("give either a number of runs or a precision", field="runs")
        if self.runs is not None:
            whole_number_of(self.runs, "runs", 1, MOST_RUNS)
        whole_number_of(self.seed, "seed", 0, SEED_LIMIT - 1)
        object.__setattr__(self, "floors", _checked_floors(self.floors))
        object.__setattr__(self, "vary", {k: plugins.resolve_codes(v) for k, v in self.vary.items()})
        if plugins.is_code(self.motion):
            object.__setattr__(self, "motion", plugins.resolve_code("motion", self.motion))
        else:
            source(self.motion)  # raises if there is no such source
        for table in self.keep:
            check_choice(table, "keep", KEEP)
        has_all_sections = set(Scenario.model_fields) <= set(self._sections)
        # A base with all sections sets all fields, so that a varied preset would change nothing.
        if has_all_sections and any(PRESET in point for point in self._points):
            raise InputError(
                "a complete scenario overrides every preset; give only the fields that are the same in all cells",
                field=PRESET,
            )
        for cell in self.cells:
            # The value is not used: the call raises if robots cannot test their readings against this boundary, so that
            # the user learns it before any simulation.
            readings_boundary(cell.scenario)

    @classmethod
    def of(cls, scenario: Scenario, runs: int = 100, seed: int = 1, **grid: Iterable[Any]) -> Study:
        """Make a study of a scenario with every combination of some values.

        Args:
            scenario: gives the fields that are not varied. runs: of each cell. seed: of all cells.
            grid: the values of each varied field; the dot of the field's name is written as two underscores:
                ``strategy__name=["none", "soft"]``.
        Raises:
            InputError: an unknown field, one that changes nothing in any cell, or a value that is wrong.
        """
        for name, values in grid.items():
            # A set has no order of its own, so cells would have other numbers in another process.
            if isinstance(values, str | bytes | Mapping | set | frozenset) or not isinstance(
                values, Iterable
            ):
                raise InputError(f"{shown(values)} is not a list of values", field=name.replace("__", "."))
        vary = {name.replace("__", "."): list(values) for name, values in grid.items()}
        study = cls(base=scenario, vary={"grid": vary} if vary else {}, runs=runs, seed=seed)
        study.check_effects()
        return study

    def check_effects(self) -> None:
        """Refuse varied fields of a strategy, network or other entry that no cell selects: its cells would be equal.

        Raises:
            InputError: there is such a field.
        """
        refuse_without_effect(self.varied, (cell.scenario for cell in self.cells))

    @classmethod
    def of_scenarios(
        cls,
        scenarios: Mapping[str, Scenario],
        runs: int = 100,
        seed: int = 1,
        *,
        base: Scenario | None = None,
        motion: str = "event",
        name: str = "",
    ) -> Study:
        """Make a study with these scenarios as cells, in order.

        Args:
            scenarios: by label. runs: of each cell. seed: of all cells. motion: name of the source of motion.
            base: the cells' varied fields are those in which they differ from it; by default the first scenario.
            name: a title.
        Raises:
            InputError: a field that has a default is None in a scenario, or ``Study`` refuses a value.
        """
        check_kind(scenarios, Mapping, "scenarios", "a table of scenarios by label")
        if not scenarios:
            raise InputError("is empty; give at least one", field="scenarios")
        for label, scenario in scenarios.items():
            if label == "":
                raise InputError("a label is empty; give each scenario one", field="scenarios")
            check_kind(scenario, Scenario, f"scenarios: {label}", "a Scenario")
        base = next(iter(scenarios.values())) if base is None else base
        check_kind(base, Scenario, "base", "a Scenario")
        sections = base.model_dump(exclude_none=True)
        changed = {label: changes(scenario, base) for label, scenario in scenarios.items()}
        # A point cannot set a field to None, so the base has no value of a field that is None in a scenario, and the
        # points of the others set it.
        unset = {name for values in changed.values() for name, value in values.items() if value is None}
        for name_of_field in unset:
            section, _, last = name_of_field.partition(".")
            sections.get(section, {}).pop(last, None)
        points: list[Point] = []
        for label, values in changed.items():
            values |= {name: scenarios[label][name] for name in unset}
            points.append({LABEL: label} | {k: value for k, value in values.items() if value is not None})
        # The points have the tiles too (``floor.tiles``). But a study looks up each ``floor.source`` of its points, and
        # refuses an unknown name, unless ``floors`` defines it. Names of random floors must not be defined there.
        own = [one.floor for one in scenarios.values() if not is_generated(one.floor.source)]
        floors = {floor.source: rows for floor in own if (rows := floor.tiles or floor.values) is not None}
        study = cls(sections, {"list": points}, runs, seed=seed, motion=motion, floors=floors, name=name)
        for cell, (label, scenario) in zip(study.cells, scenarios.items(), strict=True):
            if cell.scenario != scenario:
                raise InputError("sets a field to None that has a default", field=label)
        return study

    @classmethod
    def from_toml(cls, text: str, *, name: str = "study", folder: str | Path | None = None) -> Study:
        """Read a study from TOML text.

        Args:
            text: TOML. name: what errors call the text.
            folder: where the floor files and the code files are that the study names.
        Raises:
            InputError: the text is not TOML, or something in it is wrong; the message names it.
        """
        check_kind(text, str, name, "TOML text")
        return cls.from_values(parsed_toml(text, name), name=name, folder=folder)

    @classmethod
    def from_values(
        cls, values: Mapping[str, Any], *, name: str = "study", folder: str | Path | None = None
    ) -> Study:
        """Make a study from the values of its TOML.

        Args:
            values: the tables and keys. name: what errors call the study.
            folder: where the floor files and the code files are that the study names.
        Raises:
            InputError: something is wrong; the message names it, and says what would be right.
        """
        check_kind(values, Mapping, name, "a table of values")
        folder = None if folder is None else Path(folder)
        with plugins.search_beside(folder):
            return cls._from_values(values, name, folder)

    @classmethod
    def _from_values(cls, values: Mapping[str, Any], name: str, folder: str | Path | None) -> Study:
        """Build a study from the values of its TOML, with the arguments of ``from_values``."""
        blocks = {key: plugins.resolve_codes(values[key]) for key in values if key in BLOCKS}
        for key, value in values.items():
            if key in Scenario.model_fields and isinstance(value, Mapping):
                raise InputError(
                    f"belongs to a scenario: write [scenario.{key}], or give a scenario's file by --scenario",
                    field=key,
                )
        check_names(values, KEYS, "key")
        if (found := values.get("format", FORMAT)) != FORMAT:
            raise InputError(f"is of format {found}; this version reads format {FORMAT}", field=name)
        base = values.get("scenario", {})
        if isinstance(base, str):
            base = Scenario.read(Path(folder or ".") / base).model_dump(exclude_none=True)
        elif isinstance(base, Mapping):
            base = plugins.resolve_codes(base)  # loads its code, so that the code's parameters may be varied
        else:
            raise InputError(
                "must be a table, as in a scenario file, or the name of such a file", field="scenario"
            )
        until = values.get("until")
        precision = None
        if until is not None:
            precision = Precision.from_words(until, *(values.get(key) for key in OF_UNTIL))
        elif without_until := [key for key in OF_UNTIL if key in values]:
            raise InputError(
                "is used only together with 'until'; add 'until', or remove this", field=without_until[0]
            )
        return cls(
            base=base,
            vary=blocks,
            # A study with a precision has no number of runs; any other has 100 unless it says otherwise.
            runs=values.get("runs", None if until is not None else 100),
            until=precision,
            seed=values.get("seed", 1),
            motion=values.get("motion", "event"),
            keep=values.get("keep", ()),
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
        path = Path(path)
        with in_file(path):
            study = cls.from_toml(read_text(path, "a study", filled=True), name=str(path), folder=path.parent)
            study.check_effects()
            return study

    def to_toml(self) -> str:
        """Write the study as TOML; ``from_toml`` reads one with the same cells, runs and seed.

        The text includes floors from files and, but for a few cases (``_whole_base``), all fields of the scenario, so
        that it depends neither on floor files nor on defaults. Of user code it has only the file's name and hash.
        """
        return self._toml

    @cached_property
    def _toml(self) -> str:
        """The text of ``to_toml``; ``name``, ``motion``, ``keep`` and ``floors`` are left out if they are the default.

        Of ``runs`` and ``until``, the one that the study has is written.
        """
        values: dict[str, Any] = {"format": FORMAT, "seed": self.seed}
        values |= {"name": self.name} if self.name else {}
        values |= {"runs": self.runs} if self.until is None else self.until.as_values()
        values |= {"motion": self.motion} if self.motion != "event" else {}
        values |= {"keep": list(self.keep)} if self.keep else {}
        floors = {
            name: [row if isinstance(row, str) else list(row) for row in rows]
            for name, rows in self._named_floors.items()
        }
        values |= {"scenario": self._with_tables(self._whole_base)} | ({"floors": floors} if floors else {})
        return as_toml(values | dict(self.vary))

    def _with_tables(self, base: dict[str, Any]) -> dict[str, Any]:
        """Return a copy of a base, with the default parameters of the user code that cells name added to it.

        A program that reads the study's text without loading the user code does not know the code's defaults. The text
        therefore includes the defaults, so that such a program reads the same cells.

        Args:
            base: sections of a scenario, by name. A table of parameters that it already has stays as it is.
        """
        sections = copy_of(base)
        for cell in self.cells:
            # ``part`` is the chosen strategy, network or task; ``part.kind`` is its section, such as "strategy".
            for part in cell.scenario.choices:
                if part.code is not None:  # user code
                    section = sections.setdefault(part.kind, {})
                    section.setdefault(part.selected, part.entry.params().model_dump())
        return sections

    def with_runs(self, runs: int) -> Study:
        """Return the same study with this number of runs per cell instead of its own number or precision."""
        return replace(self, runs=runs, until=None)

    @cached_property
    def cells(self) -> tuple[Cell, ...]:
        """One cell for each combination of varied values, in the order of ``factors.points_of``; numbered from 0."""
        points = self._points
        scenarios = [self._scenario(point) for point in points]
        words_of_cells = words_of_points(points)
        names = names_of(words_of_cells, [scenario.strategy.name for scenario in scenarios])
        return tuple(
            Cell(number=number, point=point, scenario=scenario, words=words, name=name)
            for number, (point, scenario, words, name) in enumerate(
                zip(points, scenarios, words_of_cells, names, strict=True)
            )
        )

    def run(
        self, folder: str | Path | None = None, *, progress: Progress | bool = True, **how: Any
    ) -> StudyResult:
        """Run the study, or continue it.

        Args:
            folder: where the study is saved; by default a temporary folder, which is removed with the result.
            progress: whether a bar is shown in a terminal or notebook; or a function that is called with the progress.
            how: ``executor``, ``workers``, ``job``, ``mixed``, ``allow_failures``, see ``run.run``.
        Raises:
            InputError: the folder is of another study, or was changed. RunError: runs failed, or workers are gone.
        """
        result: StudyResult = study_verbs().run_with_bar(self, folder, progress, how)
        return result

    @cached_property
    def varied(self) -> list[str]:
        """The varied fields, in order of first use."""
        return list(dict.fromkeys(name for cell in self.cells for name in cell.point))

    @cached_property
    def codes(self) -> tuple[str, ...]:
        """User code that its cells or its motion need, as ``plugins`` names it.

        The name of a built-in source of motion is included too; ``plugins.texts_of`` leaves it out, as it is no code.
        """
        return tuple(sorted({self.motion, *(code for cell in self.cells for code in cell.scenario.codes)}))

    @cached_property
    def hash(self) -> str:
        """16 hexadecimal digits that identify a study: studies with the same hash give the same tables of their runs.

        They depend on the cells (scenarios, varied values and labels), seed, source of motion and saved tables, but not
        on the number of runs, the precision and the study's name.
        """
        data = [FORMAT, self.seed, self.motion, sorted(self.keep), [c.hash for c in self.cells]]
        points = [sorted((k, repr(v)) for k, v in c.point.items()) for c in self.cells]
        if len({cell.scenario.run.t_end_s for cell in self.cells}) > 1:
            # The runs of the cells end at different times. Earlier versions put such cells into different groups, so
            # their groups have other numbers than here. The text makes the hash differ from that of earlier versions,
            # so that none of their shards is read as a shard of this version.
            data.append("one motion for several ends")
        return hashlib.sha256(json.dumps([data, points]).encode()).hexdigest()[:16]

    @cached_property
    def _named_floors(self) -> dict[str, Rows]:
        """Rows of the floors that the study defines or reads from files, by name.

        Random floors and patterns are not among them: their name alone describes them. Any other floor that the base or
        a point names, and the study does not define, is a file in the study's folder or else in the working folder.

        Raises:
            InputError: there is no such file, or it is no floor.
        """
        floors = _checked_floors(self.floors)
        floor_section = self._sections.get("floor", {})
        if not isinstance(floor_section, Mapping) or not OF_ROWS.isdisjoint(floor_section):
            floor_section = {}  # its tiles are given, so its name is not looked up
        # A point with tiles of its own needs no floor of that name.
        of_points = [
            point.get(SOURCE)
            for point in self._points
            if point.keys().isdisjoint(f"floor.{name}" for name in OF_ROWS)
        ]
        for name in [floor_section.get("source"), *of_points]:
            if (
                isinstance(name, str)
                and name not in floors
                and not is_generated(name)
                and family(name) is None
            ):
                floors[name] = self._rows_in_file(name, floor_section)
        return floors

    def _rows_in_file(self, name: str, floor_section: Mapping[str, Any]) -> Rows:
        """Return the rows of a floor file; ``floor_section``: of the base."""
        # The shape that the floor must have, if the base gives it; None: any shape.
        rows, columns = floor_section.get("rows"), floor_section.get("columns")
        shape = (rows, columns) if isinstance(rows, int) and isinstance(columns, int) else None
        file = beside(name, self.folder or Path())
        fields = fields_of_file(file, shape, floor_section.get("image_threshold"))
        return fields["tiles"] or fields["values"]

    @property
    def _sections(self) -> Mapping[str, Any]:
        """The base as sections; a base that was given as a scenario has been converted by ``__post_init__``."""
        assert not isinstance(self.base, Scenario)
        return self.base

    @cached_property
    def _whole_base(self) -> dict[str, Any]:
        """Return all fields of the base, so that other defaults change nothing.

        They are the given ones if presets vary, or if the base fits together only with the values that vary.
        """
        if not any(PRESET in point for point in self._points):
            with suppress(InputError):
                return self._shared_base.model_dump(exclude_none=True)
        return dict(self._sections)

    @cached_property
    def _points(self) -> list[Point]:
        """The values of the varied fields in each cell; tiles are text, since their form is in the study's hash."""
        points = points_of(self.vary)
        return [point | {TILES: rows_as_text(point[TILES])} if TILES in point else point for point in points]

    @cached_property
    def _shared_base(self) -> Scenario:
        """The base of all points that name no preset of their own."""
        return self._base({})

    def _base(self, preset: dict[str, Any], values: Mapping[str, Any] | None = None) -> Scenario:
        """Return the scenario in which a point replaces values.

        Args:
            preset: of the point, by ``PRESET``; empty: the study's own. values: that are replaced already.
        Raises:
            InputError: the scenario is invalid.
        """
        base = with_fields(copy_of(self._sections) | preset, values or {})
        # The study's own floors are put in as tiles, since the scenario cannot find them by name.
        floor = base.get("floor")
        if isinstance(floor, dict) and OF_ROWS.isdisjoint(floor):
            name = floor.get("source")
            if isinstance(name, str) and name in self._named_floors:
                floor |= fields_of_floor(self._named_floors[name])
        return Scenario.from_base(base)

    def _scenario(self, point: Point) -> Scenario:
        """Return the scenario of a cell: the base with the values of its point.

        Raises:
            InputError: the scenario is invalid; the message names the point.
        """
        values = {k: v for k, v in point.items() if k not in (PRESET, LABEL)}
        try:
            if isinstance(values.get(SOURCE), str):
                # None for a random floor or a pattern: it removes tiles of the base, which are those of another floor.
                rows = fields_of_floor(self._named_floors.get(values[SOURCE]))
                values = {f"floor.{name}": of_floor for name, of_floor in rows.items()} | values
            own = {PRESET: point[PRESET]} if PRESET in point else {}
            try:
                base = self._base(own) if own else self._shared_base
            except InputError:
                # The base alone need not fit together: its strategy may not read what its sensor tells.
                base = self._base(own, values)
            return base.with_values(values)
        except InputError as error:
            if not point:
                raise
            words = ", ".join(f"{k} = {value_in_words(v)}" for k, v in point.items())
            raise InputError(f"{error} (in the cell with {words})") from None


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
            # A name in quotes is written alike in JSON and in TOML.
            lines = (f"{json.dumps(field)} = {_inline(value)}" for field, value in flat(table).items())
            parts.append("\n".join([head, *lines]))
    return "\n".join(parts) + "\n"


def _inline(value: Any) -> str:
    """Write a value as TOML, as it stands after ``name =``.

    A mapping (a range) is written as an inline table. ``tomli_w`` would write it as a table of its own, which TOML puts
    after all fields of its block and so out of order.
    """
    import tomli_w

    if type(value) is int:  # numbers are written without tomli_w, which is faster
        return str(value)
    if type(value) is float and math.isfinite(value):
        return repr(value)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{name} = {_inline(part)}" for name, part in value.items()) + " }"
    return tomli_w.dumps({"v": value}).removeprefix("v = ").strip()


def copy_of(base: Mapping[str, Any]) -> dict[str, Any]:
    """Copy the base of a study: sections of a scenario by name, and possibly the name of a ``preset``.

    Each section is copied too, so that its fields can be set without changing the base. Tables within a section are
    not copied.
    """
    return {k: dict(v) if isinstance(v, Mapping) else v for k, v in base.items()}


def with_fields(base: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return a base with fields set, by dotted names such as ``strategy.soft.eta``; None leaves a field out.

    Raises:
        InputError: a section of the base is no table.
    """
    found = dict(base)
    for name, value in values.items():
        *tables, last = name.split(".")
        part = found
        for at, table in enumerate(tables, 1):
            check_kind(part.get(table, {}), Mapping, ".".join(tables[:at]), "a table of fields")
            part[table] = part = dict(part.get(table, {}))
        part.pop(last, None)
        if value is not None:  # which a study's base cannot hold: TOML has no such value
            part[last] = value
    return found


def _checked_floors(values: Any) -> dict[str, Rows]:
    """Return the floors of a study by name. That rows consist of kinds or values is checked when a cell uses them."""
    check_kind(values, Mapping, "floors", "a table of floors by name")
    return {name: _checked_rows(name, rows) for name, rows in values.items()}


def _checked_rows(name: str, rows: Any) -> Rows:
    if is_generated(name) or family(name) is not None:
        raise InputError(
            "is the name of a pattern or of a random floor; give this one a name of its own",
            field=f"floors.{name}",
        )
    rows = rows_as_text(rows)
    if isinstance(rows, list | tuple):
        if all(isinstance(row, str) for row in rows):
            return tuple(rows)
        if all(isinstance(row, list | tuple) for row in rows):
            return tuple(map(tuple, rows))
    raise InputError(
        "must be a list of rows of 0 and 1, or of rows of values, the top row first", field=f"floors.{name}"
    )


def fields_of_floor(rows: Rows | None) -> dict[str, Rows | None]:
    """Return the fields of a scenario's floor that hold its rows; None without rows, for a floor that its name says."""
    has_values = rows is not None and any(not isinstance(row, str) for row in rows)
    return {"tiles": None if has_values else rows, "values": rows if has_values else None}
