"""The header of parameters of an exported C program: it is written, read back, and compared with a scenario.

The header holds each field of the scenario as a line ``//@ section.field = value`` (TOML), from which the scenario can
be read back, and each constant of the program as a ``#define``. ``differences`` compares both with a scenario.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from vibroswarm.core.jit import source_hash
from vibroswarm.core.untrusted_files import read_text
from vibroswarm.errors import InputError, in_file
from vibroswarm.export.assembly import RobotParts, omitted_of_world
from vibroswarm.scenario.scenario import Scenario

ROWS: Final = {
    "PARAMS": "Params",
    "WORLD": "World",
    "WALKER": "WalkProgram",
    "SENSING": "SenseProgram",
    "BORDERS": "ClassBorders",
    "SENSOR": "SensorParams",
}
"""Constant rows of ``robot_memory``: the names of their classes."""
FIELD: Final = "//@ "
"""Beginning of the lines that hold fields of the scenario."""
HEADER_FILE: Final = "vibroswarm_parameters.h"
"""Name of the header of parameters."""
IDENTITY: Final = ("VS_SCENARIO_HASH", "VS_CODE_HASH", "VS_PROGRAM_ID")
"""Constants by which a robot says what it runs; they are compared with nothing, since all else is."""
DEFINE: Final = re.compile(r"#define (VS_\w+) (.+)")
"""Line of a constant in the header: the name of its macro, and its value."""


def macro_of(row: str, field: str) -> str:
    """Return the name of a field of a constant row as a macro in C, such as ``VS_WORLD_ROWS``."""
    return f"VS_{row}_{field.upper()}"


def constants_of(parts: RobotParts) -> dict[str, str]:
    """Return the values of the program's constants as texts in C, by the names of their macros.

    ``SENSING_BLIND_MS`` is not among them: its number stands in the program itself.

    Raises:
        InputError: a constant is nan.
    """
    omitted = omitted_of_world(parts.strategy)
    rows: dict[str, Mapping[str, Any]] = {
        "PARAMS": parts.params,
        "WORLD": {name: value for name, value in parts.world._asdict().items() if name not in omitted},
    }
    programs = {
        "WALKER": parts.walker,
        "SENSING": parts.sensing,
        "BORDERS": parts.borders,
    }
    rows |= {name: program._asdict() for name, program in programs.items() if program is not None}
    if parts.classifier is not None:
        rows["SENSOR"] = parts.classifier.params
    found = {
        macro_of(row, name): c_number(value, macro_of(row, name))
        for row, values in rows.items()
        for name, value in values.items()
    }
    found["VS_RMS_THRESHOLD"] = c_number(parts.rms_threshold, "VS_RMS_THRESHOLD")
    return found


def identity_of(parts: RobotParts) -> dict[str, str]:
    """Return the constants by which a flashed robot says what it runs: two hashes, and four bytes of both to send."""
    hashes = (parts.scenario.hash, source_hash())
    four_bytes = hashlib.sha256(" ".join(hashes).encode()).hexdigest()[:8]
    values = (*(f'"{one}"' for one in hashes), f"UINT32_C(0x{four_bytes})")
    return dict(zip(IDENTITY, values, strict=True))


def c_number(value: Any, name: str) -> str:
    """Return the text in C of a number, or of an array of numbers, flattened in braces.

    Args:
        name: of the constant, for the error message.
    Raises:
        InputError: a number is nan.
    """
    if isinstance(value, np.ndarray):
        return "{" + ", ".join(c_number(item, name) for item in value.ravel().tolist()) + "}"
    # Truth values come before integers, because a Python bool is an int, too.
    if isinstance(value, bool | np.bool_):
        return "true" if value else "false"
    if isinstance(value, int | np.integer):
        return str(int(value))
    number = float(value)
    if math.isnan(number):
        raise InputError("is nan, which a header of parameters cannot hold", field=name)
    if math.isinf(number):
        return "VS_INFINITY" if number > 0 else "(-VS_INFINITY)"
    return f"VS_R({number!r})"


def toml_lines(scenario: Scenario) -> list[str]:
    """Return a scenario as lines ``section.field = value`` of TOML, one for each field of its TOML file."""
    import tomllib

    def walk(table: Mapping[str, Any], prefix: str) -> Iterator[str]:
        """Return the lines of a table and of the tables in it, whose names begin with ``prefix``."""
        for name, value in table.items():
            if isinstance(value, dict):
                yield from walk(value, f"{prefix}{name}.")
            else:
                yield f"{prefix}{name} = {toml_value(value)}"

    return list(walk(tomllib.loads(scenario.to_toml()), ""))


def toml_value(value: Any) -> str:
    """Return a value in TOML on one line; ``tomli_w`` would write lists and tables on several."""
    import tomli_w

    if isinstance(value, list):
        return "[" + ", ".join(toml_value(item) for item in value) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{name} = {toml_value(item)}" for name, item in value.items()) + "}"
    return tomli_w.dumps({"x": value}).partition(" = ")[2].strip()


def header_text(scenario: Scenario, parts: RobotParts) -> str:
    """Return the text of the header of parameters."""
    lines = [
        "/* Parameters of a vibroswarm scenario. Compare with one: vibroswarm export check DIR. */",
        "#ifndef VIBROSWARM_PARAMETERS_H",
        "#define VIBROSWARM_PARAMETERS_H",
        "",
        "#include <stdint.h>",
        "",
        "/* The scenario, field by field. */",
        *(f"{FIELD}{line}" for line in toml_lines(scenario)),
        "",
        "/* Constants of the program, which follow from it; lengths in m, times in s, unless their names say else. */",
        *(f"#define {name} {value}" for name, value in constants_of(parts).items()),
        "",
        "/* What a robot that was flashed with this program can say that it runs. */",
        *(f"#define {name} {value}" for name, value in identity_of(parts).items()),
        "",
        "#endif",
        "",
    ]
    return "\n".join(lines)


def find_header(path: Path) -> Path:
    """Return the path of the header in an exported folder; a path that is no folder is returned unchanged.

    Raises:
        InputError: the folder, with the folders in it, does not hold exactly one such header.
    """
    if path.is_dir():
        found = sorted(path.rglob(HEADER_FILE))
        if len(found) != 1:
            raise InputError(f"holds {len(found)} files {HEADER_FILE}; it should hold one", field=str(path))
        return found[0]
    return path


def read_header(path: Path) -> tuple[Scenario, dict[str, str]]:
    """Return the scenario in a header, and the texts of its constants by the names of their macros.

    Raises:
        InputError: the file is not such a header, or its scenario is not valid.
    """
    text = read_text(path, "a header of parameters")
    fields = [line.removeprefix(FIELD) for line in text.splitlines() if line.startswith(FIELD)]
    if not fields:
        raise InputError(
            f"no line begins with '{FIELD}', so this is not a header of vibroswarm", field=str(path)
        )
    with in_file(path):
        scenario = Scenario.from_toml("\n".join(fields), name=str(path))
    constants = {
        match[1]: match[2].strip()
        for match in map(DEFINE.fullmatch, text.splitlines())
        if match and match[1] not in IDENTITY
    }
    return scenario, constants


def differences(
    found: tuple[Scenario, Mapping[str, str]], scenario: Scenario, parts: RobotParts
) -> list[tuple[str, str, str]]:
    """Return the fields and constants that differ between a header and a scenario.

    Args:
        found: what ``read_header`` returned. scenario, parts: the scenario, and the parts of its robots.
    Returns:
        Name, text in the header and text of the scenario, or "none" where there is no such field or constant. Fields
        come first, then constants, each sorted by name.
    """
    header_scenario, header_constants = found
    header_fields = dict(line.split(" = ", 1) for line in toml_lines(header_scenario))
    scenario_fields = dict(line.split(" = ", 1) for line in toml_lines(scenario))
    return [
        (name, in_header.get(name, "none"), in_scenario.get(name, "none"))
        for in_header, in_scenario in (
            (header_fields, scenario_fields),
            (header_constants, constants_of(parts)),
        )
        for name in sorted({*in_header, *in_scenario})
        if in_header.get(name) != in_scenario.get(name)
    ]
