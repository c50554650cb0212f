"""Scenarios: frozen, validated and hashable, read from and written as TOML.

A scenario consists of the sections of the module ``fields``. Every default is what the paper's simulations really did
(preset ``paper``), so a scenario file need only give what differs.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Self

from pydantic import BaseModel, ValidationError, model_validator

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.numbers import count, stated
from vibroswarm.core.rng import SEED_LIMIT
from vibroswarm.core.untrusted_files import parsed_toml, read_text
from vibroswarm.errors import (
    InputError,
    check_kind,
    in_file,
    nearest,
    plain_value,
    shown,
    whole_number_of,
)
from vibroswarm.floors.floor import Floor
from vibroswarm.floors.io import is_picture
from vibroswarm.floors.source import beside, family, fields_of_file, is_generated, parts_of_file
from vibroswarm.scenario import plugins, validation
from vibroswarm.scenario.choices import Choice, field_error
from vibroswarm.scenario.fields import Sections
from vibroswarm.scenario.presets import preset_text

SCHEMA_VERSION = 3
"""Version of the fields of scenarios; it is part of their hashes."""


class Scenario(Sections, NotebookView):
    """One inspection: arena, floor, swarm, robot, sensing, strategy, decision, network, task, duration.

    Raises:
        InputError: a value is wrong; names the field, its value and what would be right.
    """

    def __init__(self, **sections: Any) -> None:
        """Build a scenario from its sections by name."""
        with _as_input_error():
            super().__init__(**sections)

    # Pydantic validates without calling it, as without an ``__init__`` of our own: half of the time.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        """Run all checks across fields.

        If one fails, Pydantic wraps its ``InputError`` in a ``ValidationError``, from which ``field_error`` gets it.
        """
        for check in validation.ALL:
            check(self)
        return self

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> Scenario:
        """Build a scenario from nested mappings, as TOML gives them; omitted fields are as in preset ``paper``.

        Args:
            values: {section: {field: value}}, or a scenario.
        Raises:
            InputError: there is no such field, or a value is wrong.
        """
        check_kind(values, (Mapping, Scenario), "scenario", "sections by name")
        with _as_input_error():
            return cls.model_validate(plain_value(dict(values)))

    @classmethod
    def from_toml(cls, text: str, *, name: str = "scenario", folder: str | Path | None = None) -> Scenario:
        """Build a scenario from TOML text; ``preset = "NAME"`` at the top makes another preset than ``paper`` the base.

        Args:
            text: TOML. name: what errors call the text.
            folder: ``floor.source`` may also name a floor file in this folder, and trusted code is looked for there.
                The tiles of the floor file become part of the scenario. If the file is a list of coordinates,
                ``floor.rows`` and ``floor.columns`` are its numbers of rows and columns.
        Raises:
            InputError: the text is not TOML, there is no such field, or a value or the floor is wrong.
        """
        check_kind(text, str, name, "TOML text")
        values = parsed_toml(text, name)
        picture = None if folder is None else _read_floor_file(values, Path(folder))
        with plugins.search_beside(folder):
            scenario = cls.from_base(values)
        if picture is not None:
            check_pixel_tiles(scenario, picture)
        return scenario

    @classmethod
    def from_base(cls, values: Mapping[str, Any]) -> Scenario:
        """Build a scenario from nested mappings; ``"preset": "NAME"`` makes another preset than ``paper`` the base.

        Args:
            values: {section: {field: value}}, and perhaps {"preset": name}; or a scenario.
        Raises:
            InputError: there is no such preset or field, or a value is wrong.
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
                # Tiles replace the preset's floor, so its name goes too. If the preset has tiles as well, the name is
                # that of tiles, and stays.
                own = any(fields.get(name) is not None for name in ("tiles", "values"))
                if section == "floor" and own and "tiles" not in merged[section]:
                    merged[section].pop("source")
                merged[section] = _merged(merged[section], fields)
            else:
                merged[section] = fields
        return cls.from_values(merged)

    @classmethod
    def read(cls, path: str | Path) -> Scenario:
        """Read a scenario from the TOML file ``path``; a floor file that it names is looked for in the same folder.

        Raises:
            InputError: the file cannot be read, or something in it is wrong.
        """
        path = Path(path)
        text = read_text(path, "a scenario", filled=True)
        with in_file(path):
            return cls.from_toml(text, name=str(path), folder=path.parent)

    def to_toml(self) -> str:
        """Return the whole scenario as TOML; ``from_toml`` gives back an equal one."""
        import tomli_w

        return tomli_w.dumps(_without_empty(self.model_dump(mode="python", exclude_none=True)))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the scenario as TOML, with the users' files that it needs, for processes without them."""
        return _unpickled, (self.to_toml(), plugins.texts_of(self.codes))

    def with_values(self, values: Mapping[str, Any]) -> Scenario:
        """Return a copy with some fields replaced.

        Args:
            values: new values by dotted name: ``{"walk.leg_min_ms": 500}``, also numbers of NumPy; None resets a field
                to its default.
        Raises:
            InputError: there is no such field (the nearest is suggested), or a value is wrong.
        """
        check_kind(values, Mapping, "values", "a table of values by dotted name")
        # Sections that stay are not checked again, except choices: the code of the selected entry may be loaded since.
        data: dict[str, Any] = {section: getattr(self, section) for section in type(self).model_fields}
        is_changed = {str(name).partition(".")[0] for name in values}
        data |= self.model_dump(
            include={
                name for name, section in data.items() if name in is_changed or isinstance(section, Choice)
            },
            exclude_none=True,
        )
        for name, value in values.items():
            section, _, field = name.partition(".")
            if name in data:
                raise _is_section(name)
            value = plain_value(value)
            *tables, last = field.split(".")
            parent = data.get(section)
            for table in tables:
                # The scenario may have no table of parameters of this strategy yet. If there is no such strategy,
                # ``from_values`` refuses the table.
                parent = parent.setdefault(table, {}) if isinstance(parent, dict) else None
            is_of_code = bool(tables) and plugins.is_code_name(tables[0])  # whose fields are not known
            is_known = name in field_names() or is_of_code
            if (
                not last
                or not isinstance(parent, dict)
                or (value is None and last not in parent and not is_known)
            ):
                raise InputError(f"there is no such field{nearest_field(name)}", field=name)
            if value is None:
                parent.pop(last, None)
            elif type(value) is int and isinstance(parent.get(last), float) and abs(value) <= 2**53:
                # A field whose value is a float takes integers as floats, so that 2 and 2.0 give the same scenario.
                # Pydantic does this for declared fields. Parameters of a strategy whose file is not loaded have no
                # declared types; their present value shows the type. Integers up to 2^53 are exact as floats.
                parent[last] = float(value)
            else:
                parent[last] = value
        if (
            (values.get("floor.tiles") is not None or values.get("floor.values") is not None)
            and "floor.source" not in values
            and self.floor.is_named
        ):
            # Tiles replace this scenario's floor, so its name goes too; a name of earlier tiles stays.
            data["floor"].pop("source")
        return Scenario.from_values(data)

    def __repr__(self) -> str:
        """Return a summary in one line; the task is named only if it is not ``fill_ratio``."""
        robots, task = self.swarm.robots, self.task.name
        parts = [
            count(robots, "robot"),
            self.strategy.name,
            f"floor {shown(self.floor.source)}",
            f"{stated(self.arena.width_m)} m x {stated(self.arena.height_m)} m",
            *([] if task == "fill_ratio" else [f"task {task}"]),
            f"up to {stated(self.run.t_end_s)} s",
        ]
        return f"Scenario({', '.join(parts)})"

    __str__ = __repr__

    def __getitem__(self, name: str) -> Any:
        """Return the value of a field, by its dotted name: ``scenario["walk.leg_min_ms"]``."""
        return value_of(self, name)

    def floor_for(self, seed: int, run: int) -> Floor:
        """Return the floor of ``run``: a fixed floor, or the random floor of (seed, run), with its changes.

        Raises:
            InputError: ``seed`` or ``run`` is not a whole number, or is out of range.
        """
        seed, run = (
            whole_number_of(seed, "seed", 0, SEED_LIMIT - 1),
            whole_number_of(run, "run", 0, 2**32 - 1),
        )
        floor = self.floor.placed_in(self.arena, seed, run)
        if not self.change.is_given:
            return floor
        # With redraw = "study" all runs share the floor of run 0, and its changes.
        number = run if self.floor.redraw == "run" else 0
        changes = self.change.changes(floor, self.arena.size_m, self.run.t_end_s, seed, number)
        return replace(floor, changes=changes)

    @property
    def floors_differ(self) -> bool:
        """Whether a new floor, or new changes, are drawn for each run."""
        return self.floor.drawn_by_run or (self.floor.redraw == "run" and self.change.is_random)

    @property
    def hash(self) -> str:
        """16 hexadecimal digits that identify the scenario: they differ if any field that has an effect differs.

        Tables of strategies, networks and tasks that are not selected have no effect. A user's code is included by its
        hash.
        """
        data = {"schema": SCHEMA_VERSION, **_without_empty(self.model_dump(mode="json", exclude_none=True))}
        # In the sections of strategy, network and task, only the table of the selected entry has an effect.
        data |= {choice.kind: choice.effective for choice in self.choices}
        # "auto" has the hash of what it means. Of a user's code that is known only while the code is loaded, and the
        # hash must not depend on that.
        if self.strategy.code is None:
            data["localisation"] |= {"method": self.place_method}
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
        """References, with hash, to the users' files that the scenario needs; see ``plugins``."""
        return tuple(choice.code for choice in self.choices if choice.code is not None)


@contextmanager
def _as_input_error() -> Iterator[None]:
    """Turn Pydantic's error about a scenario into that of ``from_values``."""
    try:
        yield
    except ValidationError as error:
        raise field_error(error, nearest_field) from None


def _unpickled(text: str, files: tuple[tuple[str, str], ...]) -> Scenario:
    """Return the scenario that ``Scenario.__reduce__`` pickled."""
    plugins.install_all(files)
    return Scenario.from_toml(text)


def _without_empty(sections: dict[str, Any]) -> dict[str, Any]:
    """Return the sections that are not empty.

    A section whose fields are all optional and unset is left out, so that a new section changes no hash.
    """
    return {name: fields for name, fields in sections.items() if fields != {}}


def preset(name: str) -> Scenario:
    """Return the preset of that name.

    Raises:
        InputError: there is no such preset; the nearest name is suggested.
    """
    check_kind(name, str, "preset", "the name of a preset")
    return _preset(name)


@cache
def _preset(name: str) -> Scenario:
    """Return a preset, read once; ``preset`` checks the type first, as the cache takes hashable names only."""
    return Scenario.from_toml(preset_text(name), name=name)


def field_names() -> list[str]:
    """Return the dotted names of all fields, those of all strategies, networks and tasks included."""
    return [name for section in Scenario.model_fields for name in _names_in(section)]


def _names_in(section: str) -> list[str]:
    kind: Any = Scenario.model_fields[section].annotation
    names = kind.field_names() if issubclass(kind, Choice) else list(kind.model_fields)
    return [f"{section}.{name}" for name in names]


def value_of(scenario: Scenario, name: str) -> Any:
    """Return the value of a field, by its dotted name, such as "walk.leg_min_ms" or "strategy.soft.eta".

    Returns:
        The value. If the code of a strategy, network or task is not loaded, None for its parameters that are not given.
    Raises:
        InputError: there is no such field.
    """
    section, _, field = name.partition(".")
    node = getattr(scenario, section, None)
    table, separator, last = field.partition(".")
    if isinstance(node, Choice) and separator:  # a parameter of a strategy, network or task
        node, field = node.table(table), last
        # A mapping, and no model: the code that declares the parameters is not loaded. The mapping is empty if no
        # parameter is given, but also if there is no strategy, network or task of that name.
        if isinstance(node, Mapping) and (node or plugins.is_code_name(table)):
            return node.get(field)  # the code that declares the parameters is not loaded
    if name in Scenario.model_fields:
        raise _is_section(name)
    if not isinstance(node, BaseModel) or field not in type(node).model_fields:
        raise InputError(f"there is no such field{nearest_field(name)}", field=name)
    return getattr(node, field)


def differences(scenario: Scenario, base: Scenario) -> dict[str, Any]:
    """Return the values of the fields in which a scenario differs from a base, by dotted name.

    The values are for TOML (``--set``, a study's file): tuples become lists, and fields that are None in the scenario
    are left out. If such a field has a value in the base, the base plus the differences is not the scenario.
    """
    return {name: value for name, value in changes(scenario, base).items() if value is not None}


def changes(scenario: Scenario, base: Scenario) -> dict[str, Any]:
    """Return what ``differences`` does, and None for the fields that are None in the scenario and not in the base."""
    changed: dict[str, Any] = {}
    for section in Scenario.model_fields:
        one, other = getattr(scenario, section), getattr(base, section)
        if one == other:
            continue
        # Most strategies, networks and tasks have the same parameters in both.
        equal = (
            {table for table in type(one).known() if one.table(table) == other.table(table)}
            if isinstance(one, Choice)
            else ()
        )
        for name in _names_in(section):
            _, table, *parameter = name.split(".")
            if parameter and table in equal:
                continue
            value = value_of(scenario, name)
            if value != value_of(base, name):
                changed[name] = list(value) if isinstance(value, tuple) else value
    return changed


def kind_of(name: str) -> Any:
    """Return the type of a field, by its dotted name; None if there is no such field."""
    section, _, field = name.partition(".")
    if name not in field_names():
        return None
    kind: Any = Scenario.model_fields[section].annotation
    return kind.kind_of(field) if issubclass(kind, Choice) else kind.model_fields[field].annotation


def _infinite_as_text(data: Any) -> Any:
    """Return a copy of data in which infinite numbers, such as a radio's range, are strings: JSON has no infinity."""
    if isinstance(data, dict):
        return {key: _infinite_as_text(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_infinite_as_text(value) for value in data]
    return str(data) if isinstance(data, float) and math.isinf(data) else data


def _merged(base: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Return the table ``base`` with values replaced or added by those of ``more``; nested tables are merged too."""
    merged = dict(base)
    for key, value in more.items():
        nested = merged.get(key)
        both = isinstance(nested, Mapping) and isinstance(value, Mapping)
        merged[key] = _merged(nested, value) if both else value  # type: ignore[arg-type]
    return merged


def parse_setting(text: str) -> tuple[str, Any]:
    """Return name and value of a setting such as ``"walk.leg_min_ms=500"``.

    The value is parsed as TOML. A value that is not TOML, such as a word without quotes, is taken as a string, but .8
    and 5. as numbers.

    Raises:
        InputError: the text is not of the form section.field=value, or sets more than one value.
    """
    name, separator, value = text.partition("=")
    if not separator or not name.strip():
        raise InputError(f"'{text}' is not of the form section.field=value", field="--set")
    try:
        parsed = tomllib.loads(f"value = {value.strip()}")
    except (ValueError, RecursionError):  # not TOML or a number too long, or nested too deeply
        value = value.strip()
        is_number = re.fullmatch(r"[-+]?([0-9]+\.|\.[0-9]+)(e[-+]?[0-9]+)?", value)
        return name.strip(), float(value) if is_number else value
    if set(parsed) != {"value"}:  # the text has further lines, with settings of their own
        raise InputError(f"'{text}' sets more than one value", field="--set")
    return name.strip(), parsed["value"]


def parse_values(text: str, form: str = "section.field=value,value") -> tuple[str, list[Any]]:
    """Return name and values of a varied field such as ``"swarm.robots=3,5"``, each value as of ``parse_setting``.

    Args:
        form: what is right, for the message.
    Raises:
        InputError: the text is not of this form.
    """
    name, separator, values = text.partition("=")
    if not separator or not values.strip():
        raise InputError(f"'{text}' is not of the form {form}", field="--vary")
    return name.strip(), [parse_setting(f"{name}={value}")[1] for value in values.split(",")]


def parse_settings(texts: Iterable[str]) -> dict[str, Any]:
    """Return the values of settings by name (``parse_setting``); of one without a value, such as ``"a.b="``, None."""
    settings = {}
    for text in texts:
        name, value = parse_setting(text)
        settings[name] = value if text.partition("=")[2].strip() else None
    return settings


def _read_floor_file(values: dict[str, Any], folder: Path) -> str | None:
    """Replace, in place, a floor file that ``floor.source`` names by the file's tiles, or values of tiles, and name.

    Nothing changes if ``source`` is a pattern or a random floor, or if the floor has tiles or values already. What is
    wrong is left to later checks.

    Returns: the path of the file if it is a picture each of whose pixels became a tile, else None.

    Raises:
        InputError: there is no such file, or it is no floor.
    """
    floor = values.get("floor")
    if not isinstance(floor, dict) or not {"tiles", "values"}.isdisjoint(floor):
        return None
    source = floor.get("source")
    if not isinstance(source, str):
        return None
    if is_generated(source) or family(source) is not None:
        return None
    # Numbers of rows and columns: a file of coordinates needs them, and a picture is divided into them.
    size = (floor.get("rows"), floor.get("columns"))
    shape = size if isinstance(size[0], int) and isinstance(size[1], int) else None
    # If the folder has no such file, the source is taken as a path from the working directory; ``resolve`` raises the
    # error if there is no such file either.
    file = beside(source, folder)
    found = fields_of_file(file, shape, floor.get("image_threshold"))  # type: ignore[arg-type]
    floor.update({name: value for name, value in found.items() if value is not None})
    path = parts_of_file(file)[1]
    return path if shape is None and is_picture(path) else None


def check_pixel_tiles(scenario: Scenario, picture: str) -> None:
    """Refuse a picture whose pixels became tiles that are smaller than a robot: it was hardly drawn pixel by pixel.

    Args:
        scenario: with the tiles of the picture. picture: its path, for the message.
    Raises:
        InputError: a tile is narrower or lower than a robot's body.
    """
    floor = scenario.floor_for(seed=0, run=0)
    body_m = 2.0 * scenario.robot.body_radius_m
    if min(floor.tile_width_m, floor.tile_height_m) < body_m:
        rows, columns = floor.tiles.shape
        raise InputError(
            f"has {rows} x {columns} pixels, and one tile each would be {1000 * floor.tile_width_m:.3g} mm x "
            f"{1000 * floor.tile_height_m:.3g} mm, smaller than a robot ({1000 * body_m:.3g} mm); add --tiles "
            f"ROWSxCOLUMNS (in a file, floor.rows and floor.columns), or {rows}x{columns} if this is meant",
            field=picture,
        )


def _is_section(name: str) -> InputError:
    first = next(field for field in field_names() if field.startswith(f"{name}."))
    return InputError(f"is a section; name one of its fields, such as {first}", field=name)


def nearest_field(name: str, also: Iterable[str] = ()) -> str:
    """Return a suggestion such as ", did you mean 'x'?" for an unknown dotted name, or an empty string.

    A field with the same last part comes first, then a field of a table of that name, then a similar spelling.

    Args:
        also: names that are allowed besides fields.
    """
    known = [*field_names(), *also]
    last = name.rpartition(".")[2]
    same = [k for k in known if k.rpartition(".")[2] == last] or [
        k for k in known if last in k.split(".")[1:-1]
    ]
    sections = [section for section in Scenario.model_fields if section != name]
    return nearest(name, same, cutoff=0.0) or nearest(name, [*known, *sections])
