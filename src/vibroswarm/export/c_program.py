"""The generated C sources of a scenario's robots: the header, and ``robot_program`` translated with the hooks."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from vibroswarm.core.jit import source_hash
from vibroswarm.export import robot_memory, robot_program
from vibroswarm.export.assembly import RobotParts, omitted_of_world
from vibroswarm.export.c_functions import Program
from vibroswarm.export.c_types import (
    BOOL,
    EMPTY,
    INT,
    LONG,
    REAL,
    CArray,
    Struct,
    Value,
    identifier,
    literal,
    struct_of_arrays,
    struct_of_class,
    struct_of_row,
    typedef,
)
from vibroswarm.export.parameters import ROWS, macro_of, rendered
from vibroswarm.export.source import plain
from vibroswarm.robot.sensing import ClassBorders, SenseProgram, SenseState
from vibroswarm.robot.walk import AVOID, DRIVE, STOP, TURN, Dice, WalkProgram, WalkState
from vibroswarm.strategies.base import fields_of
from vibroswarm.strategies.world import Draws, Reading, World

SINGLE, MIXED, DOUBLE = 1, 2, 3
"""Values of VS_PRECISION: float; double with arrays in float; double."""
NEEDS_DOUBLE: Final = {
    "mcp": (
        DOUBLE,
        "the confidence of a perfect sensor divides by (1 - 0.999999)^2, which float does not resolve",
    ),
    "bayes_cpf": (MIXED, "float beliefs were off by up to 0.005"),
    "three_valued": (DOUBLE, "phases last whole control periods, and float would end them a period later"),
}
"""Strategies for which float is not precise enough: the precision that is, and why."""
MODES: Final = {"DRIVE": DRIVE, "TURN": TURN, "AVOID": AVOID, "STOP": STOP}
"""Constants of the program that have names in C: what a robot does."""
PACKET_VERSION: Final = 1
"""Version of the layout of packets."""
PLAIN_ROWS: Final = (Draws, WalkProgram, WalkState, Dice, SenseProgram, SenseState)
"""Classes of rows of numbers."""
NUMBERS: Final = {"int": INT, "float": REAL, "bool": BOOL}
"""Types of numbers in C by annotations, which are texts."""
LOG_COLUMNS: Final = (
    "robot", "time_s", "x_m", "y_m", "energy", "heading_rad", "observation", "message", "alpha", "beta",
    "belief_below", "decision", "sent", "messages_received", "avoid_total_s", "stop_total_s",
)  # fmt: skip
"""Columns of the log of an exported robot: those of the format ``camera`` of ``recordings``."""


@dataclass(frozen=True)
class CSources:
    """Texts of the generated files."""

    header: str
    program: str


def c_sources(parts: RobotParts, *, for_tests: bool = False) -> CSources:
    """Return the C sources of a scenario's robots: the header and the program."""
    structs, names = structs_of(parts), api_of(parts, for_tests=for_tests)
    # Constant rows are static structs in C, filled in from the macros of the header of parameters.
    constants = {name: structs[row] for name, row in ROWS.items() if row in structs}
    program = program_of(parts, structs, constants, names)
    api = [
        program.function(function, types_of_arguments(function, parts, structs))
        for function in (getattr(robot_program, name) for name in names)
    ]
    public = {item.name for item in api}
    functions = program.called_from(public)
    tables = {f"vs_{name.lower()}": (kind, name) for name, kind in constants.items()}
    made, (precision, why) = made_by(parts), precision_of(parts)
    return CSources(
        header=rendered(
            "vibroswarm.h",
            made=made,
            precision=precision,
            why=why,
            inbox=robot_memory.INBOX,
            modes=MODES,
            types=[typedef(kind) for kind in structs.values()],
            api=[{"about": summary(name), "head": item.head} for name, item in zip(names, api, strict=True)],
            radio=radio_macros(structs),
        ),
        program=rendered(
            "vibroswarm.c",
            made=made,
            # Tiles are rows times columns, and classes of readings are no constant of their own.
            sizes={name: size for name, size in parts.sizes.items() if name not in ("tiles", "readings")},
            tuples=[typedef(kind) for kind in program.tuples.values()],
            tables={
                table: {"struct": kind.name, "fields": initial(name, kind)}
                for table, (kind, name) in tables.items()
                if any(re.search(rf"\b{table}\b", item.text) for item in functions)
            },
            functions=[
                {"place": item.place, "is_public": item.name in public, "text": item.text}
                for item in functions
            ],
        ),
    )


def program_of(
    parts: RobotParts, structs: Mapping[str, Struct], constants: Mapping[str, Struct], names: Sequence[str]
) -> Program:
    """Return the program without functions yet; ``names`` are those of the functions called from outside."""
    # Constant rows and numbers that the translated functions read as global names.
    globals = {name: Value(f"vs_{name.lower()}", kind, is_place=True) for name, kind in constants.items()}
    globals["RMS_THRESHOLD"] = Value("VS_RMS_THRESHOLD", REAL)
    # A constant and not a macro, so that the code for blind robots is left out if it is 0.
    globals["SENSING_BLIND_MS"] = literal(parts.blind_ms)
    return Program(
        # Message is the class in the template that stands for the strategy's own.
        struct_of={kind.source: kind for kind in structs.values() if kind.source is not None}
        | {robot_memory.Message: structs["Message"]},
        globals=globals,
        replaced=parts.replaced,
        template=robot_program.__name__,
        instead=parts.hooks,
        enums=MODES,
        public=names,
    )


def precision_of(parts: RobotParts) -> tuple[int, str]:
    """Return the least precision in which robots act as they do in double precision, and the reason for it."""
    if parts.classifier is not None and NEEDS_DOUBLE.get(parts.strategy.name, (MIXED, ""))[0] == MIXED:
        return MIXED, "classes of several numbers are then those of the simulation to the last bit"
    tested = "float makes the same events as double"
    # str(): the module of a function made by ``exec`` may be None.
    is_ours = str(plain(parts.strategy.on_sample).__module__).startswith("vibroswarm.")
    reason = tested if is_ours else "not tested for this strategy; compare with 3 (double)"
    return NEEDS_DOUBLE.get(parts.strategy.name, (SINGLE, reason))


def made_by(parts: RobotParts) -> str:
    """Return the comment at the top of a generated file: version, strategy, and how to make it again."""
    return (
        f"/* Robot program of vibroswarm ({source_hash()}), strategy '{parts.strategy.name}'.\n"
        "   Generated by 'vibroswarm export c'; export again rather than edit. */"
    )


def structs_of(parts: RobotParts) -> dict[str, Struct]:
    """Return the structs of the program by the names of their Python classes, each after those that it contains."""
    strategy, world = parts.strategy, parts.world
    found = {
        "World": struct_of_class("vs_World", World, omitted=omitted_of_world(strategy), like=world),
        "Reading": struct_of_class("vs_Reading", Reading, omitted=("log_ratio", "value")),
        **{kind.__name__: struct_of_class(f"vs_{kind.__name__}", kind) for kind in PLAIN_ROWS},
        "Params": struct_of_row("vs_Params", {k: type(v) for k, v in parts.params.items()}, mutable=False),
        "State": struct_of_row("vs_State", fields_of(strategy.state)),
        "Message": struct_of_row("vs_Message", fields_of(strategy.message)),
        "Arrays": struct_of_arrays("vs_Arrays", strategy.arrays, parts.sizes),
    }
    if parts.borders is not None:
        found["ClassBorders"] = struct_of_class("vs_ClassBorders", ClassBorders, like=parts.borders)
    if parts.classifier is not None:
        kinds = {name: type(value) for name, value in parts.classifier.params.items()}
        found["SensorParams"] = struct_of_row("vs_SensorParams", kinds, mutable=False)
    found["Robot"] = robot_struct(parts, found)
    return found


def robot_struct(parts: RobotParts, structs: Mapping[str, Struct]) -> Struct:
    """Return the struct of a robot's memory: the fields of ``robot_memory.Robot``."""
    inbox = (robot_memory.INBOX,)
    # Types of fields that depend on the strategy, or that are rows or arrays.
    special: dict[str, Any] = {
        "seed": LONG,  # seeds need 64 bits
        "out": structs["Message"],
        "inbox": CArray(structs["Message"], inbox),
        "inbox_sender": CArray("int32_t", inbox),
        "inbox_number": CArray("int32_t", inbox),
        "walk": structs["WalkState"],
        "sense": structs["SenseState"],
        **{name.lower(): structs[name] for name in ("State", "Arrays", "World", "Dice")},
    }
    omitted = () if parts.has_own_sensor else ("reading",)
    fields = tuple(
        (name, special.get(name) or NUMBERS[hint])
        for name, hint in inspect.get_annotations(robot_memory.Robot).items()
        if name not in omitted
    )
    return Struct("vs_Robot", robot_memory.Robot, fields, mutable=True)


def types_of_arguments(function: Any, parts: RobotParts, structs: Mapping[str, Struct]) -> list[Any]:
    """Return the types in C of the arguments of a function of the API, by their annotations."""
    count = 0 if parts.classifier is None else len(parts.classifier.names)
    types = {**NUMBERS, **structs, "Numbers": CArray(REAL, (count,))}
    return [
        LONG if item.name == "seed" else types[item.annotation]
        for item in inspect.signature(function).parameters.values()
    ]


def initial(name: str, kind: Struct) -> list[str]:
    """Return the initialisers of a constant row, such as ``.rows = VS_WORLD_ROWS``; ``["0"]`` for an empty row."""
    if kind.fields is EMPTY:
        return ["0"]
    return [f".{identifier(field)} = {macro_of(name, field)}" for field, _ in kind.fields]


def radio_macros(structs: Mapping[str, Struct]) -> dict[str, str]:
    """Return the macros by which ``vibroswarm_radio.c`` packs messages and writes lines of a log."""
    message, state = structs["Message"], structs["State"]
    kinds = {INT: ("VS_WHOLE", "4"), BOOL: ("VS_TRUTH", "1"), REAL: ("VS_NUMBER", "(int)sizeof(vs_real)")}
    fields = [] if message.fields is EMPTY else list(message.fields)
    has_posterior = state.type_of("alpha") == state.type_of("beta") == INT
    return {
        "VS_PACKET_VERSION": str(PACKET_VERSION),
        "VS_PACKET_BYTES": " + ".join(["(10", *(kinds[kind][1] for _, kind in fields)]) + ")",
        # Without fields, the macro says that the message is not used.
        "VS_MESSAGE_FIELDS": " ".join(f"{kinds[kind][0]}({identifier(name)})" for name, kind in fields)
        or "(void)message;",
        "VS_LOG_HEADER": f'"{",".join(LOG_COLUMNS)}\\n"',
        "VS_LOG_BYTES": "200",
        "VS_LOG_BIT": "(vs_real)r->out.bit" if message.type_of("bit") == INT else "VS_NAN",
        "VS_LOG_ALPHA": "(vs_real)r->state.alpha" if has_posterior else "VS_NAN",
        "VS_LOG_BETA": "(vs_real)r->state.beta" if has_posterior else "VS_NAN",
    }


def api_of(parts: RobotParts, *, for_tests: bool) -> list[str]:
    """Return the functions of a robot that can be called from outside."""
    omitted = (
        *(robot_program.OF_VALUES if parts.borders is None else ()),
        *(robot_program.OF_NUMBERS if parts.classifier is None else ()),
    )
    names = (*robot_program.API, *(robot_program.PARTS if for_tests else ()))
    return [name for name in names if name not in omitted]


def summary(name: str) -> str:
    """Return the first paragraph of the docstring of a function of the API, on one line."""
    text = inspect.getdoc(getattr(robot_program, name)) or ""
    return " ".join(text.split("\n\n")[0].split()).replace("``", "")
