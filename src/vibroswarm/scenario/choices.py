"""Sections of a scenario that select a strategy, a network, a task or a sensor by name, with tables of parameters.

An entry's code is the reference to the user's file that defines it, with a hash (``plugins``), or None.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar

from pydantic import ConfigDict, Field, ValidationError, model_serializer, model_validator

from vibroswarm.core.frozen_model import FrozenModel
from vibroswarm.errors import InputError, nearest, shown
from vibroswarm.networks import known as known_networks
from vibroswarm.scenario import plugins
from vibroswarm.strategies import known as known_strategies
from vibroswarm.strategies.static_analysis import reads_places
from vibroswarm.tasks import known as known_tasks


def field_error(error: ValidationError, suggest: Callable[[str], str], prefix: str = "") -> InputError:
    """Return an ``InputError``, in words for users, for the first of Pydantic's validation errors."""
    first = error.errors(include_url=False)[0]
    # Parts after the field's name are places in its value, or which of several types it may have.
    name = prefix + ".".join(str(part) for part in first["loc"][: 1 if prefix else 2])
    if first["type"] == "extra_forbidden":
        return InputError(f"there is no such field{suggest(name)}", field=name)
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, InputError):  # raised by a check across fields, which has named the field already
        return cause
    message = first["msg"][0].lower() + first["msg"][1:]
    # An error about the scenario as a whole names no field.
    return InputError(f"{shown(first.get('input'))} is wrong: {message}", field=name.strip(".") or "scenario")


class Choice(FrozenModel):
    """A section that selects an entry by name, with a table of parameters for each: ``[strategy.soft]``.

    Tables of entries other than the selected one are kept; they have no effect and are in no hash.
    """

    model_config = ConfigDict(frozen=True, extra="allow", strict=True, allow_inf_nan=False)
    kind: ClassVar[str]
    """What is selected: "strategy", "network", "task" or "sensor", also the name of the section."""
    selector: ClassVar[str] = "name"
    """The field that holds the name of the selected entry. A section may have other fields, too."""
    known: ClassVar[Callable[[], Mapping[str, Any]]]
    """Returns the entries that are registered, by name."""

    code: str | None = None
    """Reference to the user's file that defines the entry, with its SHA-256; None for an entry of a package."""

    @model_validator(mode="before")
    @classmethod
    def _with_tables(cls, values: Any) -> Any:
        """Find the selected entry, load its code if allowed, and validate all tables."""
        if not isinstance(values, Mapping):
            return values  # which Pydantic refuses
        given = {"code": None, cls.selector: cls.model_fields[cls.selector].default} | dict(values)
        name, code = given[cls.selector], given["code"]
        entry = plugins.found(
            cls.kind, code if plugins.is_code(code) and plugins.name_in(code) == name else name
        )
        given |= {cls.selector: entry.name, "code": entry.code or None}
        tables = {key: cls._table(key, given.pop(key)) for key in set(given) - set(cls.model_fields)}
        tables.setdefault(entry.name, entry.params())
        for key, table in sorted(tables.items()):
            if type(table).model_fields and (key == entry.name or table != type(table)()):
                given[key] = table
        return given

    @classmethod
    def _table(cls, name: str, table: Any) -> Any:
        entries, section = plugins.known_for(cls.kind, name), f"{cls.kind}.{name}"
        if name not in entries:
            names = [f"{cls.kind}.{field}" for field in cls.fields_of()]
            raise InputError(f"there is no such field{nearest(section, names)}", field=section)
        params = entries[name].params
        try:
            return table if isinstance(table, params) else params.model_validate(table)
        except ValidationError as error:
            fields = [f"{section}.{field}" for field in params.model_fields]
            raise field_error(error, lambda wrong: nearest(wrong, fields), f"{section}.") from None

    @property
    def selected(self) -> str:
        """Name of the selected entry."""
        return str(getattr(self, self.selector))

    @property
    def entry(self) -> Any:
        """The selected entry."""
        return type(self).known()[self.selected]

    @property
    def params(self) -> Any:
        """Parameters of the selected entry."""
        return self.table(self.selected)

    @property
    def _tables(self) -> dict[str, Any]:
        """The tables, which Pydantic keeps as extra fields, because they are not declared."""
        return self.__pydantic_extra__ or {}

    def table(self, name: str) -> Any:
        """Return the parameters of an entry: those given, or its defaults."""
        return self._tables.get(name) or type(self).known()[name].params()

    @model_serializer(mode="plain")
    def _written(self) -> dict[str, Any]:
        """Return the section's own fields that are set, and the tables in alphabetical order, to write out."""
        own = {name: getattr(self, name) for name in type(self).model_fields}
        tables = {name: table.model_dump(exclude_none=True) for name, table in sorted(self._tables.items())}
        return {key: value for key, value in (own | tables).items() if value is not None}

    @property
    def effective(self) -> dict[str, Any]:
        """The part that has an effect: the section's own fields and the table of the selected entry."""
        written: dict[str, Any] = self._written()
        own = {*type(self).model_fields, self.selected}
        return {key: value for key, value in written.items() if key in own}

    @classmethod
    def fields_of(cls) -> dict[str, Any]:
        """Return the types of its own fields and of all parameters, by dotted name without the section: "soft.eta"."""
        own = {name: field.annotation for name, field in cls.model_fields.items() if name != "code"}
        return own | {
            f"{name}.{field}": info.annotation
            for name, entry in cls.known().items()
            for field, info in entry.params.model_fields.items()
        }


class StrategyChoice(Choice):
    """What a robot sends and when it decides."""

    kind = "strategy"
    known = staticmethod(known_strategies)
    name: str = "none"
    """``none`` sends readings, ``positive`` its decision once it has one, ``soft`` a bit drawn between reading and
    belief; others are as published elsewhere."""

    @property
    def reads_places(self) -> bool:
        """Whether the strategy reads where robots believe they are."""
        return reads_places(self.entry)


class NetworkChoice(Choice):
    """Who hears what, and when."""

    kind = "network"
    known = staticmethod(known_networks)
    name: str = "ideal"
    """All hear all (ideal); each message may be lost to each receiver (loss), as in the study (loss_by_size), or in
    bursts (bursts); robots hear those near them (range); late (delay); by relays (tree)."""


Costs = Annotated[
    tuple[Annotated[tuple[Annotated[float, Field(ge=0)], ...], Field(min_length=2, strict=False)], ...],
    Field(min_length=2, strict=False),
]
"""A row for each truth, with the cost of each answer."""


class TaskChoice(Choice):
    """The question about the floor; by name: ``fill_ratio``: does more than ``decision_boundary`` vibrate?;
    ``majority``: which kind of tile is most common?; ``agree``: on a symmetric floor, on which side?; ``share``: which
    share vibrates?; ``mean``: what is the mean value of the tiles?"""

    kind = "task"
    known = staticmethod(known_tasks)
    name: str = "fill_ratio"
    """Name of the task; ``agree``, ``share`` and ``mean`` have no right decision."""
    costs: Costs | None = None
    """What mistakes cost, such as ``[[0, 1], [4, 0]]``: a row for each truth, with the cost of each answer; if omitted,
    all cost the same. Leagues, detection and searches count a mistake relative to the dearest."""

    @property
    def asks_number(self) -> bool:
        """Whether the task asks for a number, such as a share."""
        return bool(self.entry.estimated)
