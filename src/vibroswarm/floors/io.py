"""Floor files: text grids, CSV, lists of coordinates, PNG pictures; and floors drawn in the terminal.

The kind of a file is recognised by its content, not by its name. A file is data: whatever its bytes, reading
gives tiles or an ``InputError``.

In pictures dark is still (0), bright is vibrating (1). Without a size every pixel is a tile. With a size the
picture is divided into that many rows and columns. The mean brightness of each part is compared with a threshold, and
a warning states how many parts were near it.
"""

from __future__ import annotations

import io
import math
import re
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TextIO

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.atomic_io import whole_file
from vibroswarm.core.numbers import percent, stated, whole
from vibroswarm.core.untrusted_files import read_bytes
from vibroswarm.errors import InputError, check_flags, named, number_of, path_of, warn_once
from vibroswarm.floors.floor import TILE_LIMIT, as_tiles, rows_of
from vibroswarm.floors.grid_text import MAX_LINES, Size, read_text
from vibroswarm.floors.surfaces import steps_of

if TYPE_CHECKING:
    from PIL import Image


FILE_LIMIT: Final = 64 * 2**20
"""Size limit of files, bytes."""

SUFFIXES: Final = (".txt", ".csv", ".png")
"""Formats of ``write_tiles``."""

_OTHER_PICTURES: Final = ((b"\xff\xd8\xff", "JPEG"), (b"GIF8", "GIF"), (b"BM", "BMP"), (b"%PDF", "PDF"))
"""First bytes and names of kinds of pictures that are recognised, but not read."""


THRESHOLD: Final = 0.5
"""Share of full brightness from which a tile of a picture vibrates, unless another is given."""
NEAR: Final = 0.15
"""A tile whose brightness differs from the threshold by less than this is near it, and counted in a warning."""


def read_tiles(
    path: Path | str,
    tiles: Size | None = None,
    threshold: float = THRESHOLD,
    *,
    most_pixels: int = TILE_LIMIT,
) -> NDArray[np.uint8]:
    """Read the floor in a file, uint8 of shape (rows, columns), top row first.

    Args:
        path: a text grid, CSV, list of coordinates or PNG picture.
        tiles: rows and columns of the floor. A list of coordinates cannot be read without them; a picture is divided
            into them; a grid must be of this size. None: not known; each pixel of a picture is then a tile.
        threshold: share of full brightness, above 0 and below 1, from which a tile of a picture vibrates; not used for
            other files.
        most_pixels: a picture with more pixels is refused if ``tiles`` is None.
    Raises:
        InputError: the file cannot be read or is not a floor (the message names the line or tile that is wrong, what it
            holds, and what would be right), or ``threshold`` is out of range.
    """
    data = read_bytes(path_of(path), FILE_LIMIT, "a floor")
    name = str(path)
    if not data:
        raise InputError("is empty; a floor file has rows of 0 and 1", field=name)
    if data.startswith(PNG):
        return read_png(data, name, tiles, threshold, most_pixels)
    for first, kind in _OTHER_PICTURES:
        if data.startswith(first):
            raise InputError(f"is a {kind} file; of pictures, only PNG can be read", field=name)
    if b"\0" in data:
        raise InputError("is a binary file; give rows of 0 and 1, or a PNG picture", field=name)
    try:
        text = data.decode("utf-8-sig")  # without a byte order mark
    except UnicodeDecodeError as error:
        raise InputError(
            f"is not UTF-8 text (byte {error.start + 1}); give rows of 0 and 1, or a PNG picture",
            field=name,
        ) from None
    return read_text(text, name, tiles)


def read_values(
    path: Path | str, size: Size | None = None, ends: tuple[float, float] = (0.0, 1.0)
) -> NDArray[np.float64]:
    """Read a value for each tile, from 0 to 1: numbers of a text or CSV, or grey levels of a PNG picture.

    Args:
        size: rows and columns, into which a picture is divided; None: each pixel is a tile. Numbers must be of this
            size. ends: the numbers that are the values 0 and 1; not used for pictures.
    Raises:
        InputError: the file cannot be read, or is not a rectangle of numbers between ``ends``.
    """
    name = str(path)
    data = read_bytes(Path(path), FILE_LIMIT, "a floor")
    if data.startswith(PNG):
        return brightness_of(data, name, size)
    try:
        lines = data.decode("utf-8-sig").splitlines()
        rows = [
            [float(cell) for cell in re.split(r"\s*[,;\t]\s*|\s+", line.strip())]
            for line in lines
            if line.strip() and not line.startswith("#")
        ]
        values = np.array(rows, dtype=np.float64)
    except ValueError:  # other text, or rows of different lengths
        raise InputError(
            "is not a rectangle of numbers; give one row of tiles per line", field=name
        ) from None
    low, high = ends
    if not low < high:
        raise InputError(
            f"{low:g}..{high:g} is not a range; give values:LOW..HIGH:{name}", field="floor.source"
        )
    # Other values are refused by ``steps_of``.
    is_known = values.ndim == 2 and values.size > 0 and bool(np.isfinite(values).all())
    if is_known and not (low <= values.min() and values.max() <= high):
        raise InputError(
            f"holds numbers from {values.min():g} to {values.max():g}, beyond {low:g} to {high:g}; state a range that "
            f"holds them, as values:{math.floor(values.min())}..{math.ceil(values.max())}:{name}",
            field=name,
        )
    values = (values - low) / (high - low)
    steps_of(values, name)  # which checks it
    if size is not None and values.shape != size:
        raise InputError(
            f"holds {values.shape[0]} x {values.shape[1]} tiles, not {size[0]} x {size[1]}", field=name
        )
    return values


@named("path", of="--out")
def write_tiles(path: Path | str, tiles: NDArray[np.uint8], *, replace: bool = False) -> None:
    """Write a floor to a file from which ``read_tiles`` gives the same tiles.

    Args:
        path: the file. Its suffix selects the format: ``.txt`` (rows of 0 and 1), ``.csv`` or ``.png`` (one pixel per
            tile, for two kinds). tiles: (rows, columns) of kinds. replace: whether an existing file may be replaced.
    Raises:
        InputError: ``tiles`` is not a rectangle of kinds; a picture would hold more than two kinds; the suffix is not
            known; a .txt or .csv would have more rows than ``read_tiles`` accepts; ``path`` is a folder, or exists and
            ``replace`` is false; or its folder cannot be written.
        RunError: the disk is full or failed.
    """
    path, grid = path_of(path), as_tiles(tiles)
    check_flags(replace=replace)
    kind = check_suffix(path)
    if kind == ".png" and grid.max() > 1:
        raise InputError("a picture holds two kinds of tile; end the name with .csv", field="--out")
    if kind != ".png" and grid.shape[0] > MAX_LINES:
        raise InputError(
            f"{grid.shape[0]:,} rows are too many for a {kind} file, which has at most {MAX_LINES:,}; end the name "
            "with .png",
            field="--out",
        )
    # part: a temporary file, which is renamed to ``path`` when it is complete
    with whole_file(path, replace=replace) as part:
        if kind == ".png":
            from PIL import Image

            Image.fromarray(grid * np.uint8(255)).save(part, format="PNG")
        else:
            # Without separators each character is a tile, so that kinds above 9 need them.
            separator = "," if kind == ".csv" else " " if grid.max() > 9 else ""
            rows = (separator.join(map(str, row)) for row in grid.tolist())
            part.write_text("\n".join(rows) + "\n", encoding="utf-8")


def check_new(path: Path | str, *, replace: bool = False) -> None:
    """Refuse a path that ``write_tiles`` would refuse, before the work of making a floor begins.

    Args:
        path: the file to write. replace: whether an existing file may be replaced.
    Raises:
        InputError: the suffix is unknown; the file exists and ``replace`` is false; ``path`` is a folder, or its folder
            does not exist.
    """
    path = Path(path)
    check_suffix(path)
    if path.is_dir():
        raise InputError(f"'{path}' is a folder; give the name of a file", field="--out")
    if path.exists() and not replace:
        raise InputError(f"'{path}' exists already; choose another name or add --force", field="--out")
    if not path.parent.is_dir():
        raise InputError(f"there is no folder '{path.parent}' to write '{path.name}' into", field="--out")


def check_suffix(path: Path, known: tuple[str, ...] = SUFFIXES) -> str:
    """Return the suffix of ``path`` in lower case.

    Raises:
        InputError: the suffix is not one of ``known``; the message lists ``known``.
    """
    suffix = path.suffix.lower()
    if suffix not in known:
        problem = (
            f"the suffix '{path.suffix}' is not known" if path.suffix else f"'{path.name}' has no suffix"
        )
        raise InputError(
            f"{problem}; end the name with {', '.join(known[:-1])} or {known[-1]}", field="--out"
        )
    return suffix


PNG: Final = b"\x89PNG\r\n\x1a\n"
"""The first bytes of every PNG file."""

PIXEL_LIMIT: Final = 64_000_000
"""Maximum number of pixels of a picture."""
WHITE: Final = 255
"""Level of white in pictures of 8 bits."""


def is_picture(path: Path | str) -> bool:
    """Return whether a file is a PNG picture, by its first bytes; False if it cannot be read."""
    try:
        return Path(path).is_file() and read_bytes(Path(path), FILE_LIMIT, "a floor").startswith(PNG)
    except (OSError, ValueError):  # InputError is a ValueError
        return False


def read_png(
    data: bytes,
    name: str,
    size: Size | None = None,
    threshold: float = THRESHOLD,
    most_pixels: int = TILE_LIMIT,
) -> NDArray[np.uint8]:
    """Read the tiles of a PNG picture, uint8 of shape (rows, columns), top row first.

    Args:
        data: content of the file. name: name of the file, for messages.
        size: rows and columns to divide the picture into; None: each pixel is a tile.
        threshold: share of full brightness, above 0 and below 1, from which a tile vibrates. A warning states how many
            tiles are near it.
        most_pixels: a picture with more pixels is refused if ``size`` is None.
    Raises:
        InputError: the picture is incomplete, too large or transparent, or has fewer pixels than tiles; or
            ``threshold`` is out of range.
    """
    check_threshold(threshold)
    brightness = brightness_of(data, name, size, most_pixels)
    near = int((np.abs(brightness - threshold) < NEAR).sum())
    if near:
        warn_once(
            f"{name}: the brightness of {whole(near)} of {whole(brightness.size)} tiles is within "
            f"{stated(100 * NEAR)} percentage "
            f"points of the threshold, {percent(threshold, None, digits=4)}; 'vibroswarm floors show' draws the floor"
        )
    return (brightness >= threshold).astype(np.uint8)


def brightness_of(
    data: bytes, name: str, size: Size | None = None, most_pixels: int = TILE_LIMIT
) -> NDArray[np.float64]:
    """Return the mean brightness of each tile of a PNG picture, as a share of white, (rows, columns).

    Arguments and errors are those of ``read_png``.
    """
    levels, full = _grey_levels(_picture(data, name), name)
    if size is None:
        if levels.size > most_pixels:
            raise InputError(
                f"has {levels.shape[0]} x {levels.shape[1]} pixels, too many for one tile each (at "
                f"most {most_pixels:,}); add --tiles ROWSxCOLUMNS, into which the picture is divided",
                field=name,
            )
        size = (levels.shape[0], levels.shape[1])
    return np.asarray(_means(levels, size, name) / full)


def check_threshold(threshold: float, field: str = "--image-threshold") -> None:
    """Refuse a threshold of brightness that is not above 0 and below 1; ``field`` names it in the message."""
    least = math.nextafter(0.0, 1.0)
    number_of(threshold, field, least, math.nextafter(1.0, 0.0))


def _picture(data: bytes, name: str) -> Image.Image:
    """Return a PNG picture, decoded, and turned as its EXIF data say.

    Raises:
        InputError: the picture is incomplete or too large; ``name`` is the file's name in the message.
    """
    from PIL import Image, ImageOps

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # of some broken or oversized pictures Pillow only warns
            with Image.open(io.BytesIO(data), formats=["PNG"]) as picture:
                picture.verify()  # checks the checksums, which decoding ignores; the picture cannot be used afterwards
            with Image.open(io.BytesIO(data), formats=["PNG"]) as picture:
                if picture.width * picture.height > PIXEL_LIMIT:
                    raise InputError(
                        f"has {picture.height} x {picture.width} pixels, which is too large; at most {PIXEL_LIMIT:,}",
                        field=name,
                    )
                picture.load()
    except InputError:
        raise
    # Pillow's own limit on pixels is above PIXEL_LIMIT.
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        raise InputError(f"is too large a picture; at most {PIXEL_LIMIT:,} pixels", field=name) from None
    except Exception as error:  # Pillow raises many kinds of error on incomplete pictures
        raise InputError(
            f"is not a complete PNG picture ({error or type(error).__name__})", field=name
        ) from None
    try:
        ImageOps.exif_transpose(picture, in_place=True)
    except Exception as error:  # Pillow raises many kinds of error on broken EXIF data
        raise InputError(
            f"its EXIF data cannot be read ({error}); save the picture without them", field=name
        ) from None
    return picture


def _grey_levels(picture: Image.Image, name: str) -> tuple[NDArray[Any], int]:
    """Return the grey level of each pixel, integers of shape (height, width), and the level of white.

    Raises:
        InputError: the picture has transparent pixels; ``name`` is the file's name in the message.
    """
    # A grey PNG of 16 bits a pixel has the mode "I;16" (in older versions of Pillow "I"). convert("L") would clip its
    # values at 255 instead of scaling them.
    if picture.mode.startswith("I"):
        levels = np.asarray(picture)
        # Such a picture may name one grey level that is transparent.
        if (levels == picture.info.get("transparency", -1)).any():
            raise InputError("has transparent pixels; give a picture without", field=name)
        return levels, 65535
    if picture.has_transparency_data:
        colours = picture.convert("RGBA")  # so that transparency stated in a palette is seen too
        if np.asarray(colours.getchannel("A")).min() < 255:
            raise InputError("has transparent pixels; give a picture without", field=name)
        picture = colours
    return np.asarray(picture.convert("L")), WHITE


def _means(levels: NDArray[Any], size: Size, name: str) -> NDArray[np.float64]:
    """Return the mean level of each part, (rows, columns); borders are rounded down, sums are integers.

    Raises:
        InputError: there are fewer pixels than parts; ``name`` is that of the picture.
    """
    height, width = levels.shape
    if size[0] > height or size[1] > width:
        raise InputError(
            f"has only {height} x {width} pixels for the {size[0]} x {size[1]} of --tiles; give at most as many tiles "
            "as pixels",
            field=name,
        )
    tops = np.arange(size[0]) * height // size[0]
    lefts = np.arange(size[1]) * width // size[1]
    sums = np.add.reduceat(np.add.reduceat(levels, tops, axis=0, dtype=np.int64), lefts, axis=1)
    heights = np.diff(np.append(tops, height))
    widths = np.diff(np.append(lefts, width))
    return np.asarray(sums / np.outer(heights, widths))


DRAW_LIMIT: Final = 200
"""Largest number of rows or columns of a floor that is drawn in text."""

_BLOCKS: Final = ("·", "█")
"""Characters of a still and of a vibrating tile, in Unicode."""
_ASCII: Final = (".", "#")
"""Characters of a still and of a vibrating tile, in ASCII."""


def draw(tiles: NDArray[np.uint8], *, blocks: bool = False, width: int = 80) -> str:
    """Return a drawing of the floor in characters, one line per row, with a legend below.

    Args:
        tiles: (rows, columns) of kinds. Those above 1 are drawn as their hexadecimal digit.
        blocks: whether to use Unicode blocks; plain ASCII otherwise.
        width: width of the terminal, characters. Each tile is two characters wide if the rows then fit, else one.
    Returns: the drawing. If the floor has more than DRAW_LIMIT rows or columns, a sentence that says so.
    """
    rows, columns = tiles.shape
    if max(rows, columns) > DRAW_LIMIT:
        return f"({rows} x {columns} tiles are too many to draw here; draw them to a file with --out)"
    tile_width = 2 if 2 * columns <= width else 1
    marks = dict(zip("01", _BLOCKS if blocks else _ASCII, strict=True))
    lines = ["".join(marks.get(kind, kind) * tile_width for kind in row) for row in rows_of(tiles)]
    still, vibrating = (marks[kind] * tile_width for kind in "01")
    more = "  2 and above: other kinds" if tiles.max() > 1 else ""
    return "\n".join([*lines, f"{vibrating} vibrating  {still} still{more}"])


def can_draw_blocks(stream: TextIO) -> bool:
    """Return whether the encoding of ``stream`` has the characters that ``draw`` uses with ``blocks``."""
    try:
        "".join(_BLOCKS).encode(getattr(stream, "encoding", None) or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True
