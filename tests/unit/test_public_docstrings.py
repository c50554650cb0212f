"""Whoever reads the reference finds every parameter and every error of the public names."""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Iterator
from typing import Any

ROOMS = ("vibroswarm", "vibroswarm.floors", "vibroswarm.optimize", "vibroswarm.plots")
OF_FIELDS = ("Scenario",)
"""Classes whose fields stand in a document of their own."""


def public() -> Iterator[tuple[str, Any]]:
    """Every public name, and the public methods of classes."""
    for room in ROOMS:
        module = importlib.import_module(room)
        for name in module.__all__:
            found = getattr(module, name)
            yield f"{room}.{name}", found
            if inspect.isclass(found):
                for below, what in vars(found).items():
                    if not below.startswith("_") and (
                        inspect.isfunction(what) or isinstance(what, classmethod)
                    ):
                        yield f"{room}.{name}.{below}", getattr(found, below)


def missing(found: Any) -> list[str]:
    """What the docstring does not say: parameters, and that it raises."""
    if not inspect.isclass(found) and not inspect.isroutine(found):
        found = type(found)  # an object
    text = inspect.getdoc(found) or ""
    if not text:
        return ["a docstring"]
    if inspect.isclass(found) and (issubclass(found, Exception) or found.__name__ in OF_FIELDS):
        return []
    if "head of this module" in text:
        text += str(inspect.getmodule(found).__doc__)
    source = inspect.getsource(found)
    lacking = [name for name in inspect.signature(found).parameters if not told(name, text, source)]
    if not inspect.isclass(found) and "raise InputError" in source and "InputError" not in text:
        lacking.append("InputError")
    return lacking


def told(name: str, text: str, source: str) -> bool:
    """In the docstring, or below the field of a class; private ones need not be."""
    below = rf"^ +{name}:[^\n]*\n +\"\"\""
    return (
        name.startswith("_")
        or name == "self"
        or bool(re.search(rf"\b{name}\b", text) or re.search(below, source, re.M))
    )


def test_a_docstring_tells_all() -> None:
    lacking = {name: missing(found) for name, found in public()}
    assert len(lacking) > 100
    assert {name: what for name, what in lacking.items() if what} == {}


def test_what_is_missing_is_seen() -> None:
    def silent(seed: int) -> None:
        pass

    def forgetful(seed: int, runs: int) -> None:
        """With a seed."""
        raise InputError("no")  # noqa: F821

    assert missing(silent) == ["a docstring"]
    assert missing(forgetful) == ["runs", "InputError"]
