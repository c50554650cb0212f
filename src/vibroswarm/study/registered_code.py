"""Recognise code that a program registered itself, or an installed package brings, when its runs are continued.

A scenario has the hash of a user's file that was loaded by name, but only the name of what ``register`` was given. What
such code is, is therefore saved with each batch, beside the versions of the programs.
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from vibroswarm.core.user_code import globals_of, users_parts
from vibroswarm.errors import InputError
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario


def registered_code(
    scenarios: Iterable[Scenario], motion: str = "", method: str = "", *_files: str
) -> dict[str, str]:
    """Return a hash of the source of all that is selected and has no file, by kind and name.

    It is that of the functions, of functions that they name, and of numbers and texts that these read. What belongs to
    this package is left out, and so is code whose source cannot be read.

    Args:
        motion, method: name of the source of motion, and of the method of search. _files: ignored: code that has a file
            is known by the hash in its name.
    """
    selected = {(one.kind, one.selected) for scenario in scenarios for one in scenario.choices}
    selected |= {("motion", motion), ("method", method)}
    known = {kind: one.known() for kind, one in plugins.KINDS.items()}
    found = {
        f"{kind} {name}": known[kind][name] for kind, name in sorted(selected) if name in known.get(kind, ())
    }
    texts = {name: _source_of(declared) for name, declared in found.items() if not declared.code}
    return {name: hashlib.sha256(text.encode()).hexdigest()[:16] for name, text in texts.items() if text}


def _source_of(declared: Any) -> str:
    """Return the source of the functions of what is registered; empty if it has none of its own."""
    texts = []
    for part in users_parts(*(getattr(value, "__func__", value) for value in vars(declared).values())):
        if isinstance(part, ModuleType):
            continue
        try:
            texts.append(inspect.getsource(part))
        except OSError:  # it was typed at a prompt
            return ""
        read = {
            name: value
            for name, value in globals_of(part).items()
            if isinstance(value, bool | int | float | str)
        }
        texts.append(f"{part.__defaults__} {read}")
    return "\0".join(texts)


def check_registered(
    made_by: Iterable[Mapping[str, str]], folder: Path, scenarios: Iterable[Scenario], *others: str
) -> None:
    """Refuse to continue runs whose registered code has changed since.

    Args:
        made_by: versions with which runs in ``folder`` were made, ``registered_code`` among them.
        scenarios, others: as of ``registered_code``.
    Raises:
        InputError: code has changed; the message names it.
    """
    now = registered_code(scenarios, *others)
    for saved in made_by:
        changed = [name for name, digest in now.items() if saved.get(name, digest) != digest]
        if changed:
            raise InputError(
                f"its runs were made with another {changed[0]}, whose code has changed since; take another folder",
                field=str(folder),
            )
