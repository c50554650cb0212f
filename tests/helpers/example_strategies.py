"""Strategies of ``examples/``, from their files."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

from vibroswarm.scenario.plugins import load_file
from vibroswarm.strategies.base import forget

FOLDERS = {
    "asdf": "papers/chin-2024",
    "bayes_cpf": "papers/chin-2025",
    "dbbs": "papers/shan-2021",
    "distrust": "strategies",
    "field": "strategies",
    "three_valued": "papers/crosscombe-2017",
    "totals": "strategies",
}
"""Their folders, by name."""


def load_example(name: str) -> ModuleType:
    """Make a strategy known; return the module of its file."""
    file = Path(__file__).parents[2] / "examples" / FOLDERS[name] / f"{name}.py"
    return sys.modules[load_file("strategy", f"{file}:{name}").begin.__module__]


def module_of(name: str) -> ModuleType:
    """Return the module of a strategy's file; the strategy does not stay known."""
    module = load_example(name)
    forget(name)
    return module
