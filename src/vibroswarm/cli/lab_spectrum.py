"""``vibroswarm lab spectrum``: spectra of recorded acceleration."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, cast, get_args

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import Destination
from vibroswarm.cli.inspection import size
from vibroswarm.cli.options import Drawn
from vibroswarm.errors import check_choice


def spectrum(
    acceleration: Annotated[Path, Option("CSV with the columns robot, time_s, ax, ay, az", "FILE")],
    /,
    *,
    rate: Annotated[
        float | None, Option("readings per second (default: as the times say)", "HZ", low=1)
    ] = None,
    signal_ms: Annotated[float, Option("part of each stop that is used, its end", "MS", low=1)] = 500.0,
    unit: Annotated[Literal["m/s2", "mm/s2", "g"], Option("of the acceleration")] = "m/s2",
    axis: Annotated[Literal["magnitude", "x", "y", "z"], Option("what spectra are of")] = "magnitude",
    by: Annotated[str, Option("groups with spectra of their own: robot, tile, place, time", "A,B")] = "robot",
    size: Annotated[
        tuple[float, ...], Option("width and height of the surface, m (default 1x1)", "WxH", read=size)
    ] = (1.0, 1.0),
    tiles: Annotated[str, Option("rows and columns of tiles", "RxC")] = "5x5",
    motors: Annotated[
        tuple[float, ...], Option("known frequencies, by kind of tile from 1 on", "HZ,...")
    ] = (),
    output: Drawn,
) -> None:
    """At which frequencies a surface vibrates, by robot, tile, place and time.

    A sample is what a robot takes it from: the last readings of each of its stops, between pauses of the recording (or
    by a column `sample`). Columns `x_m` and `y_m` say where. Lines have 95 % intervals, and say which frequencies the
    rate would fold onto them.

    examples:
      vibroswarm lab spectrum acceleration.csv --by robot,time
      vibroswarm lab spectrum acceleration.csv --axis z --by tile --motors 90,140 --out spectrum
    """
    from vibroswarm.documents.spectrum import spectra_frame, spectrum_document
    from vibroswarm.floors.grid_text import parse_tiles
    from vibroswarm.recordings.spectrum import Group, spectra_of

    groups = tuple(part.strip() for part in by.split(",") if part.strip())
    for group in groups:
        check_choice(group, "--by", get_args(Group))
    destination = Destination(
        output, "lab spectrum", str(acceleration), rate, signal_ms, unit, axis, by, size, tiles, motors
    )
    found = spectra_of(
        acceleration,
        rate_hz=rate,
        signal_ms=signal_ms,
        unit=unit,
        axis=axis,
        by=cast(tuple[Group, ...], groups),
        size_m=(size[0], size[1]),
        tiles=parse_tiles(tiles),
        motors_hz=motors,
    )
    destination.deliver(spectrum_document(found), {"spectra": spectra_frame(found)})
