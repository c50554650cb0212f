"""Floor files: text grids, CSV, lists of coordinates and pictures, recognised by content; floors drawn in the
terminal.

In pictures dark is still, bright is vibrating. Every pixel is a tile, or the picture is divided into given rows and
columns, whose mean brightness is compared with a threshold; a warning states how many are near it.
"""

from __future__ import annotations

import io
import math
import re
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.atomic_io import whole_file
from vibroswarm.core.numbers import percent, whole
from vibroswarm.core.untrusted_files import read_bytes
from vibroswarm.errors import InputError, named, number_of, warn_once
from vibroswarm.floors.floor import DIGITS, TILE_LIMIT, as_tiles, rows_of

Size = tuple[int, int]
"""Rows and columns of a floor."""

FILE_LIMIT: Final = 64 * 2**20
"""Size limit of files, bytes."""
SUFFIXES: Final = (".txt", ".csv", ".png")
"""Formats of ``write_tiles``."""
PICTURES: Final = (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff")
"""First bytes of the files of pictures that are read, PNG and JPEG."""
BIT_DEPTH: Final = 24
"""Place of the byte of a PNG file that states the bits of each channel."""

MOST_PIXELS: Final = 10_000
"""Largest number of pixels of a picture each of which is a tile: more are rarely meant."""
THRESHOLD: Final = 0.5
"""Share of full brightness from which a tile of a picture vibrates, unless another is given."""
NEAR: Final = 0.15
"""A tile whose brightness differs from the threshold by less than this is counted in a warning."""
CLEAR: Final = 0.9
"""Two levels of a picture are clear if they explain this share of the variance of its pixels."""


def parse_tiles(text: str, field: str = "--tiles") -> Size:
    """Return the numbers of rows and columns that a ``text`` such as ``"5x5"`` states."""
    match = re.fullmatch(r"\s*([0-9]{1,9})\s*[xX×]\s*([0-9]{1,9})\s*", text)
    rows, columns = (int(match[1]), int(match[2])) if match else (0, 0)
    if not 1 <= rows * columns <= TILE_LIMIT:
        raise InputError(f"'{text}' is not a size; give rows x columns, for example 5x5", field=field)
    return rows, columns


def read_tiles(
    path: Path | str, tiles: Size | None = None, threshold: float | None = None
) -> NDArray[np.uint8]:
    """Read the floor in a file, uint8 of shape (rows, columns), top row first.

    ``tiles``, its rows and columns, are needed for a list of coordinates, and divide a picture. ``threshold`` is a
    share of full brightness; None: ``THRESHOLD``, or between two clear levels.
    """
    data, name = read_bytes(Path(path), FILE_LIMIT, "a floor"), str(path)
    if data.startswith(PICTURES):
        return _tiles_of_picture(_grey(data, name), name, tiles, threshold)
    return _tiles_of_text(_decoded(data, name), name, tiles)


def read_values(
    path: Path | str, size: Size | None = None, ends: tuple[float, float] = (0.0, 1.0)
) -> NDArray[np.float64]:
    """Read a value for each tile, from 0 to 1: numbers between ``ends``, or grey levels of a picture."""
    data, name, (low, high) = read_bytes(Path(path), FILE_LIMIT, "a floor"), str(path), ends
    if data.startswith(PICTURES):
        return _brightness(_grey(data, name), size, name)
    values = (_numbers(_cells(_decoded(data, name)), name) - low) / (high - low)
    if not ((values >= 0.0) & (values <= 1.0)).all():
        raise InputError(f"has numbers beyond {low:g} to {high:g}; give values:LOW..HIGH:{name}", field=name)
    _check_shape(values, size, name)
    return values


# Text


def _decoded(data: bytes, name: str) -> str:
    try:
        return data.decode("utf-8-sig")  # without a byte order mark
    except UnicodeDecodeError:
        raise InputError("is not text; give rows of 0 and 1, or a PNG or JPEG picture", field=name) from None


def _cells(text: str) -> list[list[str]]:
    """Return the cells of each line but empty ones and comments, cut at commas, semicolons, tabs or spaces."""
    lines = (line.strip(" ") for line in text.splitlines())
    return [re.split(r" *[,;\t] *| +", line) for line in lines if line.strip() and not line.startswith("#")]


def _numbers(cells: list[list[str]], name: str) -> NDArray[np.float64]:
    try:
        numbers = np.array(cells, dtype=np.float64)
    except ValueError:  # other text, or rows of different lengths
        numbers = np.empty(0)
    if numbers.size == 0 or not np.isfinite(numbers).all():
        raise InputError("is not a rectangle of numbers; give one row of tiles per line", field=name)
    return numbers


def _check_shape(tiles: NDArray[Any], size: Size | None, name: str) -> None:
    if size is not None and tiles.shape != size:
        rows, columns = tiles.shape
        raise InputError(f"holds {rows} x {columns} tiles, not {size[0]} x {size[1]}", field=name)


def _tiles_of_text(text: str, name: str, size: Size | None) -> NDArray[np.uint8]:
    """Return the tiles of a grid, or of a list: pairs or triples of cells that cannot be a grid, or a line ``# -1``."""
    cells, is_list = _cells(text), re.search(r"^# *-1 *$", text, re.MULTILINE) is not None
    if is_list and not cells:
        cells = [["0", "0", "0"]]  # no tile vibrates
    is_separated = all(len(row) > 1 for row in cells)
    numbers = _numbers(cells if is_separated else [list("".join(row)) for row in cells], name)
    fits, columns = size is None or size == numbers.shape, numbers.shape[1]
    if is_separated and ((columns in (2, 3) and not fits) or (columns == 2 and numbers.max() > 1)):
        is_list = True
    if is_list:
        return _tiles_of_list(numbers, name, size)
    with named(name, of="floor"):
        tiles = as_tiles(numbers)
    _check_shape(tiles, size, name)
    return tiles


def _tiles_of_list(numbers: NDArray[np.float64], name: str, size: Size | None) -> NDArray[np.uint8]:
    """Return the tiles of a list of (column, row) or (column, row, kind), counted from 0 at the top left."""
    if size is None:
        raise InputError("is a list of coordinates; add its size, for example --tiles 5x5", field=name)
    at = numbers[:, 1::-1]  # row and column
    if numbers.shape[1] not in (2, 3) or (at % 1).any() or (at < 0).any() or (at >= size).any():
        raise InputError(
            f"a line is no column,row or column,row,kind of {size[0]} x {size[1]} tiles, from 0", field=name
        )
    tiles = np.zeros(size)
    tiles[tuple(at.T.astype(np.int64))] = numbers[:, 2] if numbers.shape[1] == 3 else 1
    with named(name, of="floor"):
        return as_tiles(tiles)


# Pictures


_Grey = tuple[Any, int]
"""The grey level of each pixel, integers of shape (height, width), and the level of white."""


def _tiles_of_picture(
    grey: _Grey, name: str, size: Size | None, threshold: float | None
) -> NDArray[np.uint8]:
    brightness, near = _brightness(grey, size, name), NEAR
    if size is None and brightness.size > MOST_PIXELS:
        raise InputError(f"has more than {MOST_PIXELS:,} pixels; add --tiles ROWSxCOLUMNS", field=name)
    if threshold is None:
        threshold, (dark, bright) = THRESHOLD, _clear_levels(grey)
        if (dark < threshold) == (bright < threshold):
            threshold, near = (dark + bright) / 2.0, NEAR * (bright - dark)
    number_of(threshold, "--image-threshold", math.nextafter(0.0, 1.0), math.nextafter(1.0, 0.0))
    count = int((np.abs(brightness - threshold) < near).sum())
    if count:
        warn_once(
            f"{name}: the brightness of {whole(count)} of {whole(brightness.size)} tiles is near the threshold, "
            f"{percent(threshold, None, digits=4)}; 'vibroswarm floors show' draws the floor"
        )
    return (brightness >= threshold).astype(np.uint8)


def _clear_levels(grey: _Grey) -> tuple[float, float]:
    """Return the mean brightness of dark and of bright pixels (Otsu, 1979) if these are clear, else 0 and 1."""
    levels, counts = np.unique(grey[0] / grey[1], return_counts=True)
    share = counts / grey[0].size
    dark, sums = np.cumsum(share)[:-1], np.cumsum(share * levels)
    mean, sums = sums[-1], sums[:-1]
    explained = (mean * dark - sums) ** 2 / (dark * (1.0 - dark))
    if levels.size < 2 or explained.max() < CLEAR * (share * (levels - mean) ** 2).sum():
        return 0.0, 1.0
    best = int(explained.argmax())
    return float(sums[best] / dark[best]), float((mean - sums[best]) / (1.0 - dark[best]))


def _grey(data: bytes, name: str) -> _Grey:
    from PIL import Image, ImageOps

    try:
        picture = ImageOps.exif_transpose(Image.open(io.BytesIO(data), formats=["PNG", "JPEG"]))
    except Exception as error:  # Pillow raises many kinds of error on damaged pictures
        raise InputError(f"cannot be read as a picture ({error})", field=name) from None
    if picture.mode.startswith("I"):  # grey of 16 bits, which convert("L") would clip
        return np.asarray(picture), 65535
    is_16_bit = data.startswith(PICTURES[0]) and data[BIT_DEPTH] == 16
    if is_16_bit or np.asarray(picture.convert("RGBA"))[..., 3].min() < 255:
        raise InputError("has transparent pixels, or colours of 16 bits; save it without", field=name)
    return np.asarray(picture.convert("L")), 255


def _brightness(grey: _Grey, size: Size | None, name: str) -> NDArray[np.float64]:
    """Return the mean brightness of each part, as a share of white; borders are rounded down, sums are integers."""
    levels, white = grey
    height, width = levels.shape
    rows, columns = size or (height, width)
    if rows > height or columns > width:
        raise InputError(
            f"has only {height} x {width} pixels for {rows} x {columns} tiles; give fewer tiles", field=name
        )
    tops, lefts = np.arange(rows) * height // rows, np.arange(columns) * width // columns
    sums = np.add.reduceat(np.add.reduceat(levels, tops, axis=0, dtype=np.int64), lefts, axis=1)
    areas = np.outer(np.diff(np.append(tops, height)), np.diff(np.append(lefts, width)))
    return np.asarray(sums / areas / white)


# Writing and drawing


@named("path", of="--out")
def write_tiles(path: Path | str, tiles: NDArray[np.uint8], *, replace: bool = False) -> None:
    """Write a floor as ``.txt``, ``.csv`` or, with two kinds, ``.png``; ``read_tiles`` gives the same tiles."""
    path, grid = Path(path), as_tiles(tiles)
    kind = check_suffix(path)
    if kind == ".png" and grid.max() > 1:
        raise InputError("a picture holds two kinds of tile; end the name with .csv", field="--out")
    with whole_file(path, replace=replace) as part:
        if kind == ".png":
            from PIL import Image

            Image.fromarray(grid * np.uint8(255)).save(part, format="PNG")
        else:
            # Without separators each character is a tile, so that kinds above 9 need them.
            separator = "," if kind == ".csv" else " " if grid.max() > 9 else ""
            rows = (separator.join(map(str, row)) for row in grid.tolist())
            part.write_text("\n".join(rows) + "\n", encoding="utf-8")


def check_suffix(path: Path, known: tuple[str, ...] = SUFFIXES) -> str:
    """Return the suffix of ``path`` in lower case."""
    suffix = path.suffix.lower()
    if suffix not in known:
        raise InputError(f"'{path.name}' must end with {', '.join(known[:-1])} or {known[-1]}", field="--out")
    return suffix


def draw(tiles: NDArray[np.uint8], width: int = 80) -> str:
    """Return a drawing of the floor in characters, one line per row, with a legend below."""
    repeats = 2 if 2 * tiles.shape[1] <= width else 1
    marks = str.maketrans({"0": "." * repeats, "1": "#" * repeats, **{d: d * repeats for d in DIGITS[2:]}})
    more = "  2 and above: other kinds" if tiles.max() > 1 else ""
    legend = f"{'#' * repeats} vibrating  {'.' * repeats} still{more}"
    return "\n".join([*(row.translate(marks) for row in rows_of(tiles)), legend])
