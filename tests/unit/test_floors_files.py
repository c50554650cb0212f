from __future__ import annotations

import io
import re
import struct
import zlib

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import ExifTags, Image

from vibroswarm.errors import InputError
from vibroswarm.floors.grid_text import MAX_LINES, parse_tiles
from vibroswarm.floors.io import check_new, read_palette, read_tiles, write_tiles

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


def png(pixels, **options):
    buffer = io.BytesIO()
    Image.fromarray(np.asarray(pixels)).save(buffer, format="PNG", **options)
    return buffer.getvalue()


@pytest.mark.parametrize("suffix", [".txt", ".csv", ".png", ".TXT"])
@quick
@given(tiles=grids)
def test_what_is_written_is_read_again(tmp_path, suffix, tiles):
    path = tmp_path / f"floor of mine{suffix}"
    write_tiles(path, tiles, replace=True)
    if suffix == ".csv" and tiles.shape[1] == 1:
        assert path.read_text() == "".join(f"{row[0]}\n" for row in tiles)
    assert np.array_equal(read_tiles(path), tiles)
    assert np.array_equal(read_tiles(path, tiles.shape), tiles)


def test_kinds_above_9_are_written_apart(tmp_path):
    tiles = [[10, 0, 1], [1, 2, 9]]
    write_tiles(tmp_path / "kinds.txt", tiles)
    assert read_tiles(tmp_path / "kinds.txt").tolist() == tiles


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
    with pytest.raises(InputError, match="line 2 repeats the tile"):
        read_tiles(file(b"1,0,0\n1,0,2\n"), (4, 4))
    with pytest.raises(InputError, match="line 1 holds '1,0,16'; a line of the list is"):
        read_tiles(file(b"1,0,16\n"), (4, 4))


def test_pairs_are_a_grid_where_they_fit_as_one(file):
    content = "1,0\n0,1\n"
    assert read_tiles(file(content)).tolist() == [[1, 0], [0, 1]]
    assert read_tiles(file(content), (2, 2)).tolist() == [[1, 0], [0, 1]]
    assert read_tiles(file(content), (2, 3)).tolist() == [[0, 1, 0], [1, 0, 0]]
    assert read_tiles(file(content + "# -1"), (2, 2)).tolist() == [[0, 1], [1, 0]]


@pytest.mark.parametrize(
    ("content", "size", "message"),
    [
        ("", None, "is empty"),
        ("\n  \n# only words\n", None, "holds no tiles"),
        ("101\n01\n", None, "line 2 has 2 tiles where line 1 has 3"),
        ("101\n0a1\n", None, "line 2, column 2 holds 'a'"),
        ("1,0\n0,\n", None, "line 2, column 2 holds ''"),
        ("1,0,1\n0,-1,0\n", None, "line 2, column 2 holds '-1'"),
        ("0 1 01\n", None, "line 1, column 3 holds '01'"),
        ("0 1 nan\n", None, "line 1, column 3 holds 'nan'"),
        ("٠١\n", None, "line 1, column 1 holds '٠'"),
        ("101\n", (5, 5), "holds 1 x 3 tiles, not the 5 x 5"),
        ("1,2\n3,4\n", None, "list of coordinates, .* --tiles"),
        ("1,0\n0,1\n# -1\n", None, "list of coordinates, .* --tiles"),
        ("1,5\n", (5, 5), "line 1: row 5 is not on a floor of 5 x 5 tiles; rows are 0 to 4"),
        ("7,1\n", (5, 5), "line 1: column 7 is not"),
        ("-1,1\n", (5, 5), "line 1: column -1 is not"),
        ("1,1\n1,1\n", (5, 5), "line 2 repeats the tile at column 1, row 1"),
        ("1,1\n1\n# -1", (5, 5), "line 2 holds '1'"),
        ("1,1.5\n2,2", (5, 5), "line 1 holds '1,1.5'"),
        ("1,1\n# -1\n2,2\n", (5, 5), "line 3 stands after '# -1'"),
        (b"\xff\xfe1\x000\x00", None, "binary file"),
        (b"10\x00", None, "binary file"),
        (b"101\n\xe9\n", None, "is not UTF-8 text .byte 5."),
        (b"GIF89a", None, "GIF file; of pictures, only PNG"),
        (b"\xff\xd8\xff\xe0", None, "JPEG file"),
        ("1" * 4_000_001, None, "line 1 is too long"),
        ("1," * 4_000_001, None, "line 1 is too long"),
    ],
)
def test_a_wrong_file_is_refused_with_its_place(file, content, size, message):
    path = file(content)
    with pytest.raises(InputError, match=message) as caught:
        read_tiles(path, size)
    assert caught.value.field == str(path)


def test_a_name_that_is_none_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_tiles(tmp_path / "none.txt")
    for name in ("a\0b", "x" * 5000):
        with pytest.raises(InputError, match="cannot be read"):
            read_tiles(name)


def test_a_file_that_may_not_be_read_is_refused(file, monkeypatch):
    path = file("101")

    def forbidden(*arguments):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("os.open", forbidden)  # who runs the tests may read everything
    with pytest.raises(InputError, match="cannot be read: Permission denied"):
        read_tiles(path)


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
    assert "of 1 of 4 tiles is within 15 percentage points of the threshold, 50 %" in caplog.text
    assert read_tiles(file(png(levels)), threshold=0.52).tolist() == [[0, 1], [0, 0]]
    fine = levels.astype(np.uint16) * 257
    assert read_tiles(file(png(fine)), threshold=0.51).tolist() == [[0, 1], [0, 0]], "130/255 is 0.5098"
    assert read_tiles(file(png(fine)), threshold=130 / 255).tolist() == [[0, 1], [1, 0]]


def test_shapes_that_do_not_follow_the_grid_are_a_floor(file, caplog):
    y, x = np.mgrid[:480, :480]
    circle = (((x - 240) ** 2 + (y - 240) ** 2 < 150**2) * 255).astype(np.uint8)
    tiles = read_tiles(file(png(circle)), (16, 16))
    assert np.array_equal(tiles, tiles[::-1])
    assert tiles.mean() == pytest.approx(np.pi * 150**2 / 480**2, abs=0.03)
    assert 0 < int(caplog.text.split(" of 256 tiles")[0].split()[-1]) < 30
    smaller, larger = (read_tiles(file(png(circle)), (16, 16), at).sum() for at in (0.9, 0.1))
    assert smaller < tiles.sum() < larger
    caplog.clear()
    quarters = np.kron(np.eye(2, dtype=np.uint8), np.full((9, 9), 255, dtype=np.uint8))
    assert read_tiles(file(png(quarters)), (2, 2)).tolist() == [[1, 0], [0, 1]]
    assert caplog.text == "", "nothing is near"


@pytest.mark.parametrize("threshold", [0.0, 1.0, -0.5, 50, float("nan"), "0.5", None, True])
def test_thresholds_that_are_no_share(file, threshold):
    with pytest.raises(InputError, match="--image-threshold"):
        read_tiles(file(png(np.eye(2, dtype=np.uint8) * 255)), threshold=threshold)


def test_what_a_picture_leaves_open_is_refused(file):
    halves = np.array([[0, 255], [255, 0]], dtype=np.uint8)
    with pytest.raises(InputError, match="has only 2 x 2 pixels"):
        read_tiles(file(png(halves)), (3, 3))
    clear = np.zeros((2, 2, 4), dtype=np.uint8)
    with pytest.raises(InputError, match="transparent"):
        read_tiles(file(png(clear)))
    fine = np.array([[0, 65535], [65535, 0]], dtype=np.uint16)
    with pytest.raises(InputError, match="transparent"):
        read_tiles(file(png(fine, transparency=65535)))
    assert read_tiles(file(png(fine, transparency=300))).tolist() == [[0, 1], [1, 0]]


def test_a_picture_is_turned_as_its_exif_data_say(file):
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 6  # to be turned clockwise
    top = np.array([[255, 255], [0, 0], [0, 0]], dtype=np.uint8)
    assert read_tiles(file(png(top, exif=exif))).tolist() == [[0, 0, 1], [0, 0, 1]]


def test_colours_of_a_picture_of_16_bits(file):
    dark = np.array([[500, 60_000]], dtype=np.uint16)
    assert read_palette(file(png(dark)), ("000000", "eeeeee")).tolist() == [[0, 1]]
    with pytest.raises(InputError, match="once"):
        read_palette(file(png(dark)), ("EEEEEE", "eeeeee"))


def test_a_broken_or_vast_picture_is_refused(file):
    whole = png(np.random.default_rng(1).integers(0, 2, (60, 60), dtype=np.uint8) * 255)
    for length in (8, 20, 40, len(whole) // 2, len(whole) - 20):
        with pytest.raises(InputError, match="not a complete PNG"):
            read_tiles(file(whole[:length]))

    def vast(side):  # a few bytes that claim to be side x side pixels
        head = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
        chunk = b"IHDR" + head
        return whole[:8] + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk)) + whole[33:]

    for side in (8_001, 12_000, 100_000):
        with pytest.raises(InputError, match="large"):
            read_tiles(file(vast(side)))
    with pytest.raises(InputError, match="too many for one tile each"):
        read_tiles(file(png(np.zeros((2001, 2001), dtype=np.uint8))))


@quick
@given(content=st.binary(max_size=200), size=st.none() | st.tuples(st.integers(1, 5), st.integers(1, 5)))
def test_any_bytes_give_a_floor_or_an_input_error(file, content, size):
    check(file(content), size)


@quick
@given(
    content=st.text(st.sampled_from("0101,; \t\n#-29ex."), max_size=60) | st.text(max_size=60),
    size=st.none() | st.tuples(st.integers(1, 5), st.integers(1, 5)),
)
def test_any_text_gives_a_floor_or_an_input_error(file, content, size):
    check(file(content.encode("utf-8", "surrogatepass")), size)


@quick
@given(place=st.integers(8, 10_000), value=st.integers(0, 255), cut=st.integers(0, 40))
def test_any_damage_to_a_picture_gives_a_floor_or_an_input_error(file, place, value, cut):
    content = bytearray(png(np.eye(9, dtype=np.uint8) * 255))
    content[8 + place % (len(content) - 8)] = value
    check(file(bytes(content[: len(content) - cut])), None)


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


@pytest.mark.parametrize(
    ("text", "size"), [("5x5", (5, 5)), (" 20 X 30 ", (20, 30)), ("1×7", (1, 7)), ("2000x2000", (2000, 2000))]
)
def test_sizes(text, size):
    assert parse_tiles(text) == size


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("5", "'5' is not a size; give rows x columns"),
        ("5x", "is not a size"),
        ("-5x5", "is not a size"),
        ("5.0x5", "is not a size"),
        ("", "is not a size"),
        ("٥x٥", "is not a size"),
        ("0x5", "holds no tiles"),
        ("2001x2000", "too large; at most 4,000,000 tiles"),
        ("9" * 5000 + "x1", "is not a size"),
    ],
)
def test_wrong_sizes(text, message):
    with pytest.raises(InputError, match=message) as caught:
        parse_tiles(text)
    assert caught.value.field == "--tiles"


@pytest.mark.parametrize("suffix", [".txt", ".csv"])
def test_more_rows_than_can_be_read_are_not_written(tmp_path, suffix):
    path = tmp_path / f"long{suffix}"
    with pytest.raises(
        InputError, match=r"500,001 rows are too many .* at most 500,000; end the name with \.png"
    ):
        write_tiles(path, np.zeros((MAX_LINES + 1, 1), dtype=np.uint8))
    assert not path.exists()


def test_writing_refuses_other_suffixes_and_files_that_are_there(tmp_path):
    tiles = np.eye(3, dtype=np.uint8)
    with pytest.raises(
        InputError, match=re.escape("'.gif' is not known; end the name with .txt, .csv or .png")
    ):
        write_tiles(tmp_path / "a.gif", tiles)
    with pytest.raises(InputError, match="has no suffix"):
        write_tiles(tmp_path / "a", tiles)
    path = tmp_path / "a.txt"
    write_tiles(path, tiles)
    assert path.read_text() == "100\n010\n001\n"
    with pytest.raises(InputError, match=r"^path: .*exists already"):
        write_tiles(path, tiles)
    with pytest.raises(InputError, match="exists already"):
        check_new(path)
    check_new(path, replace=True)
    with pytest.raises(InputError, match="no folder"):
        check_new(tmp_path / "none" / "a.txt")
    folder = tmp_path / "b.txt"
    folder.mkdir()
    with pytest.raises(InputError, match="is a folder"):
        check_new(folder)
