"""``vibroswarm calibrate fit``: a scenario fitted to recordings."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.calibrate.fit import Fit
    from vibroswarm.calibrate.folds import Fold
    from vibroswarm.result import Result

EPILOG = """\
examples:
  vibroswarm calibrate fit lab --out mine.toml
  vibroswarm calibrate fit lab --folds --against authors
"""


def add_parser(tasks: Any) -> None:
    """Make the task known."""
    parser = tasks.add_parser(
        "fit",
        help="fit a scenario to recordings, and judge it on sessions that it was not fitted on",
        description="Fit what robots are (speeds, veer, avoidance, sensing, losses) to recordings; what they were told "
        "(sampling interval, leg times, decisions) is the base's.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument(
        "folders", metavar="REAL", type=Path, nargs="+", help="folders of recordings (lab import)"
    )
    parser.add_argument("--out", metavar="FILE", type=Path, help="write the fitted scenario as TOML")
    parser.add_argument(
        "--base",
        metavar="NAME",
        default="paper-empirical",
        help="preset or scenario file of what the robots were told",
    )
    parser.add_argument(
        "--set", metavar="FIELD=VALUE", action="append", default=[], help="fields of the base"
    )
    parser.add_argument(
        "--folds", action="store_true", help="hold each session out in turn and judge the fit on it"
    )
    parser.add_argument(
        "--against", metavar="SIM", type=Path, help="with --folds: sessions of another simulator"
    )
    parser.add_argument("--candidates", metavar="N", help="runs to find avoidance with (2400)")
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> int:
    """Read, fit, judge, write, tell."""
    from vibroswarm.calibrate.fit import fit
    from vibroswarm.calibrate.folds import folds
    from vibroswarm.calibrate.measured import measured

    candidates = _candidates(arguments.candidates)
    base = base_of(arguments.base, arguments.set)
    if arguments.out is not None and arguments.out.suffix != ".toml":
        raise InputError("is no name for a scenario; one that ends in .toml", field=str(arguments.out))
    found = measured([_read(folder) for folder in arguments.folders])
    other = None if arguments.against is None else measured([_read(arguments.against)])
    fitted = fit(found, base, candidates=candidates, progress=progress_of("fit"))
    judged = (
        folds(found, base, other, candidates=candidates, progress=progress_of("folds"))
        if arguments.folds
        else []
    )
    if arguments.out is not None:
        _write(fitted, arguments.out)
    if arguments.json:
        about = fitted.as_dict() | {"folds": [one.as_dict() for one in judged]}
        print(json.dumps(about, indent=2, allow_nan=False))
        return 0
    print("\n".join(fit_lines(fitted) + (fold_lines(judged) if judged else [])))
    if arguments.out is not None:
        print(f"\nWritten to {arguments.out}.")
    return 0


def _candidates(text: str | None) -> int | None:
    if text is None:
        return None
    if not text.isdigit() or not 200 <= int(text) <= 200_000:
        raise InputError(f"'{text}' is no number of runs from 200 to 200000", field="--candidates")
    return int(text)


def base_of(name: str, settings: list[str]) -> Any:
    """A preset or scenario file with fields set."""
    from vibroswarm.cli.warned import warn_of
    from vibroswarm.presets import preset, preset_names
    from vibroswarm.scenario import Scenario, parse_setting

    base = (
        Scenario.read(name) if name not in preset_names() and Path(name).suffix == ".toml" else preset(name)
    )
    scenario = base.with_values(dict(parse_setting(one) for one in settings))
    warn_of([scenario])
    return scenario


def _read(folder: Path) -> Result:
    from vibroswarm.lab.recording import Recording
    from vibroswarm.result import Result

    return Recording.read(folder) if (folder / "recording.json").is_file() else Result.read(folder)


def progress_of(what: str) -> Any:
    """Tells the share done on a terminal; None elsewhere."""
    if not sys.stderr.isatty():
        return None

    def tell(share: float) -> None:
        print(f"\r{what} {100 * share:3.0f} %", end="" if share < 1 else "\n", file=sys.stderr, flush=True)

    return tell


def _write(fitted: Fit, path: Path) -> None:
    from vibroswarm.files import whole_file

    with whole_file(path) as part:
        part.write_text(fitted.scenario.to_toml(), encoding="utf-8")


def fit_lines(found: Fit) -> list[str]:
    """The fit in plain lines."""
    lines = [f"Fitted on {found.sessions} sessions, with {found.motion_runs} runs of motion", ""]
    lines.append(f"{'figure':<32}{'value':>11} {'s.e.':>10}   95 %")
    lines += [
        f"{one.name:<32}{one.value:>11.5g} {one.error:>10.2g}   [{one.low:.4g}, {one.high:.4g}]"
        for one in found.figures
    ]
    lines += ["", "Fields of the scenario"]
    lines += [f"  {name} = {_toml(value)}" for name, value in found.changed.items()]
    lines += ["", "Predictive check of avoidance: recorded, and 95 % of single sessions by the fit"]
    lines += [
        f"  {name:<24}{recorded:>9.4f}   [{low:.4f}, {high:.4f}]{'' if low <= recorded <= high else '  outside'}"
        for name, (recorded, low, high) in found.predicted.items()
    ]
    from vibroswarm.calibrate.fit import LACKS

    return [*lines, "", "What the model lacks:", *(f"  {one}" for one in LACKS)]


def _toml(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else repr(value).replace("'", '"')


def fold_lines(judged: list[Fold]) -> list[str]:
    """The folds in plain lines: means over them."""
    import numpy as np

    from vibroswarm.calibrate.features import WORDS

    def mean(k: int, name: str) -> str:
        values = [getattr(one.scores[k], name) for one in judged]
        return f"{np.mean(values):>9.4f}"

    lines = [
        "",
        f"Fitted on the others, judged on the one held out: mean over {len(judged)}",
        f"{'':<28}{'similarity at equal counts':<33}energy distance",
        f"{'':<28}{'fitted':>9}{'real':>9}{'against':>9}      {'fitted':>9}{'real':>9}{'against':>9}",
    ]
    for k, one in enumerate(judged[0].scores):
        alike = "".join(mean(k, name) for name in ("fitted", "other_sessions", "other_simulator"))
        apart = "".join(mean(k, f"distance_{name}") for name in ("fitted", "sessions", "simulator"))
        lines.append(f"{WORDS[one.feature]:<28}{alike}      {apart}")
    told, other = (
        np.mean([getattr(one, name) for one in judged]) for name in ("told_fitted", "told_simulator")
    )
    beside = f", from the other simulator's {other:.3f}" if np.isfinite(other) else ""
    lines += [
        "",
        f"Share of stretches told from simulated ones, other robots (0.5: chance): {told:.3f}{beside}",
        "",
        f"{'held-out sessions':<44}{'recorded':>9}{'fitted':>9}   standard deviations of a session, each",
    ]
    for reading in judged[0].readings:
        same = [each for fold in judged for each in fold.readings if each.name == reading.name]
        off = ", ".join(f"{each.deviation:+.1f}" for each in same)
        recorded, simulated = (
            np.mean([getattr(each, name) for each in same]) for name in ("recorded", "simulated")
        )
        lines.append(f"{reading.name:<44}{recorded:>9.3f}{simulated:>9.3f}   {off}")
    return lines
