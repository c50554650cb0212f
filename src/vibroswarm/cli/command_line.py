"""Command lines made of typed functions: a parser for each, its help, and the call.

A command is a function. Its positional-only parameters are the arguments of the command line, its keywords the options:

    def evaluate(
        study: Annotated[Path | None, Option("the study file", "STUDY.toml")] = None,
        /,
        *,
        runs: Annotated[int, Option("runs per cell", low=1)] = 100,
        output: Output,
    ) -> int:

| type | on the command line |
|---|---|
| ``bool`` | a flag |
| ``int``, ``float``, ``str``, ``Path`` | one value; ``low`` and ``high`` are bounds of numbers |
| ``Literal["a", "b"]`` | one of these words |
| ``tuple[int, ...]`` | values separated by commas |
| ``Sequence[str]`` | an option that may be repeated |
| ``list[Path]`` | an option with several values, separated by spaces |
| a dataclass, such as ``Output`` | a group of options, one for each field; the parameter's name is the group's title |

Without a default, an option is required. ``*files`` takes one or more arguments. The docstring is the help: its
paragraphs up to the first line that ends with a colon, such as ``examples:``, are the description, the rest is printed
as it stands.
"""

from __future__ import annotations

import argparse
import dataclasses
import inspect
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Final, Literal, NamedTuple, NoReturn, get_args, get_origin, get_type_hints

from vibroswarm.errors import InputError, check_choice, nearest, share_from, shown


@dataclasses.dataclass(frozen=True)
class Option:
    """What the command line says of a parameter; ``{names}`` in ``help`` stands for ``names``."""

    help: str
    value: str = ""
    _: dataclasses.KW_ONLY
    low: float = -math.inf
    high: float = math.inf
    read: Callable[[str], Any] | None = None
    name: str = ""
    short: str = ""
    names: Callable[[], Iterable[str]] | None = None
    of: str = ""


class Parameter(NamedTuple):
    """A parameter of a command, or a field of a group of options."""

    name: str
    kind: Any
    """Its type, without ``None`` and ``Annotated``."""
    option: Option
    default: Any
    place: Any
    """As ``inspect.Parameter.kind``: options are keywords, arguments of the command line are positional."""


def parameters_of(command: Callable[..., Any]) -> list[Parameter]:
    """Return the parameters of a command, or the fields of a dataclass."""
    hints = get_type_hints(command, include_extras=True)
    found = []
    for name, parameter in inspect.signature(command).parameters.items():
        kind, *notes = get_args(hints[name]) if get_origin(hints[name]) is Annotated else (hints[name],)
        option = next((note for note in notes if isinstance(note, Option)), Option(""))
        if NoneType in get_args(kind):
            (kind,) = set(get_args(kind)) - {NoneType}
        found.append(Parameter(name, kind, option, parameter.default, parameter.kind))
    return found


class Formatter(argparse.HelpFormatter):
    """Formats help: names of registries in place of ``{names}``, and texts with line breaks as they stand."""

    def add_argument(self, action: argparse.Action) -> None:
        """Leave out what another command's help describes."""
        if not is_described_elsewhere(action, self._prog):
            super().add_argument(action)

    def _get_help_string(self, action: argparse.Action) -> str | None:
        return help_of(action).replace("%", "%%")

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text.rstrip() if "\n" in text else super()._fill_text(text, width, indent)


def option_of(action: argparse.Action) -> Option:
    """Return what the command line says of an argument of argparse."""
    return vars(action).get("option") or Option(action.help or "")


def is_described_elsewhere(action: argparse.Action, prog: str) -> bool:
    """Return whether the help of another command than ``prog`` describes an option."""
    other = option_of(action).of
    return bool(other) and not prog.endswith(f" {other}")


def help_of(action: argparse.Action) -> str:
    """Return the help of an option or argument, with the names that it takes, and its default."""
    option, default = option_of(action), action.default
    text = option.help.replace("{names}", ", ".join(option.names() if option.names else ()))
    if "default" in text or default in (None, False, (), [], argparse.SUPPRESS):
        return text
    listed = ",".join(map(str, default)) if isinstance(default, tuple) else default
    return f"{text} (default {listed})"


class Parser(argparse.ArgumentParser):
    """A parser of one command: what is wrong is one line, which names the option and the nearest known one."""

    def __init__(self, prog: str, **settings: Any) -> None:
        super().__init__(prog=prog, allow_abbrev=False, formatter_class=Formatter, **settings)

    def _get_value(self, action: argparse.Action, text: str) -> Any:
        """Convert a text; the argparse method has words of its own for a wrong one."""
        try:
            return action.type(text) if callable(action.type) else text
        except InputError as error:
            raise argparse.ArgumentError(action, str(error)) from None

    def error(self, message: str) -> NoReturn:
        """Raise ``InputError``; argparse gives a finished sentence, of which the option is cut out."""
        what, _, text = message.partition(": ")
        if what == "unrecognized arguments":
            word = text.split()[0].split("=")[0]
            known = [name for action in self._actions for name in action.option_strings]
            raise InputError(f"unknown option{nearest(word, known)}; see '{self.prog} --help'", field=word)
        if text and what.startswith("argument "):
            raise InputError(text, field=what.removeprefix("argument ").split("/")[-1])
        raise InputError(f"{message}; see '{self.prog} --help'", field=self.prog)


def parser_of(words: str, command: Callable[..., Any], also: Mapping[str, type]) -> Parser:
    """Return the parser of a command, called by ``words``; ``also`` are further groups of options by title."""
    parser = Parser(words)
    fill(parser, command, also)
    arguments = parser._get_positional_actions()
    names = [f"[{one.metavar}]" if one.nargs == "?" else str(one.metavar) for one in arguments]
    parser.usage = " ".join([words, *names, "[options]"])
    return parser


def fill(parser: argparse.ArgumentParser, command: Callable[..., Any], also: Mapping[str, type]) -> None:
    """Give a parser the options, arguments and texts of a command, and further groups of options by title."""
    parser.description, parser.epilog = _description_and_epilog(command)
    for parameter in parameters_of(command):
        if dataclasses.is_dataclass(parameter.kind):
            add_group(parser, parameter.name, parameter.kind)
        else:
            add_option(parser, parameter)
    for title, kind in also.items():
        add_group(parser, title, kind)


def _description_and_epilog(command: Callable[..., Any]) -> tuple[str, str]:
    lines = (inspect.getdoc(command) or "").splitlines()
    end = next((number for number, line in enumerate(lines) if line.endswith(":")), len(lines))
    return " ".join(" ".join(lines[:end]).split()), "\n".join(lines[end:])


def add_group(parser: argparse.ArgumentParser, title: str, kind: Any) -> argparse._ArgumentGroup:
    """Add the fields of a dataclass as a group of options."""
    group = parser.add_argument_group(title.replace("_", " "))
    for parameter in parameters_of(kind):
        add_option(group, parameter)
    elsewhere = [one for one in group._group_actions if is_described_elsewhere(one, parser.prog)]
    if elsewhere:
        names = ", ".join(action.option_strings[-1] for action in elsewhere)
        group.description = f"{names}: see 'vibroswarm run --help'"
    return group


def add_option(parser: argparse._ActionsContainer, parameter: Parameter) -> None:
    """Add one option or argument."""
    name, kind, option, default, place = parameter
    is_required = default is inspect.Parameter.empty
    settings: dict[str, Any] = {"default": None if is_required else default}
    if kind is bool:
        settings["action"] = "store_true"
    else:
        origin = get_origin(kind)
        item = get_args(kind)[0] if origin in (Sequence, list) else kind
        read = option.read or reader(item, option.low, option.high)
        settings |= {"type": read, "metavar": option.value or placeholder(item)}
        if get_origin(item) is Literal:
            option = dataclasses.replace(option, names=option.names or partial(get_args, item))
        if origin is Sequence:
            settings |= {"action": "append", "default": list(default)}
        elif origin is list:
            settings["nargs"] = "+"
    words = [name]
    if place is inspect.Parameter.KEYWORD_ONLY:
        words = [option.short, option.name or f"--{name.replace('_', '-')}"]
        settings |= {"dest": name, "required": is_required}
    else:
        settings["nargs"] = "+" if place is inspect.Parameter.VAR_POSITIONAL else None if is_required else "?"
    action = parser.add_argument(*filter(None, words), **settings)
    vars(action).update(help=option.help, option=option)


def bound(command: Callable[..., Any], values: Mapping[str, Any]) -> inspect.BoundArguments:
    """Return the arguments of a call of a command."""
    call = inspect.signature(command).bind_partial()
    for name, kind, _, _, place in parameters_of(command):
        value = group_of(kind, values) if dataclasses.is_dataclass(kind) else values[name]
        call.arguments[name] = tuple(value) if place is inspect.Parameter.VAR_POSITIONAL else value
    return call


def group_of(kind: Any, values: Mapping[str, Any]) -> Any:
    """Return a group of options as its dataclass, made of the parsed values by name."""
    return kind(**{field.name: values[field.name] for field in dataclasses.fields(kind)})


VALUES: Final[dict[Any, str]] = {int: "N", float: "X", Path: "FILE"}
"""What stands for a value of a type in the help."""
share = partial(share_from, field="")
"""Converts a percentage such as ``5%`` to a share, 0.05."""


def placeholder(kind: Any) -> str:
    """Return what stands for a value of a type in the help."""
    if get_origin(kind) is tuple:
        return f"{placeholder(get_args(kind)[0])},..."
    return VALUES.get(kind, "NAME")


def reader(kind: Any, low: float = -math.inf, high: float = math.inf) -> Callable[[str], Any]:
    """Return the function that converts a text to a type; numbers are from ``low`` to ``high``."""
    if get_origin(kind) is tuple:
        read = reader(get_args(kind)[0], low, high)
        return lambda text: tuple(dict.fromkeys(read(part.strip()) for part in text.split(",")))
    if get_origin(kind) is Literal:
        return partial(_choice, choices=get_args(kind))
    if kind in (int, float):
        return partial(number, kind=kind, low=low, high=high)
    return path if kind is Path else str


def _choice(text: str, choices: tuple[str, ...]) -> str:
    check_choice(text, "", choices)
    return text


def path(text: str) -> Path:
    """Convert a text to a path; an empty one, as of an unset variable of a shell, would be the working folder."""
    refuse(not text, "", "is empty; give a path")
    return Path(text)


def number(text: str, kind: type, low: float = -math.inf, high: float = math.inf) -> Any:
    """Convert a text to a whole number (``int``) or a finite number (``float``) from ``low`` to ``high``."""
    try:
        value = kind(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high or abs(value) == math.inf:
        wanted = "a whole number" if kind is int else "a number"
        bounds = "" if low == -math.inf else f" from {low:g}" + ("" if high == math.inf else f" to {high:g}")
        raise InputError(f"{shown(text)} is not {wanted}{bounds}")
    return value


def pair_of(
    separator: str, form: str, kind: type, low: float, high: float = math.inf
) -> Callable[[str], Any]:
    """Return the function that converts two numbers, such as those of ``1.2x0.8``; ``form`` is for messages."""

    def read(text: str) -> tuple[Any, Any]:
        parts = text.lower().split(separator)
        refuse(len(parts) != 2, "", f"'{text}' is not of the form {form}")
        return number(parts[0], kind, low, high), number(parts[1], kind, low, high)

    return read


def refuse(wrong: object, field: str, message: str) -> None:
    """Raise an ``InputError`` about a field if something is wrong."""
    if wrong:
        raise InputError(message, field=field or None)
