"""Scenarios: frozen, validated, hashable, TOML in and out; and the names of their fields.

A scenario consists of the sections of ``fields``. Every default is what the paper's simulations really did
(preset ``paper``), so a scenario file need only give what differs.

Names of fields are attributes, which sessions complete: ``vibroswarm.fields.swarm.robots`` is "swarm.robots". They
stand wherever a dotted name does: ``scenario.with_values({fields.swarm.robots: 8})``.
"""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final, Self

from pydantic import BaseModel, ValidationError, model_validator

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.rng import SEED_LIMIT
from vibroswarm.core.untrusted_files import read_text
from vibroswarm.errors import InputError, check_kind, nearest, path_of, shown, whole_number_of
from vibroswarm.floors.floor import Floor
from vibroswarm.floors.source import family, is_random, resolve
from vibroswarm.scenario import plugins, validation
from vibroswarm.scenario.choices import Choice, field_error
from vibroswarm.scenario.fields import Sections
from vibroswarm.scenario.presets import preset_text

SCHEMA_VERSION = 2


class Scenario(Sections, NotebookView):
    """One inspection: arena, floor, swarm, robot, sensing, strategy, decision, network, task, duration.

    Raises (through ``read``, ``from_toml`` and ``with_values``):
        InputError: naming the field, its value and what would be right.
    """

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for check in validation.ALL:
            check(self)
        return self

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> Scenario:
        """Build a scenario from nested mappings, as TOML gives them; omitted fields are as in preset ``paper``.

        Args:
            values: section to field to value.
        Raises:
            InputError: an unknown field, or a value that is wrong.
        """
        check_kind(values, (Mapping, Scenario), "scenario", "sections by name")
        try:
            return cls.model_validate(dict(values))
        except ValidationError as error:
            raise field_error(error, _nearest_field) from None

    @classmethod
    def from_toml(cls, text: str, *, name: str = "scenario", folder: str | Path | None = None) -> Scenario:
        """Parse a scenario from TOML text; ``preset = "text"`` at the top makes that preset the base.

        Args:
            text: TOML. name: what errors call it.
            folder: ``floor.source`` may also name a floor file in this folder; its tiles are taken into the
                scenario (``floor.rows`` and ``floor.columns`` are those of a coordinate list).
        Raises:
            InputError: not TOML, or a field, a value or a floor that is wrong.
        """
        check_kind(text, str, name, "TOML text")
        try:
            values = tomllib.loads(text)
        except (ValueError, RecursionError) as error:  # not TOML, or a number with thousands of digits
            raise InputError(f"is not TOML: {error}", field=name) from None
        if folder is not None:
            _read_floor_file(values, Path(folder))
        with plugins.search_beside(folder):
            return cls.from_base(values)

    @classmethod
    def from_base(cls, values: Mapping[str, Any]) -> Scenario:
        """Build a scenario as ``from_values`` does; ``preset = "text"`` among the ``values`` makes that preset the
        base.

        Raises:
            InputError: an unknown preset or field, or a value that is wrong.
        """
        check_kind(values, (Mapping, Scenario), "scenario", "sections by name")
        values = dict(values)
        base = values.pop("preset", None)
        if base is None:
            return cls.from_values(values)
        if not isinstance(base, str):
            raise InputError(f"{base!r} is not the name of a preset", field="preset")
        merged = preset(base).model_dump(exclude_none=True)
        for section, fields in values.items():
            if isinstance(fields, dict) and isinstance(merged.get(section), dict):
                if section == "floor" and fields.get("tiles") is not None and "tiles" not in merged[section]:
                    merged[section].pop("source")  # the floor of that name is replaced
                merged[section] = _merged(merged[section], fields)
            else:
                merged[section] = fields
        return cls.from_values(merged)

    @classmethod
    def read(cls, path: str | Path) -> Scenario:
        """Read a scenario from the TOML file ``path``; a floor file that it names is looked for beside it.

        Raises:
            InputError: it cannot be read, or something in it is wrong.
        """
        path = path_of(path)
        text = read_text(path, "a scenario")
        return cls.from_toml(text, name=str(path), folder=path.parent)

    def to_toml(self) -> str:
        """Return the whole scenario as TOML; ``from_toml`` gives back an equal one."""
        import tomli_w

        return tomli_w.dumps(_without_empty(self.model_dump(mode="python", exclude_none=True)))

    def with_values(self, values: Mapping[str, Any]) -> Scenario:
        """Return a copy with some fields replaced.

        Args:
            values: by dotted name: ``{"walk.leg_min_ms": 500}``.
        Raises:
            InputError: an unknown field (the nearest is named), or a value that is wrong.
        """
        check_kind(values, Mapping, "values", "a table of values by dotted name")
        data = self.model_dump(exclude_none=True)
        for name, value in values.items():
            check_kind(name, str, "values", "the dotted name of a field")
            section, _, field = name.partition(".")
            if not field and section in data:
                raise InputError(
                    f"is a section; name one of its fields, such as {next(iter(data[section]))}", field=name
                )
            if not field or not isinstance(data.get(section), dict):
                raise InputError(f"there is no such field{_nearest_field(name)}", field=name)
            *tables, last = field.split(".")
            place = data[section]
            for table in tables:
                place = place.setdefault(table, {})
                if not isinstance(place, dict):
                    raise InputError(f"there is no such field{_nearest_field(name)}", field=name)
            if value is None:
                place.pop(last, None)
            elif type(value) is int and isinstance(place.get(last), float) and abs(value) <= 2**53:
                place[last] = float(value)  # also for code that is not loaded, whose types are unknown
            else:
                place[last] = value
        if (
            values.get("floor.tiles") is not None
            and "floor.source" not in values
            and self.floor.tiles is None
        ):
            data["floor"].pop("source")  # the floor of that name is replaced
        return Scenario.from_values(data)

    def __repr__(self) -> str:
        robots, task = self.swarm.robots, self.task.name
        parts = [
            f"{robots} robot{'s' * (robots != 1)}",
            self.strategy.name,
            f"floor {shown(self.floor.source)}",
            f"{self.arena.width_m:g} m x {self.arena.height_m:g} m",
            *([] if task == "fill_ratio" else [f"task {task}"]),
            f"up to {self.run.t_end_s:g} s",
        ]
        return f"Scenario({', '.join(parts)})"

    __str__ = __repr__

    def __getitem__(self, name: str) -> Any:
        """Return the value of a field, by its dotted name: ``scenario["walk.leg_min_ms"]``."""
        return value_of(self, name)

    def _ipython_key_completions_(self) -> list[str]:
        """Return what a notebook offers after ``scenario["``."""
        return field_names()

    def floor_for(self, seed: int, run: int) -> Floor:
        """Return the floor of ``run``: fixed, or the random one of (seed, run).

        Raises:
            InputError: the ``seed`` or ``run`` is no whole number, or out of range.
        """
        seed, run = (
            whole_number_of(seed, "seed", 0, SEED_LIMIT - 1),
            whole_number_of(run, "run", 0, 2**32 - 1),
        )
        return self.floor.placed_in(self.arena, seed, run)

    @property
    def hash(self) -> str:
        """16 hexadecimal digits that change with any field, and with nothing else."""
        data = {"schema": SCHEMA_VERSION, **_without_empty(self.model_dump(mode="json", exclude_none=True))}
        data |= {choice.kind: choice.effective for choice in self.choices}
        text = json.dumps(_infinite_as_text(data), sort_keys=True, separators=(",", ":"), allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def choices(self) -> tuple[Choice, ...]:
        """Sections that select an entry by name: strategy, network and task."""
        return tuple(
            section for name in type(self).model_fields if isinstance(section := getattr(self, name), Choice)
        )

    @property
    def codes(self) -> tuple[str, ...]:
        """Users' files that it needs, as ``plugins`` names them."""
        return tuple(choice.code for choice in self.choices if choice.code is not None)


def _without_empty(sections: dict[str, Any]) -> dict[str, Any]:
    """Return the sections that are not empty: one in which all fields are optional and unset must not change a hash."""
    return {name: fields for name, fields in sections.items() if fields != {}}


def preset(name: str) -> Scenario:
    """Return the preset of that name.

    Raises:
        InputError: there is no such preset; the nearest is named.
    """
    check_kind(name, str, "preset", "the name of a preset")
    return _preset(name)


@cache
def _preset(name: str) -> Scenario:
    return Scenario.from_toml(preset_text(name), name=name)


def field_names() -> list[str]:
    """Return the dotted names of all fields."""
    names_of = []
    for section, info in Scenario.model_fields.items():
        kind: Any = info.annotation
        names = kind.field_names() if issubclass(kind, Choice) else list(kind.model_fields)
        names_of += [f"{section}.{name}" for name in names]
    return names_of


def value_of(scenario: Scenario, name: str) -> Any:
    """Return the value of a field, by its dotted name.

    Raises:
        InputError: there is no such field.
    """
    check_kind(name, str, "field", "the dotted name of a field")
    section, _, field = name.partition(".")
    node = getattr(scenario, section, None)
    table, separator, last = field.partition(".")
    if isinstance(node, Choice) and separator:
        node, field = node.table(table), last
    if isinstance(node, Mapping):
        return node.get(field)
    if not isinstance(node, BaseModel) or not hasattr(node, field):
        raise InputError(f"there is no such field{_nearest_field(name)}", field=name)
    return getattr(node, field)


def kind_of(name: str) -> Any:
    """Return the type of a field, by its dotted name; None if there is no such field."""
    section, _, field = name.partition(".")
    if name not in field_names():
        return None
    kind: Any = Scenario.model_fields[section].annotation
    return kind.kind_of(field) if issubclass(kind, Choice) else kind.model_fields[field].annotation


def _infinite_as_text(data: Any) -> Any:
    """Return JSON data in which an infinite number, as a range may be, is a text."""
    if isinstance(data, dict):
        return {key: _infinite_as_text(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_infinite_as_text(value) for value in data]
    return str(data) if isinstance(data, float) and math.isinf(data) else data


def _merged(base: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Return one table overlaid with another, nested tables included."""
    merged = dict(base)
    for key, value in more.items():
        nested = merged.get(key)
        both = isinstance(nested, Mapping) and isinstance(value, Mapping)
        merged[key] = _merged(nested, value) if both else value  # type: ignore[arg-type]
    return merged


def parse_setting(text: str) -> tuple[str, Any]:
    """Parse ``"walk.leg_min_ms=500"`` into name and value; the value is TOML, or a bare word."""
    name, separator, value = text.partition("=")
    if not separator or not name.strip():
        raise InputError(f"'{text}' is not of the form section.field=value", field="--set")
    try:
        parsed = tomllib.loads(f"value = {value.strip()}")
    except (ValueError, RecursionError):  # not TOML, or a number with thousands of digits
        return name.strip(), value.strip()
    if set(parsed) != {"value"}:
        raise InputError(f"'{text}' sets more than one value", field="--set")
    return name.strip(), parsed["value"]


def _read_floor_file(values: dict[str, Any], folder: Path) -> None:
    """Replace a floor file named by ``floor.source`` by its tiles."""
    floor = values.get("floor")
    if not isinstance(floor, dict) or "tiles" in floor or not isinstance(floor.get("source"), str):
        return
    source = floor["source"]
    if is_random(source) or family(source) is not None:
        return
    size = (floor.get("rows"), floor.get("columns"))
    shape = size if isinstance(size[0], int) and isinstance(size[1], int) else None
    path = folder / source
    grid, name = resolve(str(path) if path.is_file() else source, shape)  # type: ignore[arg-type]
    floor["source"] = name
    floor["tiles"] = tuple("".join("1" if tile else "0" for tile in row) for row in grid)


def _nearest_field(name: str) -> str:
    """Suggest the field that an unknown name may mean."""
    known = field_names()
    last = name.rpartition(".")[2]
    same = [k for k in known if k.rpartition(".")[2] == last] or [
        k for k in known if last in k.split(".")[1:-1]
    ]
    return f", did you mean '{same[0]}'?" if same else nearest(name, known + list(Scenario.model_fields))


class FieldNames(NotebookView):
    """The fields below a section, or all: each attribute is a dotted name, or the fields below it.

    Args:
        section: dotted name; empty: all sections.
    """

    __slots__ = ("_section",)

    def __init__(self, section: str = "") -> None:
        self._section = section

    def _below(self) -> list[str]:
        """Return the dotted names below this section, without it."""
        start = f"{self._section}." if self._section else ""
        return [name.removeprefix(start) for name in field_names() if name.startswith(start)]

    def __dir__(self) -> list[str]:
        return list(dict.fromkeys(name.partition(".")[0] for name in self._below()))

    def __getattr__(self, name: str) -> str | FieldNames:
        """Return the dotted name of a field, or the fields of a section.

        Raises:
            AttributeError: there is none; the nearest is named.
        """
        below = [] if name.startswith("_") else self._below()
        full = f"{self._section}.{name}" if self._section else name
        if name in below:
            return full
        if any(known.startswith(f"{name}.") for known in below):
            return FieldNames(full)
        raise AttributeError(f"there is no field {full!r}{nearest(name, dir(self)) if below else ''}")

    def __repr__(self) -> str:
        return f"FieldNames({self._section or 'all'}: {len(self._below())} fields)"


fields: Final = FieldNames()
"""All fields of a scenario: ``fields.walk.leg_min_ms`` is "walk.leg_min_ms"."""
