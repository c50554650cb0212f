"""Documents in a terminal: names and numbers stay whole at any width, and belong to their rows."""

from __future__ import annotations

import io
import re
import string

import polars as pl
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from helpers.table_checks import too_wide
from vibroswarm.show import cells
from vibroswarm.show.document import Column, Document, Figure, Section, Table, Text
from vibroswarm.show.terminal import Grid, print_document

WIDTHS = (40, 60, 80, 140, 100_000)
LIMITS = {"right": ("right_low", "right_high"), "time": ("time_low", "time_high")}
COLUMNS = {
    "cell": Column(),
    "right": Column("robots right", share=True, limits=LIMITS["right"]),
    "time": Column("decision time", "s", limits=LIMITS["time"], decimals=0),
}
CELLS = pl.DataFrame(
    {
        "cell": ["robots 5, none", "robots 5, soft", "robots 6, none", "robots 6, soft", "robots 7, soft"],
        "right": [0.425, 0.5, 0.51, 0.625, 0.626],
        "right_low": [0.285, 0.352, 0.353, 0.47, 0.471],
        "right_high": [0.578, 0.648, 0.649, 0.758, 0.759],
        "time": [911.0, 779.0, 894.0, 715.0, 716.0],
        "time_low": [810.0, 681.0, 781.0, 608.0, 609.0],
        "time_high": [1012.0, 877.0, 1006.0, 821.0, 822.0],
    }
)


def printed(
    *parts: Text | Table | Section, width: int = 100_000, wide: bool = False, answer: str = "It is."
) -> str:
    file = io.StringIO()
    print_document(Document("a title", (answer,), parts=parts), file, width, wide=wide)
    return file.getvalue()


words = st.lists(st.text("abcdefgh_", min_size=1, max_size=14), min_size=1, max_size=4).map(" ".join)


@st.composite
def tables(draw: st.DrawFn) -> Table:
    count, rows = draw(st.integers(1, 9)), draw(st.integers(1, 6))
    frame = {"names": draw(st.lists(words, min_size=rows, max_size=rows))}
    columns = {}
    for letter in string.ascii_lowercase[:count]:
        numbers = st.lists(st.integers(-99999, 99999).map(lambda n: n / 10), min_size=rows, max_size=rows)
        kind = draw(st.sampled_from(["number", "limits", "text"]))
        frame[letter] = draw(st.lists(words, min_size=rows, max_size=rows) if kind == "text" else numbers)
        columns[letter] = Column(draw(words), decimals=1)
        if kind == "limits":
            frame[f"{letter}_low"], frame[f"{letter}_high"] = draw(numbers), draw(numbers)
            columns[letter] = Column(draw(words), limits=(f"{letter}_low", f"{letter}_high"), decimals=1)
    return Table(pl.DataFrame(frame), columns)


def lost(table: Table, text: str) -> list[str]:
    """Words and numbers of the rows that are missing, or there only in pieces; each counts as often as it is there."""
    there = re.sub(r"[\[\],]", " ", text).split()
    missing = []
    for value in (value for row in table.frame.rows() for value in row):
        for word in value.split() if isinstance(value, str) else [f"{value:.1f}".replace("-0.0", "0.0")]:
            if (word := word.strip(",")) in there:
                there.remove(word)
            else:
                missing.append(word)
    return missing


LONG = Table(
    pl.DataFrame({"cell": ["x" * 50, "y" * 50, "y" * 50] * 2, "a": [1.0, 2.5, 3.0] * 2}),
    {"a": Column(decimals=1)},
)


@given(tables(), st.sampled_from(WIDTHS))
@example(LONG, 60)
@example(LONG, 40)
def test_no_word_and_no_number_is_lost_or_cut(table: Table, width: int) -> None:
    text = printed(table, width=width)
    assert lost(table, text) == []
    assert too_wide(text.splitlines(), width) == []


def test_a_cut_table_is_found() -> None:
    """Negative control."""
    table = Table(CELLS, {name: Column(decimals=1) for name in CELLS.columns})
    whole = printed(table)
    assert lost(table, whole) == []
    assert "1012.0" in lost(table, "\n".join(line[:50] for line in whole.splitlines()))
    assert "none" in lost(table, "\n".join(line[16:] for line in whole.splitlines()))
    assert too_wide(whole.splitlines(), 60)


@pytest.mark.parametrize("width", WIDTHS)
def test_values_stay_with_their_rows(width: int) -> None:
    """Read back: in the lines from a name up to the next one stand the row's own values, and nobody else's."""
    text = printed(Table(CELLS, COLUMNS), width=width)
    places = [text.index(name) for name in CELLS["cell"]] if width > 60 else []
    for row, start, end in zip(CELLS.iter_rows(named=True), places, [*places[1:], len(text)], strict=False):
        found = re.findall(r"\d+(?:\.\d+)?", text[start + len(row["cell"]) : end])
        wanted = [f"{100 * row[n]:.1f}" for n in ("right", *LIMITS["right"])]
        wanted += [f"{row[n]:.0f}" for n in ("time", *LIMITS["time"])]
        assert found == wanted
    assert text.count("[") == 2 * CELLS.height


def test_few_rows_are_turned() -> None:
    lines = printed(Table(CELLS[:1], COLUMNS), width=45).splitlines()
    assert lines[2].split() == ["cell", "robots", "5,", "none"]
    assert lines[3].split(maxsplit=3) == ["robots", "right,", "%", "42.5 [28.5, 57.8]"]


def test_layouts_from_wide_to_narrow() -> None:
    assert "robots 5, none  42.5 [28.5, 57.8]   911 [810, 1012]" in printed(Table(CELLS, COLUMNS), width=100)
    narrow = printed(Table(CELLS, COLUMNS), width=40).splitlines()
    assert any(line.split() == ["none", "[28.5,", "57.8]", "[810,", "1012]"] for line in narrow), (
        "below estimates"
    )
    wide = pl.DataFrame({"cell": list("vwxyz"), **{name: [1234567] * 5 for name in "abcdefghij"}})
    assert sum(line.startswith("cell") for line in printed(Table(wide), width=60).splitlines()) == 2, (
        "in two parts"
    )
    one = printed(LONG, width=40).splitlines()
    assert one[2:4] == ["x" * 50, "  a: 1.0"], "a line for each value"


def test_a_table_of_hundreds_of_columns_is_laid_out_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The part that fits was found by trying all sizes: half a minute for 636 columns, hours for 10,000."""
    tried, real = [], Grid.part
    monkeypatch.setattr(Grid, "part", lambda grid, columns: (tried.append(columns), real(grid, columns))[1])
    text = printed(
        Table(pl.DataFrame({"cell": list("vwxyz"), **{f"x{k}": [1] * 5 for k in range(300)}})), width=60
    )
    assert sum(line.startswith("cell") for line in text.splitlines()) == len(tried)


def test_columns_that_do_not_fit_together_fill_the_width() -> None:
    frame = pl.DataFrame({"0": list("abcde"), **{letter: [1] * 5 for letter in string.ascii_letters[:30]}})
    text = printed(Table(frame, names=1), width=40)
    assert max(map(len, text.splitlines())) == 40  # a name and 13 numbers, each after two blanks


def test_letters_of_two_columns_and_of_none() -> None:
    lines = printed(Table(pl.DataFrame({"floor": ["床" * 5, "a\u0301"], "n": [1, 22]}))).splitlines()
    assert lines[-2:] == ["床" * 5 + "   1", "a\u0301" + " " * 9 + "  22"]


def test_fewer_columns_rows_and_parts_unless_all_are_asked_for() -> None:
    table = Table(CELLS, COLUMNS | {"time": Column(wide=True, limits=LIMITS["time"])})
    long = Table(pl.DataFrame({"run": range(1000, 1100)}))
    folded = Section("In detail", (Text("words of the detail"),), folded=True)
    few, whole = (printed(table, long, folded, wide=wide) for wide in (False, True))
    for words in ("911", "1099", "words of the detail", "In detail"):
        assert words not in few
        assert words in whole
    assert "40 more rows; --wide prints all." in few


def test_the_answer_comes_first_and_paragraphs_break_between_words() -> None:
    path = "/a-very-long/path-to-a-folder/that-is/longer-than/the-terminal/run.html"
    text = printed(Text(f"Saved in {path} and a share of 12 % and 5 robots"), width=60, answer="It vibrates.")
    assert text.splitlines()[0] == "It vibrates."
    assert text.splitlines()[1:4] == ["", "Saved in", path]
    assert printed(Table(CELLS), Text("It is so.")).endswith("\n\nIt is so.\n"), "an empty line below a table"
    for width in range(40, 70):
        assert "12 %" in printed(Text("a " * 20 + "share of 12 % of all"), width=width), (
            "a number and its unit"
        )


def test_a_terminal_acts_on_no_text_of_a_file() -> None:
    nasty = "\x1b[31mred\x07 [bold]no markup[/bold] :smile: \u202e"
    frame = pl.DataFrame({nasty: [nasty]})
    text = printed(Text(nasty), Table(frame, caption=nasty), Section(nasty, (Text(nasty),)), answer=nasty)
    assert "\x1b" not in text
    assert "\x07" not in text
    assert text.count("[bold]no markup[/bold] :smile:") == 7


def test_sections_of_figures_alone_are_left_out() -> None:
    drawn = Figure("picture", lambda style: pytest.fail("a terminal draws nothing"))
    assert printed(Section("Pictures", (drawn, Section("More", (drawn,))))) == "It is.\n"
    assert printed(Section("Pictures", (drawn, Text("What it shows.", "aside")))) == "It is.\n"


@pytest.mark.parametrize(
    ("values", "written"),
    [
        ([0.52, 0.4], ["0.52", "0.40"]),  # they were 1 and 0
        ([3.26, 0.4], ["3.3", "0.4"]),
        ([812.4, 0.4], ["812", "0"]),
        ([3.0, 2.0], ["3", "2"]),
        ([0.0, None], ["0", "-"]),
    ],
)
def test_columns_of_whole_numbers_have_decimals_where_all_are_small(values, written):
    laid = cells.written(Table(pl.DataFrame({"a": values}), {"a": Column("time", "s", decimals=0)}))
    assert [row[0].text for row in laid.rows] == written


def test_limits_that_differ_are_not_written_alike() -> None:
    """Beside far larger numbers they were 0 [0, 0], as if the difference were known exactly."""
    frame = pl.DataFrame({"a": [118.0, -0.1, 0.0], "low": [90.0, -0.3, 0.0], "high": [147.0, 0.2, 0.0]})
    column = Column("time", "s", limits=("low", "high"), decimals=0)
    laid = cells.written(Table(frame, {"a": column}))
    assert [row[0].text + " " + row[0].limits for row in laid.rows] == [
        "118 [90, 147]", "-0.10 [-0.30, 0.20]", "0 [0, 0]",
    ]  # fmt: skip
    shares = pl.DataFrame({"a": [0.9681, 0.5], "a_low": [0.9679, 0.4], "a_high": [0.9684, 0.6]})
    laid = cells.written(Table(shares, {"a": Column(share=True)}))
    assert laid.rows[0][0].limits == "[96.790, 96.840]"  # it was 97 [97, 97]
