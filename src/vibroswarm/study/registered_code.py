"""Recognise code that a program registered itself, or an installed package brings, when its runs are continued.

A scenario has the hash of a user's file that was loaded by name, but only the name of what ``register`` was given. What
such code is, is therefore saved with each batch, beside the versions of the programs.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import FunctionType

from vibroswarm.core.compiled_code import UnknownValueError, compiled_text, is_ours
from vibroswarm.errors import InputError
from vibroswarm.scenario.choices import Choice
from vibroswarm.scenario.scenario import Scenario


def registered_code(scenarios: Iterable[Scenario]) -> dict[str, str]:
    """Return a hash of the functions of each strategy, network, task and sensor that has no file, by kind and name.

    Those of this package are left out, and so are those that read values of which no change can be seen.
    """
    choices = {(one.kind, one.selected): one for scenario in scenarios for one in scenario.choices}
    hashes = {f"{kind} {name}": _hash(choice) for (kind, name), choice in sorted(choices.items())}
    return {name: digest for name, digest in hashes.items() if digest}


def _hash(choice: Choice) -> str:
    """Return the hash of the functions of a choice, 16 hexadecimal digits; empty if there is none."""
    declared = type(choice).known().get(choice.selected)
    values = () if declared is None or choice.code else vars(declared).values()
    functions = [one for one in values if isinstance(one, FunctionType) and not is_ours(one.__module__)]
    try:
        text = "\0".join(map(compiled_text, functions))
    except UnknownValueError:
        return ""
    return hashlib.sha256(text.encode()).hexdigest()[:16] if functions else ""


def check_registered(
    scenarios: Iterable[Scenario], made_by: Iterable[Mapping[str, str]], folder: Path
) -> None:
    """Refuse to continue runs whose registered code has changed since.

    Args:
        made_by: versions with which runs in ``folder`` were made, ``registered_code`` among them.
    Raises:
        InputError: code has changed; the message names it.
    """
    now = registered_code(scenarios)
    for saved in made_by:
        changed = [name for name, digest in now.items() if saved.get(name, digest) != digest]
        if changed:
            raise InputError(
                f"its runs were made with another {changed[0]}, whose code has changed since; take another folder",
                field=str(folder),
            )
