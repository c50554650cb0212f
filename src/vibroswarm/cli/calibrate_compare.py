"""``vibroswarm calibrate compare``: how similar the samples of recordings and simulations are."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import add_json, read_result
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.analysis.intervals import Interval
    from vibroswarm.calibrate.real_vs_simulated import Comparison

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
    from vibroswarm.calibrate.interval_classifier import LEAST
    from vibroswarm.calibrate.real_vs_simulated import (
        compare,
        write_comparison_picture,
        write_comparison_pictures,
    )
    from vibroswarm.cli.output import print_json, print_paragraph
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
    if arguments.json:
        print_json(comparison.as_dict())
    else:
        print_comparison(comparison)
        if arguments.intervals and comparison.intervals is None:
            print_paragraph(
                f"A session has fewer than {LEAST} undisturbed intervals: too few to tell them apart (--intervals)."
            )
    return 0


def _compare_several(arguments: argparse.Namespace) -> int:
    """Compare several simulations with the same recording and print them side by side; return the exit code.

    The printed tables have energy distances and the classifier's shares, but no similarities; ``--json`` has all.

    Raises:
        InputError: an option is given that applies to one simulation only, a folder is given twice, or one cannot be
            compared; the error names it.
    """
    from vibroswarm.calibrate.camera import RIGHT
    from vibroswarm.calibrate.real_vs_simulated import compare
    from vibroswarm.calibrate.similarity import RealCache
    from vibroswarm.cli.output import print_json

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
    if arguments.json:
        print_json({folder: comparison.as_dict() for folder, comparison in found.items()})
    else:
        print_comparisons(found)
    return 0


def print_comparisons(found: dict[str, Comparison]) -> None:
    """Print energy distances and the shares that a classifier recognises, with a column for each simulation.

    Args:
        found: the comparisons of one recording with each simulation, by the simulation's folder. A simulation that
            has too few values of a feature gets a dash. (``compare`` refuses one with too few samples for the
            classifier.)
    """
    from vibroswarm.calibrate.features import FEATURES, WORDS
    from vibroswarm.cli.output import print_line, print_paragraph, print_table

    names = [Path(folder).name for folder in found]
    if len(set(names)) < len(names):  # folders of the same name in different places: show their whole paths
        names = list(found)
    # for each simulation, the energy distances by feature
    distances = [{row.feature: row for row in comparison.distances} for comparison in found.values()]
    print_paragraph("Energy distance, effect size (0: same distribution, 1: no overlap; 95 % over sessions)")
    rows = []
    for feature in FEATURES:
        each = [by_feature.get(feature) for by_feature in distances]
        # The distance among the real sessions is the same in every comparison that has the feature.
        real = next((row.real for row in each if row is not None), None)
        cells = ["-" if row is None else over_sessions(row.effect, ".4f") for row in each]
        rows.append([WORDS[feature], over_sessions(real, ".4f"), *cells])
    print_table(["feature", "real - real", *(f"real - {name}" for name in names)], rows)
    print_line()
    print_paragraph("Share of stretches of 20 samples that a classifier recognises (0.5: chance)")
    accuracies = [comparison.classifier for comparison in found.values()]
    print_table(
        ["recognised", *names],
        [
            [words, *(over_sessions(share, ".3f") for share in shares)]
            for words, shares in (
                (
                    "real or simulated, robots and sessions not trained on",
                    [one.simulated for one in accuracies],
                ),
                ("real or simulated, robots not trained on", [one.simulated_by_robot for one in accuracies]),
            )
        ],
    )


def over_sessions(one: Interval | None, form: str, *, scale: float = 1.0) -> str:
    """Format an estimate with its interval over sessions, such as ``44.1 [41.0, 47.2]``; ``-`` for None.

    The estimate of a single session is printed without its limits, which are infinite (or 0 and 1 for a share), and an
    estimate that is undefined in every session as a dash.

    Args:
        form: format specification of each number, such as ``.3g``.
        scale: factor by which each number is multiplied.
    """
    from vibroswarm.cli.output import with_interval

    if one is not None and one.n == 1:  # one session has no interval over sessions
        return f"{scale * one.estimate:{form}}"
    return with_interval(one, form, scale=scale)


def print_comparison(found: Comparison) -> None:
    """Print the comparison of one simulation: similarities, energy distances, and what classifiers recognise.

    With a single real session, nothing is compared between real sessions: the cells "real - real" are dashes, and the
    classifiers have no row for "which real session".

    Args:
        found: the comparison of the recording with the simulation. The tables do not have its missing features, which
            are listed at the end.
    """
    from vibroswarm.calibrate.features import WORDS
    from vibroswarm.cli.output import print_line, print_paragraph, print_table

    _print_similarities(found)
    print_line()
    print_paragraph("Energy distance, effect size (0: same distribution, 1: no overlap; 95 % over sessions)")
    print_table(
        ["feature", "real - simulated", "real - real"],
        [
            [
                WORDS[distance.feature],
                over_sessions(distance.effect, ".4f"),
                over_sessions(distance.real, ".4f"),
            ]
            for distance in found.distances
        ],
    )
    classifier = found.classifier
    print_line()
    print_paragraph("Share of stretches of 20 samples that a classifier recognises (0.5: chance)")
    recognised = {
        "real or simulated, robots and sessions not trained on": classifier.simulated,
        "real or simulated, robots not trained on": classifier.simulated_by_robot,
        "which real session, robots not trained on": classifier.real,
    }
    print_table(
        ["recognised", "share"],
        [[name, over_sessions(share, ".3f")] for name, share in recognised.items() if share is not None],
    )
    _print_intervals(found)
    if found.missing:
        print_paragraph(
            f"Too few values to compare: {', '.join(WORDS[feature] for feature in found.missing)}"
        )


def _print_similarities(found: Comparison) -> None:
    """Print the cosine similarity of each feature between the recording and the simulation.

    The column "published" is computed as in the paper: of all samples, with the authors' avoidance times. All other
    columns use equal numbers of real and simulated values. The column "here" is the result, and two columns give its
    scale: "null" is the similarity of the recording to uniformly spread values, and "ceiling" is the similarity that is
    expected of two samples from the recording's own distribution. The columns of sessions have the mean and the range
    over pairs of sessions; a single real session has a dash in "session, real-real". The column "without camera" is
    "here" for the exact simulated positions; it is printed if the other columns use positions as the camera would see
    them.
    """
    from vibroswarm.calibrate.features import WORDS
    from vibroswarm.cli.output import print_line, print_paragraph, print_table

    without_camera = {similarity.feature: similarity for similarity in found.without_camera}
    if without_camera:
        print_paragraph(
            f"Simulated positions are as the camera of the recordings would see them ({found.camera.words}); "
            "--no-camera takes them as they are."
        )
        print_line()
    print_paragraph("Cosine similarity (published: of all samples; here: at equal counts)")
    print_table(
        [
            "feature",
            "published",
            "null",
            "here",
            *(["without camera"] if without_camera else []),
            "ceiling",
            "session, real-sim",
            "session, real-real",
            "",
        ],
        [
            [
                WORDS[similarity.feature],
                f"{similarity.as_published:.3f}",
                f"{similarity.null:.3f}",
                f"{similarity.at_equal_counts:.3f}",
                *([f"{without_camera[similarity.feature].at_equal_counts:.3f}"] if without_camera else []),
                f"{similarity.ceiling:.3f}",
                _spread(similarity.by_session),
                "-" if similarity.real_by_session is None else _spread(similarity.real_by_session),
                # the column without a header: a warning that uniformly spread values are at least as similar
                "" if similarity.at_equal_counts > similarity.null else "below its null",
            ]
            for similarity in found.similarities
        ],
    )


def _print_intervals(found: Comparison) -> None:
    """Print the shares of undisturbed intervals that boosted trees recognise by turn and distance.

    In an undisturbed interval, a robot drives from one sample to the next without avoidance or turn. Each cell has the
    mean share and the range over pairs of sessions. The columns "same robots" and "other robots" state whether the
    trees were trained on the robots on which they are tested. Nothing is printed if the trees were not requested, or if
    there were too few intervals.
    """
    from vibroswarm.cli.output import print_line, print_paragraph, print_table

    if found.intervals is None:
        return
    intervals = found.intervals
    by_one_feature = " and ".join(
        f"{share:.3f} by {name.partition('_')[0]}"  # turn of turn_rad, distance of distance_m
        for name, share in intervals.by_feature.items()
    )
    print_line()
    print_paragraph("Share of undisturbed intervals that boosted trees recognise by turn and distance")
    print_table(
        ["recognised", "same robots", "other robots"],
        [
            [name, _mean_and_range(accuracy.same_robots), _mean_and_range(accuracy.other_robots)]
            for name, accuracy in (
                ("real or simulated", intervals.simulated),
                ("which real session", intervals.real),
            )
            if accuracy.same_robots  # empty if there is no pair of sessions: a single real session
        ],
    )
    print_paragraph(f"Real or simulated, same robots, by one feature alone: {by_one_feature}.")


def _mean_and_range(shares: tuple[float, ...]) -> str:
    """Format the mean of shares, at least one, with the smallest and the largest, such as ``0.612 (0.580-0.640)``."""
    return f"{sum(shares) / len(shares):.3f} ({min(shares):.3f}-{max(shares):.3f})"


def _spread(one: Any) -> str:
    """Format a ``Spread``: its mean with the smallest and the largest value, such as ``0.912 (0.880-0.940)``."""
    return f"{one.mean:.3f} ({one.least:.3f}-{one.most:.3f})"
