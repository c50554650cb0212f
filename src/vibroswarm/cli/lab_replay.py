"""``vibroswarm lab replay``: what each strategy would have decided on the observations of a recording."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.errors import InputError, nearest

if TYPE_CHECKING:
    from vibroswarm.lab.replay import Told
    from vibroswarm.scenario import Scenario

EPILOG = """\
example:
  vibroswarm lab replay lab --strategy none,positive,soft --gate own --set rms_threshold=1.4
"""


def add_parser(tasks: Any) -> None:
    """Make the task known."""
    parser = tasks.add_parser(
        "replay",
        help="what each strategy would have decided on a recording's own observations",
        description="Replay strategies over the energies of a recording, with as many packets lost as its log counts; "
        "which ones is not logged and is drawn.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("folder", metavar="DIR", type=Path, help="of a recording (lab import)")
    parser.add_argument("--strategy", metavar="A,B", default="none,positive,soft", help="which (all three)")
    parser.add_argument("--gate", metavar="NAME", help="what O_c counts: total, received or own")
    parser.add_argument(
        "--set", metavar="FIELD=VALUE", action="append", default=[], dest="settings",
        help="a field of [sensor], [strategy] or [decision], such as rms_threshold=1.4; may be repeated",
    )  # fmt: skip
    parser.add_argument("--draws", metavar="N", default="200", help="how often losses are drawn (200)")
    parser.add_argument("--seed", metavar="S", default="1", help="of the draws")
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> int:
    """Replay each strategy, tell beside what was logged."""
    from vibroswarm.cli.scenarios import whole_number
    from vibroswarm.lab.recording import Recording
    from vibroswarm.lab.replay import as_logged, lab_replay, told
    from vibroswarm.strategies import names as known_names

    draws, seed = whole_number(arguments.draws, "--draws"), whole_number(arguments.seed, "--seed")
    names = [name.strip() for name in arguments.strategy.split(",")]
    for name in names:
        if name not in known_names():
            raise InputError(
                f"there is no strategy '{name}'{nearest(name, known_names())} (there are {', '.join(known_names())})",
                field="--strategy",
            )
    recording = Recording.read(arguments.folder)
    scenario = recording.scenario.with_values(_settings(arguments))
    replayed = {
        name: lab_replay(recording, scenario.with_values({"strategy.name": name}), draws, seed)
        for name in dict.fromkeys(names)
    }
    logged = as_logged(recording)
    found = {name: told(recording, one) for name, one in replayed.items()}
    first = next(iter(replayed.values()))
    if arguments.json:
        about = {
            "rule": _rule(scenario),
            "draws": draws,
            "seed": seed,
            "put_back": first.put_back,
            "unsent": {name: one.unsent for name, one in replayed.items()},
            "as_logged": [one.as_dict() for one in logged],
            "replayed": {name: [one.as_dict() for one in each] for name, each in found.items()},
        }
        print(json.dumps(about, indent=2, allow_nan=False))
        return 0
    rule = _rule(scenario)
    print(
        f"Replayed with {', '.join(f'{name} {value}' for name, value in rule.items())}; {draws} draws of losses."
    )
    print(
        f"{first.put_back} samples without a row put back; {first.unsent:g} messages a draw that nobody can have sent "
        "at that time left out."
    )
    for session, own in enumerate(logged):
        print(f"\nsession {own.session}")
        print(_line("as logged", own, one=True))
        for name, each in found.items():
            print(_line(name, each[session], one=False))
    return 0


def _settings(arguments: argparse.Namespace) -> dict[str, Any]:
    from vibroswarm.lab.replay import REPLAYABLE
    from vibroswarm.scenario import field_names, parse_setting

    known = [name for name in field_names() if name.partition(".")[0] in REPLAYABLE]
    values: dict[str, Any] = {}
    if arguments.gate is not None:
        values["decision.gate"] = arguments.gate
    for text in arguments.settings:
        name, value = parse_setting(text)
        full = [one for one in known if name in (one, one.partition(".")[2])]
        if len(full) != 1:
            near = nearest(name, known + [one.partition(".")[2] for one in known])
            raise InputError(f"is no field that a replay can change{near}", field=name)
        values[full[0]] = value
    return values


def _rule(scenario: Scenario) -> dict[str, Any]:
    return {
        "rms_threshold": scenario.sensor.rms_threshold,
        "credible_threshold": scenario.decision.credible_threshold,
        "min_observations": scenario.decision.min_observations,
        "gate": scenario.decision.gate,
    }


def _line(name: str, told: Told, *, one: bool) -> str:
    came = ", ".join(
        outcome if one else f"{outcome} {100 * share:.3g} %" for outcome, share in told.consensus.items()
    )
    if told.decision_time_s is None:
        return f"  {name:<10} {came}"
    spread = "" if one else f" [{told.decision_time_low_s:.0f}, {told.decision_time_high_s:.0f}]"
    belief = "" if told.belief_in_truth is None else f"; belief in truth {told.belief_in_truth:.3f}"
    return (
        f"  {name:<10} {came}; decision time {told.decision_time_s:.1f} s{spread}; "
        f"undecided {100 * told.undecided:.3g} %{belief}"
    )
