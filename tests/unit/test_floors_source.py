from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from vibroswarm.errors import InputError
from vibroswarm.floors.source import NAMES, is_random, pattern, random_tiles, resolve


def test_a_random_floor_is_of_its_seed_and_run():
    tiles, name = resolve("random:0.48", None, 3, 4)
    assert name == "random:0.48"
    assert np.array_equal(tiles, random_tiles(5, 5, 0.48, 3, 4))
    assert np.array_equal(resolve("random:.5", (4, 6), 3, 4)[0], random_tiles(4, 6, 0.5, 3, 4))
    assert not np.array_equal(resolve("random:0.48", (25, 25), 3)[0], resolve("random:0.48", (25, 25), 4)[0])


def test_only_random_floors_are_fresh_for_each_run():
    assert is_random("random:0.48")
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


@settings(deadline=None, max_examples=60)
@given(st.text(max_size=20))
def test_any_spec_gives_a_floor_or_an_input_error(spec):
    try:
        tiles, _ = resolve(spec)
    except InputError:
        return
    assert set(np.unique(tiles)) <= {0, 1}
