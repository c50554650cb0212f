"""Options that several commands share."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_scenario_options(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """The options from which ``scenarios.scenario_from`` makes a scenario; gives their group."""
    what: argparse._ArgumentGroup = parser.add_argument_group("what is simulated")
    base = what.add_mutually_exclusive_group()
    base.add_argument(
        "--preset",
        metavar="NAME",
        help="paper (default), paper-empirical, text, calibrated, optimised-cost or optimised-error",
    )
    base.add_argument(
        "--scenario", metavar="FILE", type=Path, help="a scenario in TOML, such as a result holds"
    )
    what.add_argument("--floor", metavar="FLOOR", help="a pattern (diagonal:0.46), random:0.48, or a file")
    what.add_argument(
        "--tiles", metavar="RxC", help="rows x columns of a random floor, coordinate list or picture"
    )
    what.add_argument("--robots", metavar="N", help="how many robots")
    what.add_argument(
        "--strategy",
        metavar="NAME",
        help="what robots tell each other: none, positive, soft, or FILE.py:NAME",
    )
    what.add_argument("--network", metavar="NAME", help="who hears what: ideal, loss, or FILE.py:NAME")
    what.add_argument(
        "--task", metavar="NAME", help="what is asked of the floor: fill_ratio, or FILE.py:NAME"
    )
    what.add_argument("--energies", metavar="FILE", type=Path, help="draw from these measured energies (CSV)")
    what.add_argument(
        "--set", metavar="FIELD=VALUE", action="append", default=[], dest="settings",
        help="set any field of the scenario, such as walk.walk_duration_scale_ms=9000; may be repeated",
    )  # fmt: skip
    return what
