"""Reading measured energies."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibroswarm.errors import InputError
from vibroswarm.observation.measured_csv import read_energies


def test_kinds_and_energies(tmp_path):
    path = tmp_path / "e.csv"
    path.write_text("robot,kind,energy\n1,vibrating,2.5\n2,still,0.5\n\n1,1,3\n1,0,0.25\n1,non-vibrating,0\n")
    assert read_energies(path) == ((2.5, 3.0), (0.5, 0.25, 0.0))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("a,b\n1,2\n", "has to name kind and energy"),
        ("kind;energy\nstill;1,5\n", "'kind;energy'; it has to name kind and energy, with ',' between them"),
        ("kind,energy\nstill,1\n", "no energy of a vibrating tile"),
        ("kind,energy\nvibrating,1\n", "no energy of a still tile"),
        ("kind,energy\nwobbling,1\n", "line 2: 'wobbling' is not a kind"),
        ("kind,energy\nstill,-1\n", "line 2: '-1' is not an energy"),
        ("kind,energy\nstill,nan\n", "line 2: 'nan' is not an energy"),
        ("kind,energy\nstill,1e10\n", "line 2: '1e10' is not an energy; use a number from 0 to 1e9"),
        ("kind,energy\nstill,inf\n", "line 2: 'inf' is not an energy"),
        ("kind,energy\nstill,1,2\n", "line 2: 3 columns where the first line has 2"),
    ],
)
def test_what_is_wrong_is_named(text, words, tmp_path):
    path = tmp_path / "e.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        read_energies(path)


@given(st.binary(max_size=200))
def test_any_bytes_give_energies_or_an_input_error(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("e") / "e.csv"
    path.write_bytes(data)
    try:
        found = read_energies(path)
    except InputError:
        return
    assert all(len(energies) > 0 for energies in found)
