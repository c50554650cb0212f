"""``vibroswarm lab replay``: what each strategy would have decided on a recording's observations."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vibroswarm.cli.deliver import print_result
from vibroswarm.cli.options import add_json, add_seed, add_settings, list_of, whole
from vibroswarm.errors import InputError, nearest

EPILOG = """\
example:
  vibroswarm lab replay lab --strategy none,positive,soft --gate own --set rms_threshold=1.4
"""


def add_parser(tasks: Any) -> None:
    """Add the task ``replay``."""
    parser = tasks.add_parser(
        "replay",
        help="what each strategy would have decided on a recording's own observations",
        description="Replay strategies on the energies of a recording. As many packets are lost as its log counts; "
        "which ones is not logged and is drawn at random.",
        epilog=EPILOG,
    )
    parser.add_argument("folder", metavar="DIR", type=Path, help="folder of a recording (lab import)")
    parser.add_argument(
        "--strategy",
        metavar="A,B",
        type=list_of(),
        default=["none", "positive", "soft"],
        help="strategies to replay (default none,positive,soft)",
    )
    parser.add_argument("--gate", metavar="NAME", help="observations counted for O_c: total, received or own")
    add_settings(parser, "set a field of [sensor], [strategy] or [decision], such as rms_threshold=1.4")
    parser.add_argument(
        "--draws", metavar="N", type=whole, default=200, help="draws of the lost packets (default 200)"
    )
    add_seed(parser, "seed of the draws")
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Replay each strategy on a recording and print its outcomes beside the logged ones; return the exit code."""
    from vibroswarm.documents.recording import replay_document
    from vibroswarm.recordings.recording import Recording
    from vibroswarm.recordings.replay import replay_recording
    from vibroswarm.strategies import names as known_names

    for name in arguments.strategy:
        if name not in known_names():
            raise InputError(
                f"unknown strategy '{name}'{nearest(name, known_names())} (known: {', '.join(known_names())})",
                field="--strategy",
            )
    recording = Recording.read(arguments.folder)
    scenario = recording.scenario.with_values(_settings(arguments))
    replays = {
        name: replay_recording(
            recording, scenario.with_values({"strategy.name": name}), arguments.draws, arguments.seed
        )
        for name in arguments.strategy
    }
    print_result(replay_document(recording, replays, arguments.draws, arguments.seed), arguments)
    return 0


def _settings(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the fields set by ``--gate`` and ``--set``, by dotted name.

    In ``--set``, a field may be named with or without its section.

    Raises:
        InputError: a replay cannot change the field, the name without a section fits fields of several sections, both
            options set the gate, or ``--set`` names a strategy, which ``--strategy`` does.
    """
    from vibroswarm.recordings.replay import REPLAYABLE
    from vibroswarm.scenario.scenario import field_names, parse_setting

    known = [name for name in field_names() if name.partition(".")[0] in REPLAYABLE]
    values: dict[str, Any] = {}
    if arguments.gate is not None:
        values["decision.gate"] = arguments.gate
    for text in arguments.settings:
        name, value = parse_setting(text)
        matches = [field for field in known if name in (field, field.partition(".")[2])]
        if len(matches) != 1:  # no field has this name, or fields of several sections have it
            suggestion = nearest(name, known + [field.partition(".")[2] for field in known])
            raise InputError(f"is not a field that a replay can change{suggestion}", field=name)
        if matches[0] == "strategy.name":  # ``run`` sets it to each strategy of --strategy
            raise InputError("is set by --strategy; use that option", field="--set strategy.name")
        if matches[0] == "decision.gate" and arguments.gate is not None:
            raise InputError("is also set by --gate; use one of them", field="--set decision.gate")
        values[matches[0]] = value
    return values
