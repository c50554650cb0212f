"""``vibroswarm floors``: show, measure and make floors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Annotated

from vibroswarm.cli import terminal
from vibroswarm.cli.command_line import Option, share
from vibroswarm.cli.deliver import print_report, print_saved_file
from vibroswarm.cli.options import Force, Json, OutFile
from vibroswarm.errors import named

if TYPE_CHECKING:  # imported when needed: --help stays fast
    import numpy as np
    from numpy.typing import NDArray

    from vibroswarm.floors.difficulty import Difficulty
    from vibroswarm.floors.floor import Floor
    from vibroswarm.report.report import Report

FLOOR = Option("pattern (diagonal:0.48), random:0.48, or file (text, CSV, coordinates, PNG, JPEG)", "FLOOR")
Seed = Annotated[int, Option("another seed makes another random floor")]
Tiles = Annotated[str | None, Option("rows x columns of a random floor, coordinate list or picture", "RxC")]
ImageThreshold = Annotated[
    float | None,
    Option("tiles of a picture vibrate from this mean brightness (default 50%)", "P", read=share),
]


def show(
    floor: Annotated[str, FLOOR],
    /,
    *,
    tiles: Tiles = None,
    image_threshold: ImageThreshold = None,
    seed: Seed = 0,
    out: OutFile = None,
    force: Force = False,
) -> None:
    """Draw a floor in the terminal or to a file (.png, .svg or .pdf)."""
    from vibroswarm.floors.difficulty import measure_floor

    drawn = _floor(floor, tiles, image_threshold, seed)
    if out is not None:
        from vibroswarm.plots.run import draw_floor

        draw_floor(out, drawn.drawn_tiles, drawn.name, replace=force)
    print(in_terminal(drawn.drawn_tiles))
    print_report(report_of({drawn.name: measure_floor(drawn)}))
    print_saved_file(out)


def measure(
    *floors: Annotated[str, FLOOR],
    tiles: Tiles = None,
    image_threshold: ImageThreshold = None,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Measure fill ratio, Moran index, entropy and clusters."""
    from vibroswarm.floors.difficulty import measure_floor

    measured = {floor: measure_floor(_floor(floor, tiles, image_threshold, seed)) for floor in floors}
    print_report(report_of(measured), as_json=json)


def make(
    *,
    tiles: Annotated[str, Option("rows x columns, for example 20x20", "RxC")],
    fill_ratio: Annotated[float, Option("share of vibrating tiles", "F")],
    moran: Annotated[float, Option("Moran index, -1 to 1", "M")],
    entropy: Annotated[float | None, Option("entropy, 0 to 1 (default: any)", "E")] = None,
    seed: Seed = 0,
    out: OutFile = None,
    force: Force = False,
    json: Json = False,
) -> int:
    """Make a floor of given fill ratio, Moran index and entropy, each to within 0.02 (.txt, .csv or .png).

    The exit code is 0 if one is found; 1 if not, and then the nearest one is given.
    """
    from vibroswarm.floors.design import make_floor
    from vibroswarm.floors.io import parse_tiles, write_tiles

    rows, columns = parse_tiles(tiles)
    design = make_floor(rows, columns, fill_ratio, moran, entropy, seed)
    if out is not None:
        write_tiles(out, design.tiles, replace=force)
    if not json:
        print(in_terminal(design.tiles))
    answer = "" if design.reached else "Not found; this is the nearest."
    print_report(report_of({"made": design.difficulty}, answer), as_json=json)
    print_saved_file(out, as_json=json)
    return 0 if design.reached else 1


def report_of(measured: Mapping[str, Difficulty], *answer: str) -> Report:
    """Return the measures of floors by name."""
    import polars as pl

    from vibroswarm.report.report import Report, Table

    rows = [{"floor": name, **asdict(difficulty)} for name, difficulty in measured.items()]
    frame = pl.DataFrame(rows, schema_overrides={"moran_index": pl.Float64, "entropy": pl.Float64})
    return Report("Floors", answer, {"floors": Table(frame)})


def in_terminal(tiles: NDArray[np.uint8]) -> str:
    """Draw a floor as lines of text."""
    from vibroswarm.floors.io import draw

    return draw(tiles, terminal.width())


def _floor(floor: str, tiles: str | None, image_threshold: float | None, seed: int) -> Floor:
    from vibroswarm.floors.floor import Floor
    from vibroswarm.floors.io import parse_tiles
    from vibroswarm.floors.source import resolve
    from vibroswarm.floors.surfaces import is_patches, named_patches

    size = None if tiles is None else parse_tiles(tiles)
    with named("FLOOR", of="floor.source"):
        levels, name = resolve(floor, size, seed, threshold=image_threshold)
        patches = named_patches(floor, (0.0, 0.0, 1.0, 1.0), seed, 0) if is_patches(floor) else ()
    return replace(Floor.filling(levels, name=name), patches=patches)
