from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from vibroswarm.floors.io import can_draw_blocks, draw
from vibroswarm.floors.source import pattern
from vibroswarm.plots.run import STILL, VIBRATING, draw_floor

TILES = np.array([[1, 0, 0], [0, 1, 1]], dtype=np.uint8)


def test_in_ascii():
    assert draw(TILES) == "##....\n..####\n## vibrating  .. still"
    assert draw(TILES).isascii()


def test_in_blocks():
    assert draw(TILES, blocks=True).splitlines()[:2] == ["██····", "··████"]


def test_a_wide_floor_has_one_character_a_tile():
    assert draw(TILES, width=5).splitlines()[0] == "#.."
    assert draw(TILES, width=6).splitlines()[0] == "##...."


def test_a_vast_floor_is_not_drawn():
    assert "300 x 3 tiles are too many" in draw(np.zeros((300, 3), dtype=np.uint8))


@pytest.mark.parametrize(
    ("encoding", "can"), [("utf-8", True), ("cp437", True), ("ascii", False), ("latin-1", False)]
)
def test_blocks_only_where_the_stream_has_them(encoding, can):
    assert can_draw_blocks(io.TextIOWrapper(io.BytesIO(), encoding=encoding)) is can


def test_a_stream_without_encoding_gets_ascii():
    assert not can_draw_blocks(io.StringIO())


@pytest.mark.parametrize(("suffix", "first"), [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".PDF", b"%PDF")])
def test_the_kind_of_picture_is_seen_from_the_suffix_and_repeats(tmp_path, suffix, first):
    one, two = tmp_path / f"one floor{suffix}", tmp_path / f"two{suffix}"
    draw_floor(one, TILES, "a $title_ of $mine")
    draw_floor(two, TILES, "a $title_ of $mine")
    assert one.read_bytes().startswith(first)
    assert one.read_bytes() == two.read_bytes()


def test_the_picture_shows_the_tiles_the_right_way_up(tmp_path):
    path = tmp_path / "f.png"
    draw_floor(path, pattern("stripe:0.48"))
    with Image.open(path) as picture:
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    dark, light = ([int(colour[i : i + 2], 16) for i in (1, 3, 5)] for colour in (VIBRATING, STILL))
    assert np.mean(dark) + 100 < np.mean(light)  # told apart in grey
    rows_dark = np.nonzero((pixels == dark).all(axis=2).sum(axis=1) > 300)[0]
    rows_light = np.nonzero((pixels == light).all(axis=2).sum(axis=1) > 300)[0]
    assert rows_dark.size > 200
    assert rows_light.size > 200
    assert np.median(rows_dark) < np.median(rows_light)


def test_large_floors_are_drawn(tmp_path):
    draw_floor(tmp_path / "f.svg", np.ones((150, 100), dtype=np.uint8))
    assert (tmp_path / "f.svg").stat().st_size < 200_000
