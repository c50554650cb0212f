"""Reading measured energies."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from vibroswarm.errors import InputError
from vibroswarm.sensors.energies import read_energies


def test_kinds_and_energies(tmp_path):
    path = tmp_path / "e.csv"
    path.write_text(
        "\ufeffRobot;Kind;Energy\n1;vibrating;2,5\n2;still;0,5\n\n1;1;3\n1;0;0,25\n1;non-vibrating;0\n",
        encoding="utf-8",
    )
    assert read_energies(path) == ((2.5, 3.0), (0.5, 0.25, 0.0))


@given(st.binary(max_size=200))
def test_any_bytes_give_energies_or_an_input_error(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("e") / "e.csv"
    path.write_bytes(data)
    try:
        found = read_energies(path)
    except InputError:
        return
    assert all(len(energies) > 0 for energies in found)
