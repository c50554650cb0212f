"""Texts of an exported library by templates; its header of parameters is written, and compared with a scenario.

The header holds each field as a line ``//@ section.field = value``, and each constant as a ``#define``.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from vibroswarm.core.jit import source_hash
from vibroswarm.core.untrusted_files import read_text
from vibroswarm.errors import InputError
from vibroswarm.export.assembly import RobotParts, omitted_of_world
from vibroswarm.export.c_types import literal
from vibroswarm.export.source import number_of
from vibroswarm.scenario.scenario import Scenario

if TYPE_CHECKING:
    from jinja2 import Environment

ASSETS: Final = Path(__file__).parent / "assets"
"""The folder of templates, and of files that are the same for every scenario."""


@cache
def _environment() -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(
        loader=FileSystemLoader(ASSETS),
        undefined=StrictUndefined,
        autoescape=False,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


def rendered(name: str, **values: Any) -> str:
    """Return the text of the file ``name`` of a library, with values of its template."""
    return _environment().get_template(f"{name}.j2").render(values)


ROWS: Final = {
    "PARAMS": "Params",
    "WORLD": "World",
    "WALKER": "WalkProgram",
    "SENSING": "SenseProgram",
    "BORDERS": "ClassBorders",
    "SENSOR": "SensorParams",
}
"""Constant rows of ``robot_memory``: the names of their classes."""
HEADER_FILE: Final = "vibroswarm_parameters.h"
"""Name of the header of parameters."""
IDENTITY: Final = ("VS_SCENARIO_HASH", "VS_CODE_HASH", "VS_PROGRAM_ID")
"""Constants by which a robot says what it runs; they are compared with nothing, since all else is."""
LINE: Final = re.compile(r"^(?://@ (?=\S+ =)|#define (?=VS_\w+ ))(\S+) (?:= )?(.+)$", re.MULTILINE)
"""Line of a field or constant in the header: its name, and its value."""


def macro_of(row: str, field: str) -> str:
    """Return the name of a field of a constant row as a macro in C, such as ``VS_WORLD_ROWS``."""
    return f"VS_{row}_{field.upper()}"


def constants_of(parts: RobotParts) -> dict[str, str]:
    """Return the values of the program's constants as texts in C, by the names of their macros."""
    omitted = omitted_of_world(parts.strategy)
    rows: dict[str, Mapping[str, Any]] = {
        "PARAMS": parts.params,
        "WORLD": {name: value for name, value in parts.world._asdict().items() if name not in omitted},
        "WALKER": parts.walker._asdict(),
        "SENSING": parts.sensing._asdict(),
        "BORDERS": {} if parts.borders is None else parts.borders._asdict(),
        "SENSOR": {} if parts.classifier is None else parts.classifier.params,
    }
    found = {macro_of(row, name): value for row, values in rows.items() for name, value in values.items()}
    found["VS_RMS_THRESHOLD"] = parts.rms_threshold
    return {name: c_number(value, name) for name, value in found.items()}


def identity_of(parts: RobotParts) -> dict[str, str]:
    """Return the constants by which a flashed robot says what it runs: two hashes, and four bytes of both to send."""
    hashes = (parts.scenario.hash, source_hash())
    four_bytes = hashlib.sha256(" ".join(hashes).encode()).hexdigest()[:8]
    values = (*(f'"{one}"' for one in hashes), f"UINT32_C(0x{four_bytes})")
    return dict(zip(IDENTITY, values, strict=True))


def c_number(value: Any, name: str) -> str:
    """Return the text in C of a number, or of an array of numbers, flattened in braces."""
    if isinstance(value, np.ndarray):
        return "{" + ", ".join(c_number(item, name) for item in value.ravel().tolist()) + "}"
    number = number_of(value)
    if number is None or math.isnan(number):
        raise InputError(f"is {value}, which a header of parameters cannot hold", field=name)
    return str(number) if type(number) is int else literal(number).text


def fields_of(scenario: Scenario) -> dict[str, str]:
    """Return the texts of a scenario's fields, as in its TOML file, by their names ``section.field``."""
    found: dict[str, str] = {}
    waiting = [("", tomllib.loads(scenario.to_toml()))]
    while waiting:
        before, value = waiting.pop()
        if isinstance(value, dict):
            inner = [(f"{before}.{name}".lstrip("."), item) for name, item in value.items()]
            waiting += reversed(inner)
        else:
            found[before] = json.dumps(value)
    return found


def header_text(scenario: Scenario, parts: RobotParts) -> str:
    """Return the text of the header of parameters."""
    return rendered(
        HEADER_FILE, fields=fields_of(scenario), constants=constants_of(parts), identity=identity_of(parts)
    )


def read_header(path: Path) -> dict[str, str]:
    """Return the texts of fields and constants by name, from a header, or from that of an exported folder."""
    path = path / "src" / HEADER_FILE if path.is_dir() else path
    found = values_in(read_text(path, "a header of parameters"))
    if not found:
        raise InputError("is not a header of vibroswarm's parameters", field=str(path))
    return found


def values_in(header: str) -> dict[str, str]:
    """Return the texts of fields and constants in the text of a header, by name."""
    return {name: value for name, value in LINE.findall(header) if name not in IDENTITY}


def differences(
    header: Mapping[str, str], scenario: Scenario, parts: RobotParts
) -> list[tuple[str, str, str]]:
    """Return the fields and constants that differ between a header and a scenario."""
    expected = values_in(header_text(scenario, parts))
    return [
        (name, header.get(name, "none"), expected.get(name, "none"))
        for name in {**expected, **header}
        if header.get(name) != expected.get(name)
    ]
