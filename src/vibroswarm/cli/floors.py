"""``vibroswarm floors``: list, show, measure and make floors."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from vibroswarm.cli import terminal
from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import print_document, print_saved_file
from vibroswarm.cli.option_values import refuse
from vibroswarm.cli.options import Force, ImageThreshold, Json, Tiles
from vibroswarm.errors import named, shown

if TYPE_CHECKING:  # imported when needed: --help stays fast
    import numpy as np
    from numpy.typing import NDArray

    from vibroswarm.floors.floor import Floor

FLOOR = Option("pattern (diagonal:0.48), random:0.48, or file (text, CSV, coordinates, PNG, JPEG)", "FLOOR")
Seed = Annotated[int | None, Option("seed of a random floor (default 0)")]


def list_patterns(
    *, paper: Annotated[bool, Option("the paper's table with the right values")] = False, json: Json = False
) -> None:
    """List the known patterns and their difficulty."""
    from vibroswarm.documents.floor import floors_document, paper_floors_document
    from vibroswarm.floors.difficulty import measure
    from vibroswarm.floors.source import NAMES, pattern

    if paper:
        from vibroswarm.paper.difficulty_table import paper_table

        print_document(paper_floors_document(list(paper_table())), as_json=json)
        return
    measured = {name: measure(pattern(name)) for name in NAMES}
    remark = (
        "random:F, for example random:0.48, is another random floor for each run; patch:0.10 has patches."
    )
    print_document(floors_document(measured, remark), as_json=json)


def show(
    floor: Annotated[str, FLOOR],
    /,
    *,
    tiles: Tiles = None,
    image_threshold: ImageThreshold = None,
    seed: Seed = None,
    out: Annotated[Path | None, Option("picture to write: .png, .svg or .pdf")] = None,
    force: Force = False,
) -> None:
    """Draw a floor in the terminal or to a file."""
    from vibroswarm.documents.floor import floor_document

    found = _floor(floor, tiles, image_threshold, _seed(seed, [floor]))
    if out is not None:
        from vibroswarm.plots.run import draw_floor

        draw_floor(out, found.drawn_tiles, found.name, replace=force)
    print_document(floor_document(found, in_terminal(found.drawn_tiles)))
    print_saved_file(out)


def measure(
    *floors: Annotated[str, FLOOR],
    tiles: Tiles = None,
    image_threshold: ImageThreshold = None,
    seed: Seed = None,
    json: Json = False,
) -> None:
    """Measure fill ratio, Moran index, entropy and clusters."""
    from vibroswarm.documents.floor import floors_document
    from vibroswarm.floors.difficulty import measure_floor

    number = _seed(seed, floors)
    measured = {floor: measure_floor(_floor(floor, tiles, image_threshold, number)) for floor in floors}
    print_document(floors_document(measured), as_json=json)


def make(
    *,
    tiles: Annotated[str, Option("rows x columns, for example 20x20", "RxC")],
    fill_ratio: Annotated[float, Option("share of vibrating tiles", "F")],
    moran: Annotated[float, Option("Moran index, -1 to 1", "M")],
    entropy: Annotated[float | None, Option("entropy, 0 to 1 (default: any)", "E")] = None,
    seed: Annotated[int, Option("another seed makes another floor")] = 0,
    out: Annotated[Path | None, Option("file to write: .txt, .csv or .png (one pixel per tile)")] = None,
    force: Force = False,
    json: Json = False,
) -> int:
    """Make a floor of given fill ratio, Moran index and entropy, each to within 0.02.

    The exit code is 0 if one is found; 1 if not, and then the nearest one is given.
    """
    from vibroswarm.documents.floor import design_document
    from vibroswarm.floors.design import make_floor
    from vibroswarm.floors.io import parse_tiles, write_tiles

    rows, columns = parse_tiles(tiles)
    design = make_floor(rows, columns, fill_ratio, moran, entropy, seed)
    if out is not None:
        with named("--out", of="path"):
            write_tiles(out, design.tiles, replace=force)
    target = {"fill_ratio": fill_ratio, "moran_index": moran, "entropy": entropy}
    print_document(design_document(design, target, in_terminal(design.tiles)), as_json=json)
    print_saved_file(out, as_json=json)
    return 0 if design.reached else 1


def in_terminal(tiles: NDArray[np.uint8]) -> str:
    """Draw a floor as lines of text."""
    from vibroswarm.floors.io import draw

    return draw(tiles, terminal.width())


def _seed(seed: int | None, floors: Iterable[str]) -> int:
    """Return the seed of random floors; refuse one that is given where no floor is random."""
    from vibroswarm.floors.source import is_generated

    refuse(
        seed is not None and not any(map(is_generated, floors)),
        "--seed",
        f"applies to random floors, not to {', '.join(map(shown, floors))}",
    )
    return seed or 0


def _floor(floor: str, tiles: str | None, image_threshold: float | None, seed: int) -> Floor:
    """Return the floor called ``floor`` of 1 m x 1 m; the seed selects a random one."""
    from vibroswarm.floors.floor import Floor
    from vibroswarm.floors.io import is_picture, parse_tiles
    from vibroswarm.floors.source import resolve
    from vibroswarm.floors.surfaces import is_patches, named_patches

    refuse(
        image_threshold is not None and not is_picture(floor),
        "--image-threshold",
        f"applies to a picture, not to {shown(floor)}",
    )
    size = None if tiles is None else parse_tiles(tiles)
    with named("FLOOR", of="floor.source"):
        levels, name = resolve(floor, size, seed, threshold=image_threshold)
        patches = named_patches(floor, (0.0, 0.0, 1.0, 1.0), seed, 0) if is_patches(floor) else ()
    return replace(Floor.filling(levels, name=name), patches=patches)
