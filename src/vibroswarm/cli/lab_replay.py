"""``vibroswarm lab replay``: what each strategy would have decided on a recording's observations."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import add_json, add_seed, add_settings, list_of, whole
from vibroswarm.errors import InputError, nearest

if TYPE_CHECKING:
    from vibroswarm.recordings.replay import SessionOutcome
    from vibroswarm.scenario.scenario import Scenario

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
    """Replay each strategy on a recording and print its outcomes beside those that were logged; return the exit code.

    Samples that are missing in the log are restored (``put_back``). If the log counts more messages received by a robot
    before one of its samples than the other robots can have sent by then, the surplus is left out (``unsent``).
    """
    from vibroswarm.cli.output import print_json, print_paragraph, print_table
    from vibroswarm.recordings.recording import Recording
    from vibroswarm.recordings.replay import logged_outcomes, replay_recording, session_outcomes
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
    logged = logged_outcomes(recording)
    outcomes = {name: session_outcomes(recording, replay) for name, replay in replays.items()}
    # The number of restored samples is the same in all replays, so it is taken from the first one.
    first = next(iter(replays.values()))
    rule = _rule(scenario)
    if arguments.json:
        print_json(
            {
                "rule": rule,
                "draws": arguments.draws,
                "seed": arguments.seed,
                "put_back": first.put_back,
                "unsent": {name: replay.unsent for name, replay in replays.items()},
                "as_logged": [asdict(outcome) for outcome in logged],
                "replayed": {
                    name: [asdict(outcome) for outcome in outcomes_of]
                    for name, outcomes_of in outcomes.items()
                },
            }
        )
        return 0
    rows = []
    for session, logged_outcome in enumerate(logged):
        rows.append(_row("as logged", logged_outcome, is_logged=True))
        rows += [_row(name, by_session[session], is_logged=False) for name, by_session in outcomes.items()]
    print_table(
        ["session", "strategy", "consensus", "decision time, s", "undecided, %", "belief in the truth"],
        rows,
        names=2,  # session and strategy name a row
        texts=3,  # the third column, consensus, is text too: it is aligned to the left and may be wrapped
    )
    print()
    print_paragraph(
        f"Rule: {', '.join(f'{name} {value}' for name, value in rule.items())}; {arguments.draws} draws."
    )
    unsent = ", ".join(f"{replay.unsent:g} ({name})" for name, replay in replays.items())
    print_paragraph(
        f"Restored {first.put_back} samples without a row; left out {unsent} messages per draw that nobody could have "
        "sent at that time."
    )
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


def _rule(scenario: Scenario) -> dict[str, Any]:
    """Return the fields of the scenario by which robots decide, for JSON and the printed text."""
    return {
        "rms_threshold": scenario.sensor.rms_threshold,
        "credible_threshold": scenario.decision.credible_threshold,
        "min_observations": scenario.decision.min_observations,
        "gate": scenario.decision.gate,
    }


def _row(name: str, found: SessionOutcome, *, is_logged: bool) -> list[object]:
    """Return the row of one session and strategy in the table of outcomes, with a dash for each unknown value.

    Args:
        name: name of the strategy, or "as logged".
        found: the outcome of the session: the logged one, or that of all draws of a replay.
        is_logged: whether this is the logged outcome, for which there is only one draw. For a replay, the consensus is
            printed as shares of the draws, and the decision time with its 5 % and 95 % quantiles over the draws.
    """
    consensus = ", ".join(
        outcome if is_logged else f"{outcome} {100 * share:.3g} %"
        for outcome, share in found.consensus.items()
    )
    # Robots without a decision count with the time of their last sample: a session has no time if it has no samples, or
    # if its decisions are not logged.
    time = "-"
    if found.decision_time_s is not None:
        spread = "" if is_logged else f" [{found.decision_time_low_s:.0f}, {found.decision_time_high_s:.0f}]"
        time = f"{found.decision_time_s:.1f}{spread}"
    return [
        found.session,
        name,
        consensus or "-",
        time,
        "-" if found.undecided is None else f"{100 * found.undecided:.3g}",
        "-" if found.belief_in_truth is None else f"{found.belief_in_truth:.3f}",
    ]
