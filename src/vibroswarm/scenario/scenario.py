"""Scenarios: frozen, validated and hashable, read from and written as TOML; their sections are in ``fields``."""

from __future__ import annotations

import hashlib
import json
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
from vibroswarm.errors import InputError, in_file, nearest, plain_value, shown, whole_number_of
from vibroswarm.floors.floor import Floor
from vibroswarm.floors.source import beside, family, fields_of_file, is_generated
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
        with _as_input_error():
            super().__init__(**sections)

    # Pydantic validates without calling it, as without an ``__init__`` of our own: half of the time.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @model_validator(mode="after")
    def _consistent(self) -> Self:
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
        values = parsed_toml(text, name)
        if folder is not None:
            _read_floor_file(values, Path(folder))
        with plugins.search_beside(folder):
            return cls.from_base(values)

    @classmethod
    def from_base(cls, values: Mapping[str, Any]) -> Scenario:
        """Build a scenario from nested mappings; ``"preset": "NAME"`` makes another preset than ``paper`` the base.

        Args:
            values: {section: {field: value}}, and perhaps {"preset": name}; or a scenario.
        Raises:
            InputError: there is no such preset or field, or a value is wrong.
        """
        values = dict(values)
        base = values.pop("preset", None)
        return cls.from_values(values) if base is None else preset(base).with_values(_dotted(values))

    @classmethod
    def read(cls, path: str | Path) -> Scenario:
        """Read a scenario from the TOML file ``path``; a floor file that it names is looked for in the same folder.

        Raises:
            InputError: the file cannot be read, or something in it is wrong.
        """
        path = Path(path)
        text = read_text(path, "a scenario")
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
        # Sections that stay are not checked again.
        data: dict[str, Any] = {section: getattr(self, section) for section in type(self).model_fields}
        data |= self.model_dump(include={name.partition(".")[0] for name in values}, exclude_none=True)
        is_own_floor = values.get("floor.tiles") is not None or values.get("floor.values") is not None
        if is_own_floor and self.floor.is_named:
            data["floor"].pop("source")  # tiles replace this scenario's floor, so its name goes too
        for name, value in values.items():
            *path, last = name.split(".")
            parent: Any = data
            for part in path:  # the scenario may have no table of parameters of this strategy yet
                parent = parent.setdefault(part, {}) if isinstance(parent, dict) else None
            if not isinstance(parent, dict):
                raise _no_such_field(name)
            if value is None:
                parent.pop(last, None)
            else:
                parent[last] = plain_value(value)
        scenario = Scenario.from_values(data)
        for name in values:
            value_of(scenario, name)  # raises if there is no such field, which may have been reset
        return scenario

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
    def hash(self) -> str:
        """16 hexadecimal digits that identify the scenario: they differ if any field that has an effect differs.

        Tables of strategies, networks and tasks that are not selected have no effect. A user's code is included by its
        hash.
        """
        data = {"schema": SCHEMA_VERSION, **_without_empty(self.model_dump(mode="json", exclude_none=True))}
        # In the sections of strategy, network and task, only the table of the selected entry has an effect.
        data |= {choice.kind: choice.effective for choice in self.choices}
        # "auto" has the hash of what it means, but beside a user's code, as it always had.
        if self.strategy.code is None:
            data["localisation"] |= {"method": self.place_method}
        text = json.dumps(data, sort_keys=True, separators=(",", ":"))
        # JSON has no infinity, which a radio's range may be.
        return hashlib.sha256(text.replace("Infinity", '"inf"').encode()).hexdigest()[:16]

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
    plugins.install_all(files)
    return Scenario.from_toml(text)


def _without_empty(sections: dict[str, Any]) -> dict[str, Any]:
    """Leave out empty sections, so that a new section of optional fields changes no hash."""
    return {name: fields for name, fields in sections.items() if fields != {}}


def preset(name: str) -> Scenario:
    """Return the preset of that name.

    Raises:
        InputError: there is no such preset; the nearest name is suggested.
    """
    return _preset(preset_text(name), name)


@cache
def _preset(text: str, name: str) -> Scenario:
    return Scenario.from_toml(text, name=name)


def field_types() -> dict[str, Any]:
    """Return the types of all fields by dotted name, those of all strategies, networks and tasks included."""
    types: dict[str, Any] = {}
    for section, info in Scenario.model_fields.items():
        kind: Any = info.annotation
        fields = (
            kind.fields_of()
            if issubclass(kind, Choice)
            else {name: field.annotation for name, field in kind.model_fields.items()}
        )
        types |= {f"{section}.{name}": annotation for name, annotation in fields.items()}
    return types


def value_of(scenario: Scenario, name: str) -> Any:
    """Return the value of a field, by its dotted name, such as "walk.leg_min_ms" or "strategy.soft.eta"."""
    section, _, field = name.partition(".")
    node = getattr(scenario, section, None)
    table, _, parameter = field.partition(".")
    if isinstance(node, Choice) and parameter and table in type(node).known():
        node, field = node.table(table), parameter
    if not isinstance(node, BaseModel) or field not in type(node).model_fields:
        raise _no_such_field(name)
    return getattr(node, field)


def differences(scenario: Scenario, base: Scenario) -> dict[str, Any]:
    """Return the values, for TOML, of fields in which a scenario differs from a base, by dotted name, but None."""
    return {name: value for name, value in changes(scenario, base).items() if value is not None}


def changes(scenario: Scenario, base: Scenario) -> dict[str, Any]:
    """Return what ``differences`` does, and None for the fields that are None in the scenario and not in the base."""
    differ = [name for name in Scenario.model_fields if getattr(scenario, name) != getattr(base, name)]
    names = [name for name in field_types() if name.partition(".")[0] in differ]
    values = {name: value_of(scenario, name) for name in names}
    return {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in values.items()
        if value != value_of(base, name)
    }


def _dotted(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        flat |= _dotted(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {prefix + name: value}
    return flat


def parse_setting(text: str) -> tuple[str, Any]:
    """Return name and value of a setting such as ``"walk.leg_min_ms=500"``; a value that is not TOML is text."""
    name, separator, value = text.partition("=")
    if not separator or not name.strip():
        raise InputError(f"'{text}' is not of the form section.field=value", field="--set")
    try:
        return name.strip(), tomllib.loads(f"value = {value.strip()}")["value"]
    except ValueError:
        return name.strip(), value.strip()


def parse_values(text: str, form: str = "section.field=value,value") -> tuple[str, list[Any]]:
    """Return name and values of a varied field such as ``"swarm.robots=3,5"``, each value as of ``parse_setting``."""
    name, separator, values = text.partition("=")
    if not separator or not values.strip():
        raise InputError(f"'{text}' is not of the form {form}", field="--vary")
    return name.strip(), [parse_setting(f"{name}={value}")[1] for value in values.split(",")]


def parse_settings(texts: Iterable[str]) -> dict[str, Any]:
    """Return the values of settings by name (``parse_setting``); of one without a value, such as ``"a.b="``, None."""
    return {name: None if value == "" else value for name, value in map(parse_setting, texts)}


def _read_floor_file(values: dict[str, Any], folder: Path) -> None:
    """Replace, in place, a floor file that ``floor.source`` names by its tiles or values and its name."""
    floor: Any = values.get("floor")
    source = floor.get("source") if isinstance(floor, dict) and not {"tiles", "values"} & set(floor) else None
    if not isinstance(source, str) or is_generated(source) or family(source) is not None:
        return
    # Numbers of rows and columns: a file of coordinates needs them, and a picture is divided into them.
    size = (floor.get("rows"), floor.get("columns"))
    shape: Any = size if all(isinstance(each, int) for each in size) else None
    # If the folder has no such file, the source is taken as a path from the working directory; ``resolve`` raises the
    # error if there is no such file either.
    file = beside(source, folder)
    found = fields_of_file(file, shape, floor.get("image_threshold"))
    floor.update({name: value for name, value in found.items() if value is not None})


def _no_such_field(name: str) -> InputError:
    return InputError(f"there is no such field{nearest_field(name)}", field=name)


def nearest_field(name: str, also: Iterable[str] = ()) -> str:
    """Return a suggestion such as ", did you mean 'x'?" for an unknown dotted name, or an empty string."""
    known = [*field_types(), *also]
    last = name.rpartition(".")[2]
    same = [k for k in known if k.rpartition(".")[2] == last] or [k for k in known if f".{last}." in k]
    return nearest(name, same, cutoff=0.0) or nearest(name, [*known, *Scenario.model_fields])
