from __future__ import annotations

import io

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import ExifTags, Image

from vibroswarm.errors import InputError
from vibroswarm.floors.io import read_tiles, write_tiles
from vibroswarm.floors.source import pattern

grids = hnp.arrays(
    np.uint8, hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=9), elements=st.integers(0, 1)
)
quick = settings(deadline=None, max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture
def file(tmp_path):
    def write(content):
        path = tmp_path / "a floor.dat"
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


def png(pixels, kind="PNG", **options):
    buffer = io.BytesIO()
    Image.fromarray(np.asarray(pixels)).save(buffer, format=kind, **options)
    return buffer.getvalue()


@pytest.mark.parametrize("suffix", [".txt", ".csv", ".png"])
@quick
@given(tiles=grids)
def test_what_is_written_is_read_again(tmp_path, suffix, tiles):
    path = tmp_path / f"floor of mine{suffix}"
    write_tiles(path, tiles, replace=True)
    assert np.array_equal(read_tiles(path), tiles)
    assert np.array_equal(read_tiles(path, tiles.shape), tiles)


@pytest.mark.parametrize(
    "content",
    [
        "101\n010\n",
        "1 0 1\n0 1 0",
        "1,0,1\r\n0,1,0\r\n",
        "1;0;1\n0;1;0\n",
        "1\t0\t1\n0\t1\t0\n",
        "# a comment\n\n1, 0, 1\n\n0, 1, 0\n# the end\n",
        "\ufeff101\n010",
        "1.000000000000000000e+00 0.000000000000000000e+00 1.0\n0. 1 0\n",
        "101\r010\r",
    ],
)
def test_the_ways_to_write_a_grid(file, content):
    assert read_tiles(file(content)).tolist() == [[1, 0, 1], [0, 1, 0]]


def test_coordinates_are_column_then_row(file):
    path = file("1,0\n2,1\n# -1\n")
    assert read_tiles(path, (2, 3)).tolist() == [[0, 1, 0], [0, 0, 1]]
    assert read_tiles(file("# nothing vibrates\n# -1\n"), (1, 2)).tolist() == [[0, 0]]
    assert read_tiles(file("1 0\n0 1"), (3, 3)).tolist() == [[0, 1, 0], [1, 0, 0], [0, 0, 0]]


def test_coordinates_may_have_kinds(file):
    tiles = read_tiles(file(b"0,1,2\n2,0,1\n1,1,0\n"), (2, 3 + 1))
    assert tiles.tolist() == [[0, 0, 1, 0], [2, 0, 0, 0]]
    assert read_tiles(file(b"0,1,2\n2,0,1\n"), (2, 3)).tolist() == [
        [0, 1, 2],
        [2, 0, 1],
    ]  # a grid of this size
    assert read_tiles(file(b"0,1,2\n2,0,1\n# -1\n"), (2, 3)).tolist() == [[0, 0, 1], [2, 0, 0]]
    for wrong in (b"1,0,16\n", b"4,0\n", b"0,-1\n", b"0.5,0\n", b"1,0,0,1\n# -1\n"):
        with pytest.raises(InputError):
            read_tiles(file(wrong), (4, 4))


def test_coordinates_without_a_size_are_no_grid(file):
    with pytest.raises(InputError, match="is a list of coordinates; add its size"):
        read_tiles(file("1,0\n2,1\n"))
    assert read_tiles(file("10\n21\n")).tolist() == [[1, 0], [2, 1]]


def test_pairs_are_a_grid_where_they_fit_as_one(file):
    content = "1,0\n0,1\n"
    assert read_tiles(file(content)).tolist() == [[1, 0], [0, 1]]
    assert read_tiles(file(content), (2, 2)).tolist() == [[1, 0], [0, 1]]
    assert read_tiles(file(content), (2, 3)).tolist() == [[0, 1, 0], [1, 0, 0]]
    assert read_tiles(file(content + "# -1"), (2, 2)).tolist() == [[0, 1], [1, 0]]


def test_a_picture_without_size_has_one_pixel_a_tile(file):
    pixels = np.array([[0, 255, 20], [240, 0, 255]], dtype=np.uint8)
    wanted = [[0, 1, 0], [1, 0, 1]]
    assert read_tiles(file(png(pixels))).tolist() == wanted
    assert read_tiles(file(png(np.repeat(pixels[..., None], 3, axis=2)))).tolist() == wanted
    assert read_tiles(file(png(pixels.astype(np.uint16) * 257))).tolist() == wanted
    assert read_tiles(file(png(pixels > 99))).tolist() == wanted
    opaque = np.dstack([pixels] * 3 + [np.full_like(pixels, 255)])
    assert read_tiles(file(png(opaque))).tolist() == wanted


def test_a_picture_with_a_size_is_divided(file):
    tiles = np.array([[1, 0, 1], [0, 0, 1]], dtype=np.uint8)
    pixels = np.kron(tiles, np.ones((20, 17), dtype=np.uint8)) * 200
    pixels[::20] = 30  # lines between tiles
    assert read_tiles(file(png(pixels)), (2, 3)).tolist() == tiles.tolist()
    uneven = np.kron(tiles, np.ones((20, 17), dtype=np.uint8))[:39, :50] * 255
    assert read_tiles(file(png(uneven)), (2, 3)).tolist() == tiles.tolist()


def test_mean_brightness_decides_by_a_threshold(file, caplog):
    levels = np.array([[0, 255], [130, 0]], dtype=np.uint8)  # 130 is 51 %
    assert read_tiles(file(png(levels))).tolist() == [[0, 1], [1, 0]]
    assert "of 1 of 4 tiles is near the threshold, 50 %" in caplog.text
    assert read_tiles(file(png(levels)), threshold=0.52).tolist() == [[0, 1], [0, 0]]
    fine = levels.astype(np.uint16) * 257
    assert read_tiles(file(png(fine)), threshold=0.51).tolist() == [[0, 1], [0, 0]], "130/255 is 0.5098"
    assert read_tiles(file(png(fine)), threshold=130 / 255).tolist() == [[0, 1], [1, 0]]


MASK = pattern("diagonal:0.48")
PIXELS = np.kron(MASK, np.ones((8, 8), dtype=np.uint8))


def colours(dark, bright):
    return np.array([dark, bright], dtype=np.uint8)[PIXELS]


@pytest.mark.parametrize(
    ("pixels", "kind"),
    [
        (PIXELS, "PNG"),
        (PIXELS * 255, "PNG"),
        (200 + 55 * PIXELS, "PNG"),
        (PIXELS.astype(np.uint16), "PNG"),
        (PIXELS.astype(np.uint16) * 65535, "PNG"),
        (colours((0, 0, 0), (255, 0, 0)), "PNG"),
        (colours((0, 0, 0), (0, 0, 255)), "PNG"),
        (colours((0, 0, 0), (255, 0, 0)), "JPEG"),
        (colours((0, 0, 0), (255, 255, 255)), "JPEG"),
        (colours((40, 0, 0), (255, 255, 0)), "JPEG"),
    ],
)
def test_a_picture_with_two_levels_is_split_between_them(file, pixels, kind):
    path = file(png(pixels, kind))
    assert np.array_equal(read_tiles(path, (10, 10)), MASK)
    assert MASK.sum() == 48


def test_what_is_not_two_levels_is_compared_with_one_half(file, caplog):
    dark = np.linspace(0, 100, 400).astype(np.uint8).reshape(20, 20)
    assert read_tiles(file(png(dark)), (10, 10)).sum() == 0
    assert read_tiles(file(png(dark + 150)), (10, 10)).sum() == 100
    assert read_tiles(file(png(PIXELS * 0)), (10, 10)).sum() == 0
    assert "on one side" not in caplog.text
    assert read_tiles(file(png(PIXELS)), (10, 10), threshold=0.5).sum() == 0
    assert read_tiles(file(png(PIXELS)), (10, 10)).sum() == 48


@pytest.mark.parametrize("kind", ["PNG", "JPEG"])
def test_a_picture_that_is_cut_or_transparent_is_refused(file, kind):
    whole = png(np.random.default_rng(1).integers(0, 256, (80, 80, 3), dtype=np.uint8), kind)
    with pytest.raises(InputError, match="cannot be read as a picture"):
        read_tiles(file(whole[: len(whole) // 2]))
    with pytest.raises(InputError, match="transparent"):
        read_tiles(file(png(np.zeros((4, 4, 4), dtype=np.uint8))))


def test_a_picture_is_turned_as_its_exif_data_say(file):
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 6  # to be turned clockwise
    top = np.array([[255, 255], [0, 0], [0, 0]], dtype=np.uint8)
    assert read_tiles(file(png(top, exif=exif))).tolist() == [[0, 0, 1], [0, 0, 1]]


@quick
@given(content=st.binary(max_size=200), size=st.none() | st.tuples(st.integers(1, 5), st.integers(1, 5)))
def test_any_bytes_give_a_floor_or_an_input_error(file, content, size):
    check(file(content), size)


def check(path, size):
    try:
        tiles = read_tiles(path, size)
    except InputError as error:
        refused = error
    else:
        assert tiles.dtype == np.uint8
        assert set(np.unique(tiles)) <= set(range(16))
        assert size is None or tiles.shape == size
        return
    assert refused.field == str(path)
    assert "\n" not in str(refused).removeprefix(str(path))
