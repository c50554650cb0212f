"""``vibroswarm floors``: list, show, measure and make floors."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # heavy: loaded by the commands that need them, so that --help is quick
    import numpy as np
    from numpy.typing import NDArray

    from vibroswarm.floors.difficulty import Difficulty

_SPEC = "a pattern (diagonal:0.48), random:0.48, or a file (text, CSV, coordinates, PNG)"


def add_parser(commands: Any) -> None:
    """Register the command and its four parts."""
    parser = commands.add_parser(
        "floors",
        help="list, show, measure and make floors",
        description="List, show, measure and make floors.",
        allow_abbrev=False,
    )
    parts = parser.add_subparsers(dest="part", metavar="PART", required=True)
    _add_list(parts)
    _add_show(parts)
    _add_measure(parts)
    _add_make(parts)


def _add_list(parts: Any) -> None:
    parser = parts.add_parser("list", help="the known patterns and how hard they are", allow_abbrev=False)
    parser.add_argument("--paper", action="store_true", help="the paper's table beside the right values")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.set_defaults(run=_list)


def _add_show(parts: Any) -> None:
    parser = parts.add_parser("show", help="draw a floor, here or to a picture", allow_abbrev=False)
    parser.add_argument("spec", metavar="FLOOR", help=_SPEC)
    _add_tiles(parser)
    _add_seed(parser, "which random floor")
    _add_out(parser, "picture to write: .png, .svg or .pdf")
    parser.set_defaults(run=_show)


def _add_measure(parts: Any) -> None:
    parser = parts.add_parser(
        "measure", help="fill ratio, Moran index, entropy and clusters", allow_abbrev=False
    )
    parser.add_argument("specs", metavar="FLOOR", nargs="+", help=_SPEC)
    _add_tiles(parser)
    _add_seed(parser, "which random floor")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.set_defaults(run=_measure)


def _add_make(parts: Any) -> None:
    parser = parts.add_parser(
        "make",
        help="make a floor of given difficulty",
        allow_abbrev=False,
        description="Make a floor of given fill ratio, Moran index and entropy, each to 0.02. Exit code 0 if it "
        "was found, 1 if not; then the nearest found is given.",
    )
    parser.add_argument("--tiles", metavar="RxC", required=True, help="rows x columns, for example 20x20")
    parser.add_argument("--fill-ratio", metavar="F", type=float, required=True, help="share that vibrates")
    parser.add_argument("--moran", metavar="M", type=float, required=True, help="Moran index, -1 to 1")
    parser.add_argument("--entropy", metavar="E", type=float, help="entropy, 0 to 1 (without: any)")
    _add_seed(parser, "another seed makes another floor")
    _add_out(parser, "file to write: .txt, .csv or .png (one pixel a tile)")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.set_defaults(run=_make)


def _add_tiles(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--tiles",
        metavar="RxC",
        help="rows x columns of a random floor (without: 5x5), of a list of coordinates, or shown by a picture",
    )


def _add_seed(parser: argparse.ArgumentParser, text: str) -> None:
    parser.add_argument("--seed", metavar="N", type=int, default=0, help=f"{text} (default: 0)")


def _add_out(parser: argparse.ArgumentParser, text: str) -> None:
    parser.add_argument("--out", metavar="FILE", type=Path, help=text)
    parser.add_argument("--force", action="store_true", help="replace FILE if it is there")


def _list(args: argparse.Namespace) -> int:
    if args.paper:
        return _list_paper(args)
    from vibroswarm.floors.difficulty import measure
    from vibroswarm.floors.patterns import NAMES, pattern

    found = [(name, measure(pattern(name))) for name in NAMES]
    if args.json:
        _print_json([_as_json(name, difficulty) for name, difficulty in found])
        return 0
    _print_measures(found)
    print("\nrandom:F, for example random:0.48, is a fresh random floor for each run.")
    return 0


def _list_paper(args: argparse.Namespace) -> int:
    from dataclasses import asdict

    from vibroswarm.floors.paper_table import paper_table

    table = paper_table()
    if args.json:
        _print_json([{**asdict(entry), "wrong": entry.wrong} for entry in table])
        return 0
    print(f"{'pattern':<20} {'measure':<12} {'printed':>8} {'as it did':>10} {'right':>8}")
    for entry in table:
        print(
            f"{entry.pattern:<20} {entry.measure:<12} {entry.printed:>8.2f} {entry.as_the_paper:>10.4f} "
            f"{entry.right:>8.4f}{'  differs' if entry.wrong else ''}"
        )
    print(
        "\n'as it did': computed as the paper did, with 48 vibrating tiles for every entropy, and with the floor\n"
        "alternating:paper-0.46, which has 48 of them, for alternating:0.46."
    )
    return 0


def _show(args: argparse.Namespace) -> int:
    import shutil

    from vibroswarm.floors.difficulty import measure
    from vibroswarm.floors.text import can_draw_blocks, draw

    tiles, name = _resolved(args.spec, args)
    if args.out is not None:
        from vibroswarm.plots.floor import draw_floor

        draw_floor(args.out, tiles, name, replace=args.force)
    print(draw(tiles, blocks=can_draw_blocks(sys.stdout), width=shutil.get_terminal_size().columns))
    print(_in_words(measure(tiles)))
    if args.out is not None:
        print(f"written: {args.out}")
    return 0


def _measure(args: argparse.Namespace) -> int:
    from vibroswarm.floors.difficulty import measure

    found = [(spec, measure(_resolved(spec, args)[0])) for spec in args.specs]
    if args.json:
        _print_json([_as_json(name, difficulty) for name, difficulty in found])
    else:
        _print_measures(found)
    return 0


def _make(args: argparse.Namespace) -> int:
    import shutil

    from vibroswarm.floors.design import make_floor
    from vibroswarm.floors.files import check_new, parse_tiles, write_tiles
    from vibroswarm.floors.text import can_draw_blocks, draw

    rows, columns = parse_tiles(args.tiles)
    if args.out is not None:
        check_new(args.out, replace=args.force)  # before the work, not after it
    made = make_floor(rows, columns, args.fill_ratio, args.moran, args.entropy, args.seed)
    if args.out is not None:
        write_tiles(args.out, made.tiles, replace=args.force)
    if args.json:
        asked = {"fill_ratio": args.fill_ratio, "moran_index": args.moran, "entropy": args.entropy}
        rows_of_tiles = ["".join(map(str, row)) for row in made.tiles.tolist()]
        reached = _as_json(f"made with seed {args.seed}", made.difficulty)
        _print_json(
            {"reached": made.reached, "words": made.words, "asked": asked, **reached, "tiles": rows_of_tiles}
        )
        return 0 if made.reached else 1
    print(draw(made.tiles, blocks=can_draw_blocks(sys.stdout), width=shutil.get_terminal_size().columns))
    print(made.words)
    if args.out is not None:
        print(f"written: {args.out}")
    return 0 if made.reached else 1


def _resolved(spec: str, args: argparse.Namespace) -> tuple[NDArray[np.uint8], str]:
    from vibroswarm.floors.files import parse_tiles
    from vibroswarm.floors.source import resolve

    return resolve(spec, parse_tiles(args.tiles) if args.tiles is not None else None, args.seed)


def _print_measures(found: list[tuple[str, Difficulty]]) -> None:
    wide = max(5, *(len(name) for name, _ in found))
    print(
        f"{'floor':<{wide}} {'tiles':>9} {'vibrating':>9} {'fill':>7} {'Moran':>7} {'entropy':>7} {'clusters':>8}"
    )
    for name, d in found:
        print(
            f"{name:<{wide}} {f'{d.rows}x{d.columns}':>9} {d.ones:>9} {d.fill_ratio:>7.4f} "
            f"{_number(d.moran_index):>7} {_number(d.entropy):>7} {d.clusters:>8}"
        )


def _in_words(d: Difficulty) -> str:
    clusters = (
        "1 cluster" if d.clusters == 1 else f"{d.clusters} clusters, the largest of {d.largest_cluster}"
    )
    return (
        f"{d.rows} x {d.columns} tiles, {d.ones} vibrating: fill ratio {d.fill_ratio:.4g}, Moran index "
        f"{_number(d.moran_index)}, entropy {_number(d.entropy)}, {clusters}"
    )


def _number(value: float) -> str:
    return "none" if math.isnan(value) else f"{value:.3f}"


def _as_json(name: str, difficulty: Difficulty) -> dict[str, Any]:
    from dataclasses import asdict

    values = {key: None if value != value else value for key, value in asdict(difficulty).items()}
    return {"floor": name, **values}


def _print_json(document: Any) -> None:
    print(json.dumps(document, indent=2, allow_nan=False))
