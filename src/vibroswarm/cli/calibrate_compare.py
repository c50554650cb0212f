"""``vibroswarm calibrate compare``: how similar the samples of recordings and simulations are."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vibroswarm.cli.deliver import print_result
from vibroswarm.cli.options import add_json, read_result
from vibroswarm.errors import InputError

EPILOG = """\
example:
  vibroswarm calibrate compare lab simulated --json
  vibroswarm calibrate compare lab by-event-engine by-mujoco   # which simplification matters
"""


def add_parser(tasks: Any) -> None:
    """Add the task ``compare``."""
    parser = tasks.add_parser(
        "compare",
        help="the paper's six similarities with their null values, and measures that discriminate",
        description="Compare the samples of two results (lab import, run --out); each run is a session.",
        epilog=EPILOG,
    )
    parser.add_argument("real", metavar="REAL", type=Path, help="folder of a recording")
    parser.add_argument(
        "simulated",
        metavar="SIM",
        type=Path,
        nargs="+",
        help="folder of a simulation, or of its imported log; several are shown side by side",
    )
    parser.add_argument(
        "--picture", metavar="FILE", type=Path, help="draw both side by side (.png, .svg, .pdf)"
    )
    parser.add_argument(
        "--pictures", metavar="DIR", type=Path, help="draw one file per feature into DIR, and one of all"
    )
    parser.add_argument(
        "--no-camera",
        action="store_true",
        help="take simulated positions as they are, not as the camera of SIM's scenario ([camera]) would see them",
    )
    parser.add_argument(
        "--intervals",
        action="store_true",
        help="also tell undisturbed intervals apart by turn and distance, with boosted trees (half a minute)",
    )
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Compare a recording with a simulation, print the comparison, and draw it if requested; return the exit code.

    If several simulations are given, ``_compare_several`` does the work instead.
    """
    from vibroswarm.calibrate.camera import RIGHT
    from vibroswarm.calibrate.real_vs_simulated import (
        compare,
        write_comparison_picture,
        write_comparison_pictures,
    )
    from vibroswarm.documents.calibration import comparison_document
    from vibroswarm.floors.io import check_suffix

    if len(arguments.simulated) > 1:
        return _compare_several(arguments)
    real, simulated = read_result(arguments.real), read_result(arguments.simulated[0])
    # RIGHT is a camera without error. With None, ``compare`` uses the camera of SIM's scenario, or RIGHT if the
    # positions need no change, as those of two recordings (``camera_between``).
    camera = RIGHT if arguments.no_camera else None
    comparison = compare(real, simulated, camera=camera, intervals=arguments.intervals)
    if arguments.picture is not None:
        check_suffix(arguments.picture, (".png", ".svg", ".pdf"))
        write_comparison_picture(real, simulated, comparison, arguments.picture)
    if arguments.pictures is not None:
        if arguments.pictures.is_file():
            raise InputError("is a file; give the name of a folder", field=str(arguments.pictures))
        write_comparison_pictures(real, simulated, comparison, arguments.pictures)
    print_result(comparison_document(comparison, intervals=arguments.intervals), arguments)
    return 0


def _compare_several(arguments: argparse.Namespace) -> int:
    """Compare several simulations with the same recording and print them side by side; return the exit code.

    The tables have energy distances and the classifier's shares, but no similarities; ``--json`` has all.

    Raises:
        InputError: an option is given that applies to one simulation only, a folder is given twice, or one cannot be
            compared; the error names it.
    """
    from vibroswarm.calibrate.camera import RIGHT
    from vibroswarm.calibrate.real_vs_simulated import compare
    from vibroswarm.calibrate.similarity import RealCache
    from vibroswarm.documents.calibration import comparisons_document

    for option in ("picture", "pictures"):
        if getattr(arguments, option) is not None:
            raise InputError("draws one simulation; give one SIM", field=f"--{option}")
    if arguments.intervals:
        raise InputError("is for one simulation; give one SIM", field="--intervals")
    if len({str(folder) for folder in arguments.simulated}) < len(arguments.simulated):
        raise InputError("names a folder twice", field="SIM")
    real = read_result(arguments.real)
    # The first comparison fills this cache with what depends on the recording only; the others reuse it.
    of_real_alone = RealCache()
    # RIGHT is a camera without error. With None, ``compare`` uses the camera of each SIM's scenario, or RIGHT if the
    # positions need no change, as those of two recordings (``camera_between``).
    camera = RIGHT if arguments.no_camera else None
    found = {}
    for folder in arguments.simulated:
        simulated = read_result(folder)
        try:
            found[str(folder)] = compare(real, simulated, of_real_alone, camera=camera)
        except InputError as error:
            raise InputError(
                f"cannot be compared with '{arguments.real}': {error}", field=str(folder)
            ) from None
    print_result(comparisons_document(found), arguments)
    return 0
