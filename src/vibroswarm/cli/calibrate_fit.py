"""``vibroswarm calibrate fit``: fit a scenario to recordings."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from vibroswarm.cli.deliver import print_result
from vibroswarm.cli.options import add_json, add_settings, between, toml_file, whole
from vibroswarm.cli.terminal import printing

if TYPE_CHECKING:
    from vibroswarm.calibrate.cross_validation import Fold
    from vibroswarm.result import Result
    from vibroswarm.scenario.scenario import Scenario

EPILOG = """\
examples:
  vibroswarm calibrate fit lab --out mine.toml
  vibroswarm calibrate fit lab --folds --against authors
"""
CANDIDATES = 4000
"""Default of ``--candidates``: that of ``fit_avoidance``, which takes long to import; a test compares them."""

WALK_SETTINGS: Final = ("sample.sample_interval_ms", "sample.timer")
"""Settings that are inferred from recordings, and with which the robots of the base must run too."""


def add_parser(tasks: Any) -> None:
    """Add the task ``fit``."""
    parser = tasks.add_parser(
        "fit",
        help="fit a scenario to recordings, and validate it on held-out sessions",
        description="Fit the robots (speeds, veer, avoidance, sensing, losses) to recordings; their programmed "
        "settings (sampling interval, leg times, decisions) come from --base.",
        epilog=EPILOG,
    )
    parser.add_argument(
        "folders", metavar="REAL", type=Path, nargs="+", help="folders of recordings (lab import)"
    )
    parser.add_argument("--out", metavar="FILE", type=toml_file, help="write the fitted scenario as TOML")
    parser.add_argument("--force", action="store_true", help="replace FILE if it exists")
    parser.add_argument(
        "--base",
        metavar="NAME",
        default="paper-empirical",
        help="preset or scenario file with the robots' settings (default paper-empirical)",
    )
    add_settings(parser, "set a field of the base")
    parser.add_argument(
        "--folds", action="store_true", help="hold out each session in turn and validate the fit on it"
    )
    parser.add_argument(
        "--against", metavar="SIM", type=Path, help="with --folds: sessions of another simulator"
    )
    parser.add_argument(
        "--candidates",
        metavar="N",
        type=between(whole, 200, 200_000),
        default=CANDIDATES,
        help=f"runs for fitting avoidance (default {CANDIDATES})",
    )
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Fit a scenario to recordings, save and print it; validate it on held-out sessions if requested.

    An existing file ``--out`` is replaced only with ``--force``. ``--against`` has no effect without ``--folds``.
    Returns the exit code.
    """
    from vibroswarm.calibrate.cross_validation import folds
    from vibroswarm.calibrate.dataset import dataset_of
    from vibroswarm.calibrate.fit import fit
    from vibroswarm.cli.options import read_result
    from vibroswarm.core.atomic_io import check_free, whole_file
    from vibroswarm.documents.fit import fit_document
    from vibroswarm.errors import InputError

    candidates = arguments.candidates
    if arguments.out is None and arguments.force:
        raise InputError("has no effect without --out FILE", field="--force")
    if arguments.out is not None and not arguments.force:
        check_free(arguments.out)  # now, since the fit takes long
    base = scenario_of(arguments.base, arguments.settings)
    results = [read_result(folder) for folder in arguments.folders]
    warn_of_settings(results, base)
    dataset = dataset_of(results)
    # the sessions of another simulator, whose similarity to the held-out sessions is printed beside that of the fit
    other = None if arguments.against is None else dataset_of([read_result(arguments.against)])
    fitted = fit(dataset, base, candidates=candidates, progress=share_done("fit"))
    judged: list[Fold] = []
    if arguments.folds:
        judged = folds(dataset, base, other, candidates=candidates, progress=share_done("folds"))
    if arguments.out is not None:
        with whole_file(arguments.out, replace=arguments.force) as part:
            part.write_text(fitted.scenario.to_toml(), encoding="utf-8")
    print_result(fit_document(fitted, judged), arguments)
    if arguments.out is not None and not arguments.json:
        print(f"\nSaved: {arguments.out}")
    return 0


def warn_of_settings(results: Sequence[Result], base: Scenario) -> None:
    """Print a warning for each setting of the walk that was inferred from the recordings and that the base contradicts.

    Only the settings that determine when robots sample count (``WALK_SETTINGS``): others are the user's choice.
    """
    for name in WALK_SETTINGS:
        section, field = name.split(".")
        told = getattr(getattr(base, section), field)
        for one in (
            one for result in results for one in getattr(result, "inferred", ()) if one["name"] == name
        ):
            low, high = one["low"], one["high"]
            fits = told == one["value"] if low is None else low <= told <= high
            if one["value"] is not None and not fits:
                known = f"{name} is {told} in the base, but {one['value']} in the recordings"
                print(f"Warning: {known}; add --set {name}={one['value']}.", file=sys.stderr)
                break


def scenario_of(name: str, settings: list[str]) -> Scenario:
    """Return the scenario of a preset or file, with fields set by ``--set``, and print warnings about it.

    Args:
        name: name of a preset, or path of a file that ends in .toml. For any other name, ``preset`` raises an error
            that lists the presets.
        settings: the values of ``--set``, texts FIELD=VALUE.
    """
    from vibroswarm.cli.scenario_warnings import warn_of
    from vibroswarm.scenario.presets import preset_names
    from vibroswarm.scenario.scenario import Scenario, parse_setting, preset

    is_file = name not in preset_names() and Path(name).suffix == ".toml"
    base = Scenario.read(name) if is_file else preset(name)
    scenario = base.with_values(dict(parse_setting(setting) for setting in settings))
    warn_of([scenario])
    return scenario


def share_done(what: str) -> Callable[[float], None] | None:
    """Return a function that prints the share of work done, 0 to 1, on one line of stderr.

    Args:
        what: name of the work, printed before the share.
    Returns:
        The function; None if stderr is not a terminal, or with ``--quiet``.
    """
    if not sys.stderr.isatty() or printing.quiet:
        return None

    def progress(share: float) -> None:
        print(f"\r{what} {100 * share:3.0f} %", end="" if share < 1 else "\n", file=sys.stderr, flush=True)

    return progress
