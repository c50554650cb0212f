"""The scenario that a command line asks for: a preset or a file, and what is set beside it."""

from __future__ import annotations

import argparse
from typing import Any

from vibroswarm import code_files
from vibroswarm.cli.warned import warn_of
from vibroswarm.errors import InputError, nearest, shown
from vibroswarm.floors.files import parse_tiles
from vibroswarm.floors.source import is_random, resolve
from vibroswarm.observation.energies import read_energies
from vibroswarm.presets import preset
from vibroswarm.scenario import Scenario, parse_setting


def scenario_from(arguments: argparse.Namespace) -> Scenario:
    """Preset or file, then --floor, --tiles, --robots, --strategy, --energies, then --set, in this order.

    Raises:
        InputError: naming the option, its value and what would be right.
    """
    base = Scenario.read(arguments.scenario) if arguments.scenario else preset(arguments.preset or "paper")
    scenario = base.with_values(values_from(arguments, base))
    warn_of([scenario])
    return scenario


def values_from(arguments: argparse.Namespace, base: Scenario) -> dict[str, Any]:
    """What the options say beside the base, by dotted names."""
    values: dict[str, Any] = {}
    if arguments.floor is not None or arguments.tiles is not None:
        values |= _floor_values(base, arguments.floor, arguments.tiles)
    if arguments.robots is not None:
        values["swarm.robots"] = whole_number(arguments.robots, "--robots")
    if arguments.strategy is not None:
        values["strategy.name"] = chosen("strategy", arguments.strategy)
    if getattr(arguments, "network", None) is not None:
        values["network.name"] = chosen("network", arguments.network)
    if getattr(arguments, "task", None) is not None:
        values["task.name"] = chosen("task", arguments.task)
    if arguments.energies is not None:
        vibrating, still = read_energies(arguments.energies)
        values |= {
            "sensor.model": "energies",
            "sensor.vibrating_energies": vibrating,
            "sensor.still_energies": still,
        }
    settings = dict(parse_setting(text) for text in arguments.settings)
    for kind in code_files.KINDS:
        if code_files.is_code(settings.get(f"{kind}.name")):
            settings[f"{kind}.name"] = chosen(kind, settings[f"{kind}.name"])
    return values | settings


def chosen(kind: str, text: str) -> str:
    """The name of a strategy, network, task or source of motion; a file that is named is loaded.

    Raises:
        InputError: there is none of that name, or the file cannot be loaded.
    """
    if code_files.is_code(text):
        return str(code_files.load_file(kind, text).code)
    if kind == "motion":
        import vibroswarm.simulation  # noqa: F401  (makes the engines known)
    known = code_files.KINDS[kind].known()
    if text not in known:
        code_files.load_installed()
    if text not in known:
        raise InputError(
            f"there is no {kind} '{text}'{nearest(text, known)} (there are {', '.join(known)}; or FILE.py:NAME)",
            field=f"--{kind}",
        )
    return text


def _floor_values(base: Scenario, spec: str | None, tiles: str | None) -> dict[str, Any]:
    """The fields of a floor; a file is taken into the scenario, so that the scenario stands alone."""
    size = None if tiles is None else parse_tiles(tiles)
    if spec is None:
        if base.floor.tiles is not None or not is_random(base.floor.source):
            raise InputError(
                "is for a random floor, a coordinate list or a picture; say --floor too", field="--tiles"
            )
        spec = base.floor.source
    if is_random(spec) and size is None:
        size = (base.floor.rows, base.floor.columns)
    grid, name = resolve(spec, size)
    name = "".join(c if c.isprintable() else "?" for c in name)  # a file's name may hold anything
    if is_random(spec):
        return {
            "floor.source": spec,
            "floor.tiles": None,
            "floor.rows": grid.shape[0],
            "floor.columns": grid.shape[1],
        }
    rows = tuple("".join("1" if tile else "0" for tile in row) for row in grid)
    is_pattern = ":" in name and name == spec.strip().lower().replace("_", "-")
    return {"floor.source": name, "floor.tiles": None if is_pattern else rows}


def whole_number(text: str, option: str) -> int:
    """The number that ``text`` says."""
    try:
        return int(text)
    except ValueError:
        raise InputError(f"{shown(text)} is no whole number", field=option) from None
