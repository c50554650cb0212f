"""``vibroswarm floors``: list, show, measure and make floors."""

from __future__ import annotations

import argparse
import math
import sys
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import add_image_threshold, add_json, add_out, whole
from vibroswarm.cli.output import print_json, print_paragraph, print_table

if TYPE_CHECKING:  # imported when needed: --help stays fast
    import numpy as np
    from numpy.typing import NDArray

    from vibroswarm.floors.difficulty import Difficulty

_SPEC = "pattern (diagonal:0.48), random:0.48, or file (text, CSV, coordinates, PNG)"
"""Help on the argument FLOOR."""


def add_parser(commands: Any) -> None:
    """Add the command ``floors`` and its subcommands ``list``, ``show``, ``measure`` and ``make``."""
    parser = commands.add_parser(
        "floors",
        help="list, show, measure and make floors",
        description="List, show, measure and make floors.",
    )
    parts = parser.add_subparsers(dest="part", metavar="PART", required=True)
    part = parts.add_parser("list", help="list known patterns and their difficulty")
    part.add_argument("--paper", action="store_true", help="the paper's table with the right values")
    add_json(part)
    part.set_defaults(run=_list)

    part = parts.add_parser("show", help="draw a floor in the terminal or to a file")
    part.add_argument("spec", metavar="FLOOR", help=_SPEC)
    _add_tiles(part)
    _add_seed(part, "seed of a random floor")
    add_out(part, "picture to write: .png, .svg or .pdf", metavar="FILE", force=True)
    part.set_defaults(run=_show)

    part = parts.add_parser("measure", help="measure fill ratio, Moran index, entropy and clusters")
    part.add_argument("specs", metavar="FLOOR", nargs="+", help=_SPEC)
    _add_tiles(part)
    _add_seed(part, "seed of a random floor")
    add_json(part)
    part.set_defaults(run=_measure)

    part = parts.add_parser(
        "make",
        help="make a floor of given difficulty",
        description="Make a floor of given fill ratio, Moran index and entropy, each to within 0.02. Exit code 0 if "
        "one is found; 1 if not, and then the nearest one is given.",
    )
    part.add_argument("--tiles", metavar="RxC", required=True, help="rows x columns, for example 20x20")
    part.add_argument("--fill-ratio", metavar="F", type=float, required=True, help="share of vibrating tiles")
    part.add_argument("--moran", metavar="M", type=float, required=True, help="Moran index, -1 to 1")
    part.add_argument("--entropy", metavar="E", type=float, help="entropy, 0 to 1 (default: any)")
    _add_seed(part, "another seed makes another floor")
    add_out(part, "file to write: .txt, .csv or .png (one pixel per tile)", metavar="FILE", force=True)
    add_json(part)
    part.set_defaults(run=_make)


def _add_tiles(parser: argparse.ArgumentParser) -> None:
    """Add the option for the numbers of rows and columns of a floor."""
    parser.add_argument(
        "--tiles",
        metavar="RxC",
        help="rows x columns of a random floor (default 5x5), coordinate list or picture",
    )
    add_image_threshold(parser)


def _add_seed(parser: argparse.ArgumentParser, help: str) -> None:
    """Add the option for the seed of a random floor; ``help`` says what the seed does."""
    parser.add_argument("--seed", metavar="N", type=whole, default=0, help=f"{help} (default 0)")


def _list(args: argparse.Namespace) -> int:
    """Print the known patterns with their difficulty, or with ``--paper`` the paper's table of difficulties.

    Returns the exit code.
    """
    if args.paper:
        return _list_paper(args)
    from vibroswarm.floors.difficulty import measure
    from vibroswarm.floors.source import NAMES, pattern

    measured = [(name, measure(pattern(name))) for name in NAMES]
    if args.json:
        print_json([as_json(name, difficulty) for name, difficulty in measured])
        return 0
    _print_measures(measured)
    print()
    print_paragraph("random:F, for example random:0.48, is another random floor for each run.")
    return 0


def _list_paper(args: argparse.Namespace) -> int:
    """Print each number of the paper's table of difficulties beside two recomputed numbers; return the exit code.

    The first recomputed number is computed as the paper did it, the second is the correct value. The paper's number,
    which has two decimals, is marked "differs" if it is not the correct value rounded to two decimals.
    """
    from dataclasses import asdict

    from vibroswarm.floors.difficulty import paper_table

    table = paper_table()
    if args.json:
        print_json([{**asdict(entry), "wrong": entry.wrong} for entry in table])
        return 0
    print_table(
        ["pattern", "measure", "printed", "recomputed", "right", ""],
        [
            [
                entry.pattern,
                entry.measure,
                f"{entry.printed:.2f}",
                f"{entry.as_the_paper:.4f}",
                f"{entry.right:.4f}",
                "differs" if entry.wrong else "",
            ]
            for entry in table
        ],
        names=2,  # pattern and measure name a row
    )
    print()
    print_paragraph(
        "'recomputed': as in the paper, with 48 vibrating tiles for every entropy, and with the floor "
        "alternating:paper-0.46, which has 48 of them, in place of alternating:0.46."
    )
    return 0


def _show(args: argparse.Namespace) -> int:
    """Draw a floor in the terminal, describe its difficulty, and save a picture if ``--out`` is given.

    Returns the exit code.
    """
    import shutil

    from vibroswarm.floors.difficulty import measure
    from vibroswarm.floors.io import can_draw_blocks, draw

    tiles, name = _resolved(args.spec, args)
    if args.out is not None:
        from vibroswarm.plots.run import draw_floor

        draw_floor(args.out, tiles, name, replace=args.force)
    print(draw(tiles, blocks=can_draw_blocks(sys.stdout), width=shutil.get_terminal_size().columns))
    print_paragraph(in_words(measure(tiles)))
    if args.out is not None:
        print(f"Saved: {args.out}")
    return 0


def _measure(args: argparse.Namespace) -> int:
    """Print the measures of difficulty of the given floors; return the exit code."""
    from vibroswarm.floors.difficulty import measure

    measured = [(spec, measure(_resolved(spec, args)[0])) for spec in args.specs]
    if args.json:
        print_json([as_json(name, difficulty) for name, difficulty in measured])
    else:
        _print_measures(measured)
    return 0


def _make(args: argparse.Namespace) -> int:
    """Make a floor of the given difficulty, print and save it; return the exit code.

    The exit code is 1 if no floor within the tolerance was found; the nearest floor is then printed and saved. With
    ``--json``, "asked" has the requested difficulty, and the other measures are those of the floor that was made.
    """
    import shutil

    from vibroswarm.floors.design import make_floor
    from vibroswarm.floors.grid_text import parse_tiles
    from vibroswarm.floors.io import can_draw_blocks, check_new, draw, write_tiles

    rows, columns = parse_tiles(args.tiles)
    if args.out is not None:
        check_new(args.out, replace=args.force)  # refuse the file before the work
    design = make_floor(rows, columns, args.fill_ratio, args.moran, args.entropy, args.seed)
    if args.out is not None:
        write_tiles(args.out, design.tiles, replace=args.force)
    if args.json:
        target = {"fill_ratio": args.fill_ratio, "moran_index": args.moran, "entropy": args.entropy}
        rows_of_tiles = ["".join(map(str, row)) for row in design.tiles.tolist()]
        reached = as_json(f"made with seed {args.seed}", design.difficulty)
        print_json(
            {
                "reached": design.reached,
                "words": design.words,
                "asked": target,
                **reached,
                "tiles": rows_of_tiles,
            }
        )
        return 0 if design.reached else 1
    print(draw(design.tiles, blocks=can_draw_blocks(sys.stdout), width=shutil.get_terminal_size().columns))
    print_paragraph(design.words)
    if args.out is not None:
        print(f"Saved: {args.out}")
    return 0 if design.reached else 1


def _resolved(spec: str, args: argparse.Namespace) -> tuple[NDArray[np.uint8], str]:
    """Return the tiles (rows, columns) and the name of the floor that ``spec`` and the options describe.

    The seed selects one random floor; it has no effect on other floors.
    """
    from vibroswarm.errors import share_from
    from vibroswarm.floors.grid_text import parse_tiles
    from vibroswarm.floors.io import THRESHOLD
    from vibroswarm.floors.source import resolve

    size = None if args.tiles is None else parse_tiles(args.tiles)
    given = args.image_threshold
    threshold = THRESHOLD if given is None else share_from(given, "--image-threshold")
    return resolve(spec, size, args.seed, threshold=threshold)


def _print_measures(found: list[tuple[str, Difficulty]]) -> None:
    """Print the measures of floors, each with its name, as a table."""
    print_table(
        ["floor", "tiles", "vibrating", "fill", "Moran", "entropy", "clusters"],
        [
            [
                name,
                f"{d.rows}x{d.columns}",
                d.ones,
                f"{d.fill_ratio:.4f}",
                _number(d.moran_index),
                _number(d.entropy),
                d.clusters,
            ]
            for name, d in found
        ],
    )


def in_words(d: Difficulty) -> str:
    """Describe a floor in one line: size, vibrating tiles, and its measures of difficulty."""
    clusters = (
        "1 cluster"
        if d.clusters == 1
        else f"{d.clusters} clusters, the largest has {d.largest_cluster} tiles"
    )
    return (
        f"{d.rows} x {d.columns} tiles, {d.ones} vibrating: fill ratio {d.fill_ratio:.4g}, Moran index "
        f"{_number(d.moran_index)}, entropy {_number(d.entropy)}, {clusters}"
    )


def _number(value: float) -> str:
    """Format a measure with three decimals; "none" if it is NaN, which means undefined."""
    return "none" if math.isnan(value) else f"{value:.3f}"


def as_json(name: str, difficulty: Difficulty) -> dict[str, Any]:
    """Return a floor's name and measures for JSON, in which an undefined measure (NaN) is None."""
    from dataclasses import asdict

    # only NaN differs from itself; the measures are integers and floats
    values = {key: None if value != value else value for key, value in asdict(difficulty).items()}
    return {"floor": name, **values}
