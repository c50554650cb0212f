"""Sections of a scenario that select a strategy, a network, a task or a sensor by name.

An entry is a strategy, network, task or sensor that can be selected. Its table holds its parameters, such as
``[strategy.soft]``. Its code is the reference to the user's file that defines it, with a hash (``plugins``); entries of
this package and of installed packages have none. A scenario can be read, and shown, without loading the code of its
entry; the table of such an entry is a plain dictionary that is not validated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_serializer, model_validator

from vibroswarm.core.frozen_model import FrozenModel
from vibroswarm.core.registry import unknown
from vibroswarm.errors import InputError, nearest, shown
from vibroswarm.networks import known as known_networks
from vibroswarm.scenario import plugins
from vibroswarm.strategies import known as known_strategies
from vibroswarm.strategies.static_analysis import reads_places
from vibroswarm.tasks import known as known_tasks


def field_error(error: ValidationError, suggest: Callable[[str], str], prefix: str = "") -> InputError:
    """Return an ``InputError``, in words for users, for the first of Pydantic's validation errors.

    Args:
        suggest: given an unknown field, returns text such as ", did you mean 'x'?". prefix: of the field's name.
    """
    first = error.errors(include_url=False)[0]
    name = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        return InputError(f"there is no such field{suggest(name)}", field=prefix + name)
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, InputError):  # raised by a check across fields, which has named the field already
        return cause
    message = first["msg"][0].lower() + first["msg"][1:]
    # An error about the scenario as a whole names no field.
    return InputError(f"{shown(first.get('input'))} is wrong: {message}", field=prefix + name or "scenario")


def _field_of(params: type[BaseModel], name: str) -> str:
    """Return text that suggests the parameter with the most similar name, or lists all."""
    fields = params.model_fields
    return nearest(name, fields) or (f" (known: {', '.join(fields)})" if fields else "")


@lru_cache(maxsize=256)
def _defaults_of(params: type[BaseModel]) -> Any:
    """Return an entry's default parameters; models are frozen, so one serves all scenarios."""
    return params()


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
    def _check_choice(cls, values: Any) -> Any:
        """Find the selected entry, load its code if allowed, and validate all tables.

        Args:
            values: the section as given: a name, perhaps a code, and tables by the names of entries.
        Returns:
            The section in one form: the name without file, ``code`` with its hash (None for an entry of a package), the
            table of the selected entry, and those tables of other entries that may differ from the defaults.
        Raises:
            InputError: unknown entry, code that has changed or cannot be loaded, or a wrong table.
        """
        if not isinstance(values, Mapping):
            return values  # which Pydantic refuses
        given = dict(values)
        name, entries = cls._resolve_entry(given), cls.known()
        for key in sorted(set(given) - set(cls.model_fields)):  # all other keys are names of entries
            table = cls._table(key, given[key], is_chosen=key == name)
            # A table is left out if it has no fields, or if its entry is not selected and the table holds only
            # defaults. Only defaults of entries without code count: others are known only while their code is loaded.
            is_empty = not (type(table).model_fields if isinstance(table, BaseModel) else table)
            is_default = (
                key != name and key in entries and not entries[key].code and table == entries[key].params()
            )
            if is_empty or is_default:
                del given[key]  # so that scenarios of the same meaning have the same text
            else:
                given[key] = table
        # The table of a selected entry with parameters is always there, with its defaults if it was not given.
        if (
            isinstance(name, str)
            and name in entries
            and name not in given
            and entries[name].params.model_fields
        ):
            given[name] = entries[name].params()
        return given

    @classmethod
    def _resolve_entry(cls, given: dict[str, Any]) -> Any:
        """Set name and ``code`` of a section to those of the selected entry, and load its code if that is allowed.

        Args:
            given: the section; changed in place.
        Returns:
            The entry's name. A name that is not a string is returned as it is, and Pydantic refuses it later.
        Raises:
            InputError: unknown entry, or its code has changed, may not be loaded or cannot be loaded.
        """
        # ``spec`` is the reference to code, or None. The name itself may be one, such as "voter.py:voter"; otherwise it
        # is the section's ``code``.
        name = given.get(cls.selector, cls.model_fields[cls.selector].default)
        spec = name if plugins.is_code(name) else given.get("code")
        if isinstance(spec, str) and plugins.is_code(spec):
            if name in (spec, plugins.name_in(spec)):  # the reference is to the selected entry
                given["code"] = spec = plugins.resolve_code(cls.kind, spec)
                given[cls.selector] = name = plugins.name_in(spec)
            else:  # the code belongs to an entry that is no longer selected
                spec = None
        # Installed packages are searched only for a name that does not refer to code.
        entries = plugins.known_for(cls.kind, name if spec is None else None)
        is_known = isinstance(name, str) and name in entries
        if is_known:
            registered = entries[name].code or None  # None: the entry belongs to a package
            if isinstance(spec, str) and plugins.HASH in spec and spec != registered:
                reference, _, wanted_hash = spec.partition(plugins.HASH)
                loaded_hash = (registered or "").partition(plugins.HASH)[2]
                raise InputError(
                    f"{reference} has changed: its SHA-256 began with "
                    f"{wanted_hash[:12]}, that of the one now loaded with "
                    f"{loaded_hash[:12] or 'nothing'}",
                    field=f"{cls.kind}.code",
                )
            given["code"] = registered
        # Here ``name`` is not known. If a reference to its code is given, but the code must not be loaded, the
        # reference stays in the section, so that the scenario can be shown. In all other cases it is removed.
        elif spec is None or not isinstance(name, str) or not plugins.is_code_name(name):
            given.pop("code", None)
        if isinstance(name, str) and not is_known and given.get("code") is None:
            raise unknown(cls.kind, name, entries, plugins.field_of(cls.kind))
        return name

    @classmethod
    def _table(cls, name: str, table: Any, is_chosen: bool) -> Any:
        """Return the parameters of an entry: a validated model, or a dictionary as given if its code is not loaded.

        Args:
            name: of the entry. table: its parameters as given. is_chosen: whether the entry is the selected one.
        Raises:
            InputError: there is no such entry, or a parameter is wrong.
        """
        entries = plugins.known_for(cls.kind, None if plugins.is_code_name(name) else name, is_field=True)
        section = f"{cls.kind}.{name}"
        if name not in entries:
            if isinstance(table, Mapping) and (is_chosen or plugins.is_code_name(name)):
                return dict(table)
            # A parameter may have been given without its table, such as strategy.eta: suggest strategy.soft.eta.
            full_names = {
                field.rpartition(".")[2]: f"{cls.kind}.{field}" for field in reversed(cls.field_names())
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
            raise field_error(error, partial(_field_of, params), prefix=f"{section}.") from None

    @classmethod
    def _own_fields(cls) -> list[str]:
        """Return the fields of the section itself, the selector among them, but ``code``.

        A new reference to code is given as the name, so ``code`` is no field to users.
        """
        return [name for name in cls.model_fields if name != "code"]

    @property
    def selected(self) -> str:
        """Name of the selected entry."""
        return str(getattr(self, self.selector))

    @property
    def entry(self) -> Any:
        """The selected entry; None if its code is not loaded."""
        return type(self).known().get(self.selected)

    @property
    def params(self) -> Any:
        """Parameters of the selected entry."""
        return self.table(self.selected)

    def table(self, name: str) -> Any:
        """Return the parameters of an entry: those given, or its defaults; {} if neither is known."""
        # Pydantic keeps the tables in its "extra" dictionary, because they are not declared as fields.
        own_table = (self.__pydantic_extra__ or {}).get(name)
        if own_table is not None:
            return own_table
        entries = type(self).known()
        return _defaults_of(entries[name].params) if name in entries else {}

    def check_loaded(self) -> None:
        """Refuse an entry of a user's file that is not loaded.

        Raises:
            InputError: the entry is not registered.
        """
        if self.code is not None and self.entry is None:
            raise plugins.not_loaded(self.code, plugins.field_of(self.kind))

    @property
    def defaults(self) -> dict[str, Any]:
        """Default parameters of the selected entry by name; if its code is not loaded, the parameters given."""
        return dict(self.params if self.entry is None else self.entry.params().model_dump())

    @model_serializer(mode="plain")
    def _as_tables(self) -> dict[str, Any]:
        """Return the section's own fields that are set, and the tables in alphabetical order, to write out."""
        # Pydantic keeps the tables in its "extra" dictionary, because they are not declared as fields.
        tables: dict[str, Any] = {name: getattr(self, name) for name in type(self).model_fields}
        for name, table in sorted((self.__pydantic_extra__ or {}).items()):
            tables[name] = (
                table.model_dump(exclude_none=True) if isinstance(table, BaseModel) else dict(table)
            )
        return {key: value for key, value in tables.items() if value is not None}

    @property
    def effective(self) -> dict[str, Any]:
        """The part that has an effect: the section's own fields and the table of the selected entry."""
        tables: dict[str, Any] = self._as_tables()
        own = {*type(self).model_fields, self.selected}
        return {key: value for key, value in tables.items() if key in own}

    @classmethod
    def field_names(cls) -> list[str]:
        """Return the dotted names, without the section, of its own fields and all parameters, such as "soft.eta"."""
        tables = [
            f"{name}.{field}" for name, entry in cls.known().items() for field in entry.params.model_fields
        ]
        return [*cls._own_fields(), *tables]

    @classmethod
    def kind_of(cls, name: str) -> Any:
        """Return the type of a field, by its dotted name without the section, one of ``field_names``."""
        table, separator, field = name.partition(".")
        if not separator:
            return cls.model_fields[name].annotation
        return cls.known()[table].params.model_fields[field].annotation


class StrategyChoice(Choice):
    """What a robot sends and when it decides."""

    kind = "strategy"
    known = staticmethod(known_strategies)
    name: str = "none"
    """``none`` sends readings, ``positive`` its decision once it has one, ``soft`` a bit drawn between reading and
    belief; others are as published elsewhere."""

    @property
    def reads_places(self) -> bool:
        """Whether the strategy reads where robots believe they are; False if its code is not loaded."""
        return self.entry is not None and reads_places(self.entry)


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
        """Whether the task asks for a number, such as a share; False if its code is not loaded."""
        return self.entry is not None and bool(self.entry.estimated)
