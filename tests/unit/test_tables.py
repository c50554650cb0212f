"""Tables in the terminal: names and numbers stay whole at any width, and belong to their rows."""

from __future__ import annotations

import re

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from helpers.table_checks import too_wide
from vibroswarm.cli import terminal
from vibroswarm.cli.output import paragraph, table_lines
from vibroswarm.cli.tables import Table, cell_width, layout, table_of

WIDTHS = (60, 80, 100, 140, terminal.UNLIMITED)
CELLS = table_of(
    ["cell", "right, %", "wrong, %", "robots undecided, %", "decision time, s"],
    [
        ["robots 5, none", "42.5 [28.5, 57.8]", "7.5 [2.6, 19.9]", "47.5 [32.3, 62.7]", "911 [810, 1012]"],
        ["robots 5, soft", "50.0 [35.2, 64.8]", "15.0 [7.1, 29.1]", "29.5 [16.8, 42.7]", "779 [681, 877]"],
        ["robots 6, none", "51.0 [35.3, 64.9]", "0.0 [0.0, 8.8]", "50.0 [34.8, 65.2]", "894 [781, 1006]"],
        ["robots 6, soft", "62.5 [47.0, 75.8]", "10.0 [4.0, 23.1]", "24.2 [12.4, 37.7]", "715 [608, 821]"],
        ["robots 7, soft", "62.6 [47.1, 75.9]", "10.1 [4.1, 23.2]", "24.3 [12.5, 37.8]", "716 [609, 822]"],
    ],
)

word = st.text("abcdefgh_", min_size=1, max_size=14)
name = st.lists(word, min_size=1, max_size=4).map(" ".join)
number = st.decimals(-9999, 9999, places=1).map(str)
value = st.one_of(number, st.tuples(number, number, number).map(lambda v: f"{v[0]} [{v[1]}, {v[2]}]"))


@st.composite
def tables(draw: st.DrawFn) -> Table:
    count = draw(st.integers(1, 9))
    row = st.tuples(name, *[value] * count)
    names = draw(st.lists(name, min_size=count + 1, max_size=count + 1))
    return table_of(names, draw(st.lists(row, min_size=1, max_size=6)))


def words_lost(table: Table, lines: list[str]) -> list[str]:
    """Words and numbers of the rows that are missing, or there only in pieces; each counts as often as it is there."""
    there = " ".join(lines).split()
    lost = []
    for text in " ".join(cell for row in table.rows for cell in row).split():
        if text in there:
            there.remove(text)
        else:
            lost.append(text)
    return lost


@given(tables(), st.sampled_from(WIDTHS))
@example(CELLS, 60)
@example(table_of(["cell", "a"], [["x" * 50, "1"], ["y" * 50, "2.5 [1.5, 3.5]"], ["y" * 50, "3"]] * 2), 60)
def test_no_word_and_no_number_is_lost_or_cut(table, width):
    lines = layout(table, width)
    assert words_lost(table, lines) == []
    assert too_wide(lines, width) == []


def test_a_cut_table_is_found():
    cut = [line[:50] for line in layout(CELLS, terminal.UNLIMITED)]
    assert "1012]" in words_lost(CELLS, cut)
    without_names = [line[16:] for line in layout(CELLS, terminal.UNLIMITED)]
    assert "none" in words_lost(CELLS, without_names)
    assert too_wide(layout(CELLS, terminal.UNLIMITED), 60)


@pytest.mark.parametrize("width", WIDTHS)
def test_values_stay_with_their_rows(width):
    """Read back: the text from a name up to the next one holds the row's own values, and nobody else's."""
    text = "\n".join(layout(CELLS, width))
    places = [text.index(row[0]) for row in CELLS.rows]
    assert places == sorted(places)
    for row, start, end in zip(CELLS.rows, places, [*places[1:], len(text)], strict=True):
        found = re.findall(r"\d+(?:\.\d+)?", text[start + len(row[0]) : end])
        wanted = [n for cell in row[1:] for n in re.findall(r"\d+(?:\.\d+)?", cell)]
        assert sorted(found) == sorted(wanted)


def test_few_rows_are_transposed():
    one = CELLS._replace(rows=CELLS.rows[:1])
    lines = layout(one, 60)
    assert lines[0].split() == ["cell", "robots", "5,", "none"]
    assert lines[1].split(maxsplit=2) == ["right,", "%", "42.5 [28.5, 57.8]"]


def test_layouts_from_wide_to_narrow():
    assert layout(CELLS, 100)[1].startswith("robots 5, none  42.5 [28.5, 57.8]")
    at_80 = layout(CELLS, 80)
    assert at_80[1].split() == ["robots", "5,", "none", "42.5", "7.5", "47.5", "911"]
    assert at_80[2].split() == ["[28.5,", "57.8]", "[2.6,", "19.9]", "[32.3,", "62.7]", "[810,", "1012]"]
    assert "robots 5, none" in layout(CELLS, 60), "a line of its own"
    wide = table_of(["cell", *"abcdefghij"], [["x", *["1234567"] * 10]] * 5)
    assert sum(line.startswith("cell") for line in layout(wide, 60)) == 2, "in two parts"


@pytest.mark.parametrize("names", [1, 2])
def test_a_table_of_names_only_is_shown_at_any_width(names):
    table = table_of(["name", "kind"][:names], [[c * 200, "a kind"][:names] for c in "xy"], names=names)
    assert words_lost(table, layout(table, 60)) == []


def test_letters_of_two_columns_and_of_none():
    lines = layout(table_of(["floor", "n"], [["床" * 5, "1"], ["a\u0301", "22"]]), 60)
    assert [cell_width(line) for line in lines] == [14, 14, 14]


def test_fewer_columns_unless_wide(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    rows = [["a", 1, 2]]
    short = table_lines(["cell", "right, %", "split, %"], rows, more=("split, %",))
    assert short[-1] == "Also with --wide: split."
    assert words_lost(table_of(["cell", "right, %"], [["a", 1]]), short) == []
    monkeypatch.setattr(terminal.printing, "wide", True)
    wide = table_lines(["cell", "right, %", "split, %"], rows, more=("split, %",))
    assert wide == ["cell  right, %  split, %", "a            1         2"]


def test_paragraphs_break_between_words_and_keep_their_indent(monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    path = "/a-very-long/path-to-a-folder/that-is/longer-than/the-terminal/run.html"
    lines = paragraph(f"  Saved in {path} and other words that follow it on the next line").splitlines()
    assert lines[0] == "  Saved in"
    assert lines[1] == f"  {path}"
    assert all(line.startswith("  ") for line in lines)


@pytest.mark.parametrize(
    ("columns", "width"), [("72", 72), ("", terminal.UNLIMITED), ("x", terminal.UNLIMITED), ("7", 40)]
)
def test_the_width(monkeypatch, columns, width):
    monkeypatch.setenv("COLUMNS", columns)
    monkeypatch.setattr(terminal, "is_terminal", lambda: False)
    assert terminal.width() == width
