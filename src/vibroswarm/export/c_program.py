"""The generated C sources of a scenario's robots: the header and the program.

The program is ``robot_program``, translated to C with the hooks of the strategy (``c_functions``). Rows become structs.
The constants are macros in a header of their own (``parameters``).
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from vibroswarm.core.jit import source_hash
from vibroswarm.errors import InputError
from vibroswarm.export import robot_memory, robot_program
from vibroswarm.export.assembly import Classifier, RobotParts, omitted_of_world
from vibroswarm.export.c_functions import Compiled, Program
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
from vibroswarm.export.parameters import ROWS, macro_of
from vibroswarm.export.source import plain
from vibroswarm.robot.sensing import ClassBorders, SenseProgram, SenseState
from vibroswarm.robot.walk import AVOID, DRIVE, STOP, TURN, Dice, WalkProgram, WalkState
from vibroswarm.strategies.base import arrays_of, fields_of
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
ENUMS: Final = {
    "What a robot does: its member walk.mode.": {"DRIVE": DRIVE, "TURN": TURN, "AVOID": AVOID, "STOP": STOP},
}
"""Constants of the program that have names in C, by what they are."""
PACKET_VERSION: Final = 1
"""Version of the layout of packets."""
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
    """Return the C sources of a scenario's robots: the header and the program.

    Args:
        for_tests: whether ``robot_program.PARTS`` can be called from outside, too.
    Raises:
        InputError: a construct cannot be translated; file and line are named.
    """
    structs, (precision, why) = structs_of(parts), precision_of(parts)
    # Constant rows are static structs in C, filled in from the macros of the header of parameters.
    constants = {name: structs[row] for name, row in ROWS.items() if row in structs}
    # Constant rows and numbers that the translated functions read as global names.
    globals = {name: Value(f"vs_{name.lower()}", kind, is_place=True) for name, kind in constants.items()}
    globals["RMS_THRESHOLD"] = Value("VS_RMS_THRESHOLD", REAL)
    # A constant and not a macro, so that the code for blind robots is left out if it is 0.
    globals["SENSING_BLIND_MS"] = literal(parts.blind_ms)
    names = api_of(parts, for_tests=for_tests)
    program = Program(
        struct_of={kind.source: kind for kind in structs.values() if kind.source is not None},
        row_names={"Message": structs["Message"]},
        globals=globals,
        replaced=parts.replaced,
        template=robot_program.__name__,
        instead=parts.hooks,
        enums={name: value for names in ENUMS.values() for name, value in names.items()},
        public=names,
    )
    api = _translated(program, names, parts, structs)
    public = {item.name for item in api.values()}
    compiled = program.called_from(public)
    texts = [text_of(item.text, item.name in public) for item in compiled]
    tables = [
        f"static const {kind.name} vs_{name.lower()} = {{{', '.join(initial(name, kind))}}};"
        for name, kind in constants.items()
        if any(re.search(rf"\bvs_{name.lower()}\b", text) for text in texts)
    ]
    tuples = [typedef(kind) for kind in program.tuples.values()]
    types = [typedef(kind) for kind in structs.values()]
    return CSources(
        header=HEADER.format(
            made=made_by(parts),
            types="\n\n".join(types),
            # Prototypes; all other functions are static.
            heads=documented({name: f"{item.head};" for name, item in api.items()}),
            inbox=robot_memory.INBOX,
            radio=radio_macros(structs),
            enums="\n".join(enum_of(about, names) for about, names in ENUMS.items()),
            precision=precision,
            why=why,
        ),
        program=PROGRAM.format(
            made=made_by(parts),
            checks="\n".join(checks_of(parts)),
            tuples="\n\n".join(tuples),
            tables="\n".join(tables),
            functions="\n\n".join(texts),
        ),
    )


def _translated(
    program: Program, names: Sequence[str], parts: RobotParts, structs: Mapping[str, Struct]
) -> dict[str, Compiled]:
    """Translate functions of the API, and those that they call; return the former in C, by name."""
    api = {}
    for name in names:
        function = getattr(robot_program, name)
        given = [
            type_of_argument(item, structs["Robot"], structs, parts.classifier)
            for item in inspect.signature(function).parameters.values()
        ]
        api[name] = program.function(function, given)
    return api


def precision_of(parts: RobotParts) -> tuple[int, str]:
    """Return the least precision in which robots act as they do in double precision, and the reason for it.

    For strategies of the package, tests compare the precisions. A user's own strategy is not tested: it gets
    ``SINGLE``.

    Returns:
        ``SINGLE`` (float), ``MIXED`` (double, with arrays in float) or ``DOUBLE``, and a sentence for the header.
    """
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


ARRAYS_BELONG: Final = {
    "State": "declare it in the class Arrays",
    "Message": "use a field for each of its numbers",
}
"""What to do instead of declaring an array, by the class that declares it."""


def structs_of(parts: RobotParts) -> dict[str, Struct]:
    """Return the structs of the program by the names of their Python classes, each after those that it contains.

    Raises:
        InputError: State or Message declares an array of fixed size, which an exported program cannot hold.
    """
    strategy = parts.strategy
    for row, declared in (("State", strategy.state), ("Message", strategy.message)):
        for name in arrays_of(declared):
            raise InputError(
                f"'{name}' is an array, which an exported program cannot hold in {row}; {ARRAYS_BELONG[row]}",
                field=f"{row} of strategy '{strategy.name}'",
            )
    found = {
        "World": struct_of_class("vs_World", World, omitted=omitted_of_world(strategy), like=parts.world),
        "Reading": struct_of_class("vs_Reading", Reading, omitted=("log_ratio", "value")),
        "Draws": struct_of_class("vs_Draws", Draws),
        "WalkProgram": struct_of_class("vs_WalkProgram", WalkProgram),
        "WalkState": struct_of_class("vs_WalkState", WalkState),
        "Dice": struct_of_class("vs_Dice", Dice),
        "SenseProgram": struct_of_class("vs_SenseProgram", SenseProgram),
        "SenseState": struct_of_class("vs_SenseState", SenseState),
        "Params": struct_of_row("vs_Params", {k: type(v) for k, v in parts.params.items()}, mutable=False),
        "State": struct_of_row("vs_State", fields_of(strategy.state)),
        "Message": struct_of_row("vs_Message", fields_of(strategy.message)),
        "Arrays": struct_of_arrays("vs_Arrays", strategy.arrays, parts.sizes),
    }  # fmt: skip
    if parts.borders is not None:
        found["ClassBorders"] = struct_of_class("vs_ClassBorders", ClassBorders, like=parts.borders)
    if parts.classifier is not None:
        kinds = {name: type(value) for name, value in parts.classifier.params.items()}
        found["SensorParams"] = struct_of_row("vs_SensorParams", kinds, mutable=False)
    found["Robot"] = robot_struct(parts, found)
    return found


def robot_struct(parts: RobotParts, structs: Mapping[str, Struct]) -> Struct:
    """Return the struct of a robot's memory: the fields of ``robot_memory.Robot``.

    Fields that only reading classes uses are left out of robots without it.

    Args:
        structs: the other structs, by the names of their Python classes.
    """
    inbox = robot_memory.INBOX
    # Types of fields that depend on the strategy, or that are rows or arrays.
    special: dict[str, Any] = {
        "seed": LONG,  # seeds need 64 bits
        "state": structs["State"],
        "arrays": structs["Arrays"],
        "out": structs["Message"],
        "inbox": CArray(structs["Message"], (inbox,)),
        "inbox_sender": CArray("int32_t", (inbox,)),
        "inbox_number": CArray("int32_t", (inbox,)),
        "world": structs["World"],
        "walk": structs["WalkState"],
        "dice": structs["Dice"],
        "sense": structs["SenseState"],
    }
    omitted = () if parts.has_own_sensor else ("reading",)
    numbers = {"int": INT, "float": REAL, "bool": BOOL}  # by the annotation, as text
    fields = tuple(
        (name, special.get(name) or numbers[hint])
        for name, hint in inspect.get_annotations(robot_memory.Robot).items()
        if name not in omitted
    )
    return Struct("vs_Robot", robot_memory.Robot, fields, mutable=True)


def type_of_argument(
    item: inspect.Parameter, robot: Struct, structs: Mapping[str, Struct], classifier: Classifier | None
) -> Any:
    """Return the type in C of an argument of a function of the API, by its annotation."""
    if item.name == "seed":
        return LONG
    if item.annotation == "Numbers":
        assert classifier is not None
        return CArray(REAL, (len(classifier.names),))
    return {"int": INT, "float": REAL, "bool": BOOL, "Robot": robot, "Message": structs["Message"]}[
        item.annotation
    ]


def initial(name: str, kind: Struct) -> list[str]:
    """Return the initialisers of a constant row, such as ``.rows = VS_WORLD_ROWS``; ``["0"]`` for an empty row."""
    if kind.fields is EMPTY:
        return ["0"]
    return [f".{identifier(field)} = {macro_of(name, field)}" for field, _ in kind.fields]


def radio_macros(structs: Mapping[str, Struct]) -> str:
    """Return the macros by which ``vibroswarm_radio.c`` packs messages and writes lines of a log."""
    message, state = structs["Message"], structs["State"]
    kinds = {INT: ("VS_WHOLE", "4"), BOOL: ("VS_TRUTH", "1"), REAL: ("VS_NUMBER", "(int)sizeof(vs_real)")}
    fields = [] if message.fields is EMPTY else list(message.fields)
    has_posterior = state.type_of("alpha") == state.type_of("beta") == INT
    macros = {
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
    return "\n".join(f"#define {name} {value}".rstrip() for name, value in macros.items())


def enum_of(about: str, names: Mapping[str, int]) -> str:
    """Return the definition in C of constants, below a comment that says what they are."""
    return f"/* {about} */\nenum {{ {', '.join(f'VS_{name} = {value}' for name, value in names.items())} }};"


def text_of(text: str, is_public: bool) -> str:
    """Return the text of a function in C, made ``static`` unless it is public: part of the API."""
    if is_public:
        return text
    place, rest = text.split("\n", 1)  # the first line is a comment that names file and line
    return f"{place}\nstatic {rest}"


def checks_of(parts: RobotParts) -> list[str]:
    """Return preprocessor checks that refuse parameters with other sizes than those the program was generated for.

    Arrays have fixed lengths. Tiles are rows times columns, and classes of readings are no constant of their own.
    """
    return [
        f'#if VS_WORLD_{name.upper()} != {size}\n#error "this program is for {size} {name}: export again"\n#endif'
        for name, size in parts.sizes.items()
        if name not in ("tiles", "readings")
    ]


def api_of(parts: RobotParts, *, for_tests: bool) -> list[str]:
    """Return the functions of a robot that can be called from outside."""
    omitted = (
        *(robot_program.OF_VALUES if parts.borders is None else ()),
        *(robot_program.OF_NUMBERS if parts.classifier is None else ()),
    )
    names = (*robot_program.API, *(robot_program.PARTS if for_tests else ()))
    return [name for name in names if name not in omitted]


def documented(heads: Mapping[str, str]) -> str:
    """Return the prototypes of the API, each below the first paragraph of its docstring as a comment.

    Args:
        heads: prototypes by name.
    """
    lines = []
    for name, head in heads.items():
        text = inspect.getdoc(getattr(robot_program, name)) or ""
        words = " ".join(line.strip() for line in text.split("\n\n")[0].splitlines())
        lines.append(f"/* {words.replace('``', '')} */\n{head}")
    return "\n\n".join(lines)


HEADER: Final = """{made}
#ifndef VIBROSWARM_H
#define VIBROSWARM_H

#ifndef VS_PRECISION
#define VS_PRECISION {precision} /* {why} */
#endif
#include "vibroswarm_runtime.h"

#ifdef __cplusplus
extern "C" {{
#endif

#define VS_INBOX {inbox}

{enums}

{types}

/* Set all bytes of a robot to zero before vs_start. */

{heads}

/* Radio and log: vibroswarm_radio.c. */

/* A packet has VS_PACKET_BYTES bytes, low bytes of a number first: VS_PACKET_VERSION (1 byte), VS_PROGRAM_ID (4), which
   says what the sender runs, sender (1), number of the message (4), and the message's fields in their order: whole
   numbers (4, two's complement), truth values (1), others as vs_real (IEEE 754; 4 with VS_PRECISION 1, else 8). */
{radio}

/* Write the packet of a message; return its length, VS_PACKET_BYTES. */
vs_int vs_pack(const vs_Message *message, vs_int sender, vs_int number, uint8_t *packet);

/* Read a packet; return false, and leave all as it is, if it is not one of a robot that runs the same program,
   or its sender's number is not below VS_WORLD_ROBOTS. */
bool vs_unpack(const uint8_t *packet, vs_int length, vs_Message *message, vs_int *sender, vs_int *number);

/* Write the line of the log (CSV below VS_LOG_HEADER, with its end, then a null character) of the last sample, right
   after it; return its length, below VS_LOG_BYTES. 'vibroswarm lab import' reads it. x_m and y_m are empty:
   'vibroswarm lab track --log' adds them from a video. */
vs_int vs_log_line(const vs_Robot *r, char *line);

#ifdef __cplusplus
}}
#endif

#endif
"""

PROGRAM: Final = """{made}
#include "vibroswarm.h"
#include "vibroswarm_parameters.h"

{checks}

{tuples}

{tables}

{functions}
"""
