from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vibroswarm.floors
from helpers.commands import printed_by
from vibroswarm.errors import InputError
from vibroswarm.floors.source import NAMES, is_random, named_tiles, pattern, random_tiles, resolve


def test_a_pattern_by_name():
    tiles, name = resolve("Block_diagonal:.46")
    assert name == "block-diagonal:0.46"
    assert np.array_equal(tiles, pattern("block-diagonal:0.46"))
    assert np.array_equal(resolve("stripe:0.48", (10, 10))[0], pattern("stripe:0.48"))


def test_a_pattern_has_its_own_size():
    with pytest.raises(InputError, match=r"'stripe:0\.48' has 10x10 tiles, not 5x5") as caught:
        resolve("stripe:0.48", (5, 5))
    assert caught.value.field == "--tiles"


def test_a_random_floor_is_of_its_seed_and_run():
    tiles, name = resolve("random:0.48", None, 3, 4)
    assert name == "random:0.48"
    assert np.array_equal(tiles, random_tiles(5, 5, 0.48, 3, 4))
    assert np.array_equal(resolve("Random:.5", (4, 6), 3, 4)[0], random_tiles(4, 6, 0.5, 3, 4))
    assert not np.array_equal(resolve("random:0.48", (25, 25), 3)[0], resolve("random:0.48", (25, 25), 4)[0])


def test_only_random_floors_are_fresh_for_each_run():
    assert is_random("random:0.48")
    assert is_random("RANDOM:0.48")
    assert not any(is_random(name) for name in (*NAMES, "random.txt", "random-fixed:0.48", "./random:0.48"))


def test_a_file_by_its_name(tmp_path, monkeypatch):
    path = tmp_path / "my floor.txt"
    path.write_text("10\n01\n")
    assert resolve(str(path))[1] == "my floor.txt"
    assert resolve(str(path))[0].tolist() == [[1, 0], [0, 1]]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plain").write_text("1,2\n# -1\n")
    assert resolve("plain", (4, 3))[0].tolist() == [[0, 0, 0], [0, 0, 0], [0, 1, 0], [0, 0, 0]]
    (tmp_path / "stripe:0.48").write_text("1\n")
    assert resolve("./stripe:0.48")[0].tolist() == [[1]]
    assert np.array_equal(resolve("stripe:0.48")[0], pattern("stripe:0.48"))


def test_a_grid_of_another_size_is_refused(tmp_path):
    path = tmp_path / "f.txt"
    path.write_text("100\n010\n")
    with pytest.raises(InputError, match="holds 2 x 3 tiles, not the 3 x 3"):
        resolve(str(path), (3, 3))


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("diagnal:0.48", "neither a floor nor a file, did you mean 'diagonal:0.48'"),
        ("strype:0.46", "did you mean 'stripe:0.46'"),
        ("", "neither a floor nor a file"),
        ("random", "'random' needs a fill ratio; give for example random:0.48"),
        ("random:much", "'much' is not a fill ratio"),
        ("random:0.5", "0.5 of 5 x 5 tiles is 12.5"),
        ("random:inf", "is not a share"),
        ("alternating", "needs a fill ratio; give alternating:0.48 or .*paper-0.46"),
        ("floors/none.txt", "no such file"),
        ("none.csv", "no such file"),
        ("a\0b", "neither a floor nor a file"),
        ("x" * 5000, "neither a floor nor a file"),
    ],
)
def test_an_unknown_floor_says_what_would_be_right(spec, message):
    with pytest.raises(InputError, match=message):
        resolve(spec)


@settings(deadline=None, max_examples=60)
@given(st.text(max_size=20))
def test_any_spec_gives_a_floor_or_an_input_error(spec):
    try:
        tiles, _ = resolve(spec)
    except InputError:
        return
    assert set(np.unique(tiles)) <= {0, 1}


def test_named_tiles_reads_no_files(tmp_path):
    path = tmp_path / "f.txt"
    path.write_text("10\n01\n")
    with pytest.raises(InputError, match="is a file, which is read from"):
        named_tiles(str(path), 2, 2, 0, 0)
    assert np.array_equal(named_tiles("random:0.25", 2, 2, 1, 2), random_tiles(2, 2, 0.25, 1, 2))
    assert np.array_equal(named_tiles("diagonal:0.48", 2, 2, 0, 0), pattern("diagonal:0.48"))


def test_the_room_offers_its_names():
    for name in vibroswarm.floors.__all__:
        assert getattr(vibroswarm.floors, name).__name__ == name
    assert set(vibroswarm.floors.__all__) == set(dir(vibroswarm.floors))
    with pytest.raises(AttributeError, match="attribute nothing"):
        vibroswarm.floors.nothing  # noqa: B018


def test_importing_the_room_loads_nothing_heavy():
    code = (
        "import sys, vibroswarm.floors, vibroswarm.cli.floors; "
        "print(sorted({'numpy', 'numba', 'scipy', 'PIL', 'matplotlib'} & set(sys.modules)))"
    )
    assert printed_by(code) == "[]\n"
