"""``vibroswarm floors``: list, show, measure and make floors."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING, Any

from vibroswarm.cli import terminal
from vibroswarm.cli.deliver import print_result
from vibroswarm.cli.options import add_image_threshold, add_json, add_out, whole

if TYPE_CHECKING:  # imported when needed: --help stays fast
    import numpy as np
    from numpy.typing import NDArray

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
    from vibroswarm.documents.floor import floors_document
    from vibroswarm.floors.difficulty import measure
    from vibroswarm.floors.source import NAMES, pattern

    measured = {name: measure(pattern(name)) for name in NAMES}
    remark = "random:F, for example random:0.48, is another random floor for each run."
    print_result(floors_document(measured, remark), args)
    return 0


def _list_paper(args: argparse.Namespace) -> int:
    """Print each number of the paper's table of difficulties beside two recomputed numbers; return the exit code.

    The first recomputed number is computed as the paper did it, the second is the correct value. The paper's number,
    which has two decimals, is marked "differs" if it is not the correct value rounded to two decimals.
    """
    from vibroswarm.documents.floor import paper_floors_document
    from vibroswarm.floors.difficulty import paper_table

    print_result(paper_floors_document(paper_table()), args)
    return 0


def _show(args: argparse.Namespace) -> int:
    """Draw a floor in the terminal, describe its difficulty, and save a picture if ``--out`` is given.

    Returns the exit code.
    """
    from vibroswarm.documents.floor import tiles_document

    tiles, name = _resolved(args.spec, args)
    if args.out is not None:
        from vibroswarm.plots.run import draw_floor

        draw_floor(args.out, tiles, name, replace=args.force)
    print_result(tiles_document(name, tiles, in_terminal(tiles)), args)
    if args.out is not None:
        print(f"Saved: {args.out}")
    return 0


def _measure(args: argparse.Namespace) -> int:
    """Print the measures of difficulty of the given floors; return the exit code."""
    from vibroswarm.documents.floor import floors_document
    from vibroswarm.floors.difficulty import measure

    measured = {spec: measure(_resolved(spec, args)[0]) for spec in args.specs}
    print_result(floors_document(measured), args)
    return 0


def _make(args: argparse.Namespace) -> int:
    """Make a floor of the given difficulty, print and save it; return the exit code.

    The exit code is 1 if no floor within the tolerance was found; the nearest floor is then printed and saved.
    """
    from vibroswarm.documents.floor import design_document
    from vibroswarm.floors.design import make_floor
    from vibroswarm.floors.grid_text import parse_tiles
    from vibroswarm.floors.io import check_new, write_tiles

    rows, columns = parse_tiles(args.tiles)
    if args.out is not None:
        check_new(args.out, replace=args.force)  # refuse the file before the work
    design = make_floor(rows, columns, args.fill_ratio, args.moran, args.entropy, args.seed)
    if args.out is not None:
        write_tiles(args.out, design.tiles, replace=args.force)
    target = {"fill_ratio": args.fill_ratio, "moran_index": args.moran, "entropy": args.entropy}
    print_result(design_document(design, target, in_terminal(design.tiles)), args)
    if args.out is not None and not args.json:
        print(f"Saved: {args.out}")
    return 0 if design.reached else 1


def in_terminal(tiles: NDArray[np.uint8]) -> str:
    """Draw a floor as lines of text, with the characters that the terminal has."""
    from vibroswarm.floors.io import can_draw_blocks, draw

    return draw(tiles, blocks=can_draw_blocks(sys.stdout), width=terminal.width())


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
