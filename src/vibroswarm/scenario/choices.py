"""Sections of a scenario that select a strategy, a network or a task by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict, ValidationError, model_serializer, model_validator

from vibroswarm.core.frozen_model import FrozenModel
from vibroswarm.errors import InputError, nearest, shown
from vibroswarm.networks import known as known_networks
from vibroswarm.scenario import plugins
from vibroswarm.strategies import known as known_strategies
from vibroswarm.tasks import known as known_tasks


def field_error(error: ValidationError, suggest: Callable[[str], str], prefix: str = "") -> InputError:
    """Turn the first validation error into an ``InputError`` in a user's words.

    Args:
        suggest: returns a suggestion for an unknown field. prefix: of the field's name.
    """
    first = error.errors(include_url=False)[0]
    name = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        return InputError(f"there is no such field{suggest(name)}", field=prefix + name)
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, InputError):  # a check across fields; it names the field itself
        return cause
    value, hint = first.get("input"), ""
    if first["type"] == "literal_error" and isinstance(value, str):
        words = first["ctx"]["expected"].replace(" or ", ", ").split(", ")
        hint = nearest(value, [word.strip("'") for word in words])
    message = first["msg"][0].lower() + first["msg"][1:]
    return InputError(f"{shown(value)} is wrong: {message}{hint}", field=prefix + name or "scenario")


class Choice(FrozenModel):
    """A section that selects an entry by name, with a table of parameters for each: ``[strategy.soft]``.

    Tables of entries other than the selected one are kept; they have no effect and are in no hash.
    """

    model_config = ConfigDict(frozen=True, extra="allow", strict=True, allow_inf_nan=False)
    kind: ClassVar[str]
    known: ClassVar[Callable[[], Mapping[str, Any]]]

    name: str
    code: str | None = None
    """File of the entry and its SHA-256, if it is not part of vibroswarm."""

    @model_validator(mode="before")
    @classmethod
    def _check_choice(cls, values: Any) -> Any:
        """Resolve the selected entry and its code, and validate all tables."""
        if not isinstance(values, Mapping):
            return values
        given = dict(values)
        name = given.get("name", cls.model_fields["name"].default)
        spec = name if plugins.is_code(name) else given.get("code")
        if isinstance(spec, str) and plugins.is_code(spec):
            if name in (spec, plugins.name_in(spec)):
                given["code"] = spec = plugins.resolve_code(cls.kind, spec)
                given["name"] = name = plugins.name_in(spec)
            else:  # the code belongs to an entry that is no longer selected
                spec = None
        entries = plugins.known_for(cls.kind, name if spec is None else None)
        if isinstance(name, str) and name in entries:
            registered = entries[name].code or None
            if isinstance(spec, str) and plugins.HASH in spec and spec != registered:
                raise InputError(
                    f"{spec.partition(plugins.HASH)[0]} has changed: its SHA-256 began with "
                    f"{spec.partition(plugins.HASH)[2][:12]}, that of the one now loaded with "
                    f"{(registered or '').partition(plugins.HASH)[2][:12] or 'nothing'}",
                    field=f"{cls.kind}.code",
                )
            given["code"] = registered
        elif spec is None or not isinstance(name, str) or not plugins.is_code_name(name):
            given.pop("code", None)
        if isinstance(name, str) and name not in entries and given.get("code") is None:
            raise InputError(
                f"there is no {cls.kind} {shown(name)}{nearest(name, entries)} (there are {', '.join(entries)})",
                field=f"{cls.kind}.name",
            )
        for key in sorted(set(given) - {"name", "code"}):
            table = cls._table(key, given[key], is_chosen=key == name)
            is_empty = not (type(table).model_fields if isinstance(table, BaseModel) else table)
            is_default = (
                key != name and key in entries and not entries[key].code and table == entries[key].params()
            )
            if is_empty or is_default:
                del given[key]  # equal scenarios are written alike
            else:
                given[key] = table
        if (
            isinstance(name, str)
            and name in entries
            and name not in given
            and entries[name].params.model_fields
        ):
            given[name] = entries[name].params()
        return given

    @classmethod
    def _table(cls, name: str, table: Any, is_chosen: bool) -> Any:
        """Return the parameters of an entry, validated if its code is loaded, else as given."""
        entries, section = cls.known(), f"{cls.kind}.{name}"
        if name not in entries:
            if isinstance(table, Mapping) and (is_chosen or plugins.is_code_name(name)):
                return dict(table)
            fields = [
                f"{entry}.{field}" for entry, known in entries.items() for field in known.params.model_fields
            ]
            full_names = {"name": f"{cls.kind}.name"} | {
                field.rpartition(".")[2]: f"{cls.kind}.{field}" for field in fields
            }
            close = nearest(name, [*entries, *full_names])
            for last, right in full_names.items():
                close = close.replace(f"'{last}'", f"'{right}'")
            raise InputError(f"there is no such field{close}", field=section)
        params = entries[name].params
        if isinstance(table, params):
            return table
        if not isinstance(table, Mapping):
            raise InputError(
                f"{shown(table)} is wrong; give a table of {', '.join(params.model_fields)}", field=section
            )
        try:
            return params.model_validate(dict(table))
        except ValidationError as error:
            suggest = partial(nearest, known=params.model_fields)
            raise field_error(error, suggest, prefix=f"{section}.") from None

    @property
    def params(self) -> Any:
        """Parameters of the selected entry."""
        return self.table(self.name)

    def table(self, name: str) -> Any:
        """Return the parameters of any entry: those given, or its defaults."""
        own_table = (self.__pydantic_extra__ or {}).get(name)
        if own_table is not None:
            return own_table
        entries = type(self).known()
        return entries[name].params() if name in entries else {}

    @property
    def defaults(self) -> dict[str, Any]:
        """Default parameters of the selected entry; those given if its code is not loaded."""
        known = type(self).known().get(self.name)
        values: dict[str, Any] = known.params().model_dump() if known is not None else dict(self.params)
        return values

    @model_serializer(mode="plain")
    def _as_tables(self) -> dict[str, Any]:
        """Return name, code, and the tables in alphabetical order."""
        tables: dict[str, Any] = {"name": self.name, "code": self.code}
        for name, table in sorted((self.__pydantic_extra__ or {}).items()):
            tables[name] = table.model_dump() if isinstance(table, BaseModel) else dict(table)
        return {key: value for key, value in tables.items() if value is not None}

    @property
    def effective(self) -> dict[str, Any]:
        """The part that has an effect: the name, the code and the selected entry's parameters."""
        tables: dict[str, Any] = self._as_tables()
        return {key: value for key, value in tables.items() if key in ("name", "code", self.name)}

    @classmethod
    def field_names(cls) -> list[str]:
        """Return all fields by their dotted names, without that of the section."""
        tables = [
            f"{name}.{field}" for name, entry in cls.known().items() for field in entry.params.model_fields
        ]
        return ["name", *tables]

    @classmethod
    def kind_of(cls, name: str) -> Any:
        """Return the type of a field, by its dotted name without that of the section."""
        table, separator, field = name.partition(".")
        if not separator:
            return str
        return cls.known()[table].params.model_fields[field].annotation


class StrategyChoice(Choice):
    """What a robot sends and when it decides; by name: ``none``, ``positive``, ``soft``, or a published strategy."""

    kind = "strategy"
    known = staticmethod(known_strategies)
    name: str = "none"
    """A robot sends its reading (none), its decision once it has one (positive), or a bit drawn between its
    reading and its belief (soft); or as published elsewhere."""


class NetworkChoice(Choice):
    """Who hears what, and when; by name: ``ideal``: all hear all, ``loss``: messages may be lost, and others."""

    kind = "network"
    known = staticmethod(known_networks)
    name: str = "ideal"
    """All hear all (ideal); each message is lost to each receiver with a probability (loss), as in the study
    (loss_by_size), or in bursts (bursts); robots hear those near them (range); late (delay); by relays (tree)."""


class TaskChoice(Choice):
    """The question about the floor; by name: ``fill_ratio``: does more than ``decision_boundary`` vibrate?"""

    kind = "task"
    known = staticmethod(known_tasks)
    name: str = "fill_ratio"
    """The right decision is given by the share of tiles that vibrate (fill_ratio)."""
