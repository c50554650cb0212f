"""Floors as pictures: dark is still (0), bright is vibrating (1).

Without a size every pixel is a tile. With one the picture is divided into so many rows and columns, and the
mean brightness of each part decides. What is neither clearly dark nor clearly bright is refused, not guessed.
"""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import TILE_LIMIT
from vibroswarm.floors.grids import Size

if TYPE_CHECKING:
    from PIL import Image

PNG: Final = b"\x89PNG\r\n\x1a\n"
"""The first bytes of every PNG file."""

PIXEL_LIMIT: Final = 64_000_000
_DARK: Final = 1 / 3  # of full brightness: up to here a tile is still
_BRIGHT: Final = 2 / 3  # from here on it vibrates


def read_png(data: bytes, name: str, size: Size | None = None) -> NDArray[np.uint8]:
    """The tiles of a PNG picture, uint8 of shape (rows, columns), top row first.

    Args:
        data: the whole file. name: of the file, for messages.
        size: rows and columns to divide the picture into; None: one pixel a tile.
    Raises:
        InputError: no whole PNG, too large, fewer pixels than tiles, transparent, or neither dark nor bright.
    """
    brightness = _brightness(data, name)
    if size is None:
        if brightness.size > TILE_LIMIT:
            raise InputError(
                f"has {brightness.shape[0]} x {brightness.shape[1]} pixels, too many for one tile each (at "
                f"most {TILE_LIMIT}); say with --tiles ROWSxCOLUMNS how many tiles it shows",
                field=name,
            )
        size = (brightness.shape[0], brightness.shape[1])
    if size[0] > brightness.shape[0] or size[1] > brightness.shape[1]:
        raise InputError(
            f"has only {brightness.shape[0]} x {brightness.shape[1]} pixels for the {size[0]} x {size[1]} of "
            "--tiles; give at most as many tiles as pixels",
            field=name,
        )
    means = _means(brightness, size)
    unclear = (means > _DARK) & (means < _BRIGHT)
    if unclear.any():
        row, column = (int(where[0]) for where in np.nonzero(unclear))
        divided = size != brightness.shape
        raise InputError(
            f"row {row + 1}, column {column + 1} is {means[row, column]:.0%} bright, neither dark (still, up "
            f"to {_DARK:.0%}) nor bright (vibrating, from {_BRIGHT:.0%}); give a picture in black and white, "
            + ("or the --tiles that it shows" if divided else "or say with --tiles how many tiles it shows"),
            field=name,
        )
    return (means >= _BRIGHT).astype(np.uint8)


def write_png(path: Path, tiles: NDArray[np.uint8]) -> None:
    """Write one pixel a tile, black and white, so that ``read_png`` gives the same tiles."""
    from PIL import Image

    Image.fromarray(tiles * np.uint8(255)).save(path, format="PNG")


def _brightness(data: bytes, name: str) -> NDArray[np.float64]:
    """Of each pixel, 0 to 1, shape (height, width)."""
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # Pillow only warns of many a broken or oversized picture
            with Image.open(io.BytesIO(data), formats=["PNG"]) as picture:
                picture.verify()  # the check sums, which decoding does not look at; it uses the picture up
            with Image.open(io.BytesIO(data), formats=["PNG"]) as picture:
                return _grey(picture, name)
    except InputError:
        raise
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        raise InputError(f"is too large a picture; at most {PIXEL_LIMIT} pixels", field=name) from None
    except Exception as error:  # Pillow raises many kinds on bytes that are no whole picture
        raise InputError(f"is no whole PNG picture ({error or type(error).__name__})", field=name) from None


def _grey(picture: Image.Image, name: str) -> NDArray[np.float64]:
    if picture.width * picture.height > PIXEL_LIMIT:
        raise InputError(
            f"has {picture.height} x {picture.width} pixels, which is too large; at most {PIXEL_LIMIT}",
            field=name,
        )
    if picture.mode.startswith("I"):  # 16 bits: convert("L") would clip them
        return np.asarray(picture, dtype=np.float64) / 65535
    if picture.has_transparency_data:
        colours = picture.convert("RGBA")
        if np.asarray(colours.getchannel("A")).min() < 255:
            raise InputError("has transparent pixels; give a picture without", field=name)
        picture = colours
    return np.asarray(picture.convert("L"), dtype=np.float64) / 255


def _means(brightness: NDArray[np.float64], size: Size) -> NDArray[np.float64]:
    """Mean brightness of each of ``size`` parts, whose borders are rounded to pixels."""
    height, width = brightness.shape
    tops = np.arange(size[0]) * height // size[0]
    lefts = np.arange(size[1]) * width // size[1]
    sums = np.add.reduceat(np.add.reduceat(brightness, tops, axis=0), lefts, axis=1)
    heights = np.diff(np.append(tops, height))
    widths = np.diff(np.append(lefts, width))
    return np.asarray(sums / np.outer(heights, widths))
