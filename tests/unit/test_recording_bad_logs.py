"""What is wrong with a log is said with its row, and what can be mended is counted."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.recordings import floor_fit
from vibroswarm.recordings.assemble_recording import count_lines, recording_of
from vibroswarm.recordings.floor_fit import ORIENTATIONS, floor_fits, turned
from vibroswarm.recordings.log import Log, in_order, unwrapped
from vibroswarm.recordings.log_readers import read_log
from vibroswarm.scenario.scenario import preset

if TYPE_CHECKING:
    from vibroswarm.recordings.recording import Recording

Rows = list[list[str]]


@pytest.fixture
def changed(logs: list[Path], tmp_path: Path) -> Callable[[Callable[[Rows], object]], Path]:
    """The first log with its rows of cells changed."""

    def make(change: Callable[[Rows], object]) -> Path:
        rows = [line.split(",") for line in logs[0].read_text().splitlines()]
        change(rows)
        path = tmp_path / "changed.csv"
        path.write_text("\n".join(",".join(row) for row in rows) + "\n")
        return path

    return make


@pytest.fixture(scope="module")
def log(logs: list[Path]) -> Log:
    """The first log as it is."""
    return read_log(logs[0])


@pytest.fixture(scope="module")
def recorded(log: Log, ground: Floor) -> Recording:
    """The control of tests that change the log."""
    return recording_of([log], ground, preset("paper"))


def first_sample(rows: Rows, nth: int = 0) -> int:
    return [k for k, row in enumerate(rows) if k and row[6] != "None"][nth]


def put(line: int, cell: int, text: str) -> Callable[[Rows], object]:
    def change(rows: Rows) -> None:
        rows[line - 1][cell] = text

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (put(1, 6, "Energie"), r"has no column 'Energy', did you mean 'Energie'\?"),
        (put(1, 11, "Sent"), r"has no column 'Swarm Send'.*give a column map without it \(--columns\)"),
        (put(40, 4, "left"), r"row 40: 'left' in column 'X Meter' is not a number"),
        (put(40, 1, "nan"), r"row 40: 'nan' in column 'Timestamp' is not a number"),
        (put(40, 1, ""), r"row 40: empty cell in column 'Timestamp'"),
        (put(40, 1, "1.7e9"), r"row 40: 1.*0 in column 'Timestamp' is not a time since the start of the session"),
        (put(40, 2, "2.5"), r"row 40: 2.5 in column 'ROV Number' is not a whole number from 0 on"),
        (put(40, 2, "77"), r"row 40: robot 77 has marker|unknown robot 77"),
        (lambda rows: rows[39].append("1"), r"row 40: 16 cells, but the header has 15"),
        (lambda rows: put(first_sample(rows) + 1, 10, "7")(rows), r"'7' in column 'd_f' is not one of 2, 0, 1"),
        (lambda rows: put(first_sample(rows) + 1, 9, "1.5")(rows), r"1.5 in column 'Belief' is not a prob"),
        (lambda rows: put(first_sample(rows) + 1, 6, "-1")(rows), r"-1 in column 'Energy' is not a number from 0"),
        (lambda rows: put(first_sample(rows, 60) + 1, 11, "3")(rows), r"robot \d has sent \d+ messages"),
        (lambda rows: put(first_sample(rows, 60) + 1, 11, "None")(rows), r"messages sent by robot \d, which"),
        (lambda rows: rows.insert(900, rows[20]), r"^$"),  # a row that stands twice is left out
        (lambda rows: rows.insert(900, [*rows[20][:4], "0.5", *rows[20][5:]]), r"row 901: its time"),
        (lambda rows: rows.insert(21, [*rows[20][:4], "0.9", *rows[20][5:]]), r"row 22: robot \d is in two places"),
    ],
)  # fmt: skip
def test_a_wrong_row_is_named(
    changed: Callable[[Callable[[Rows], object]], Path], change: Callable[[Rows], object], words: str
) -> None:
    def in_a_short_log(rows: Rows) -> None:
        del rows[1500:]  # 64 s: all that is changed is before
        change(rows)

    path = changed(in_a_short_log)
    if words == "^$":
        assert in_order(read_log(path)).counts["rows_repeated"] == 1
        return
    with pytest.raises(InputError, match=words):
        in_order(read_log(path))


def test_late_rows_are_put_in_their_place_and_lost_ones_counted(
    changed: Callable[[Callable[[Rows], object]], Path], log: Log
) -> None:
    def shuffle(rows: Rows) -> None:
        rows.insert(104, rows.pop(100))  # within a loop or two of the camera
        rows.insert(212, rows.pop(203))
        rows.pop(first_sample(rows, 30))
        rows.pop(first_sample(rows))

    mended, whole = in_order(read_log(changed(shuffle))), in_order(log)
    assert 1 <= mended.counts["rows_late"] <= 2
    assert mended.counts["samples_lost"] == 2
    assert whole.counts["samples_lost"] == whole.counts["rows_late"] == 0
    assert mended.tracks["time_s"].is_sorted()


def test_a_clock_that_jumps_is_told(
    changed: Callable[[Callable[[Rows], object]], Path], ground: Floor, recorded: Recording
) -> None:
    def jump(rows: Rows) -> None:
        for row in rows[1:]:
            row[1] = str(float(row[1]) + 3600.0 * (float(row[1]) > 50.0))

    recording = recording_of([read_log(changed(jump))], ground, preset("paper"))
    found = [list(count_lines(one)) for one in (recording, recorded)]
    words = " s without a row of any robot: a pause, or a clock that jumped"
    assert [any(words in line for line in lines) for lines in found] == [True, False]


def test_counters_that_wrap_go_on() -> None:
    out, times, odd = unwrapped(np.array([65.0, 65.5, 0.2, 1.0]), 65.536, np.array([0.0, 1.0, 2.0, 3.0]))
    assert out.tolist() == pytest.approx([65.0, 65.5, 65.736, 66.536])
    assert (times, odd.any()) == (1, False)


PLAIN = "robot,time_s,x_m,y_m,energy,{}\n"
PLAIN_MAP = "[columns]\n" + "".join(
    f'{use} = "{use}"\n' for use in ("robot", "time_s", "x_m", "y_m", "energy")
)


def test_a_counter_wraps_above_0(tmp_path: Path) -> None:
    columns = PLAIN_MAP + 'sent = { name = "sent", wraps_at = 0 }\n'
    (tmp_path / "plain.csv").write_text(PLAIN.format("sent") + "1,2.0,0.5,0.5,1.25,2\n")
    (tmp_path / "map.toml").write_text(columns)
    with pytest.raises(InputError, match=r"columns\.sent, wraps_at: 0 is not above 0"):
        read_log(tmp_path / "plain.csv", columns=tmp_path / "map.toml")


def test_a_robot_decides_no_sooner_than_its_log_says(
    changed: Callable[[Callable[[Rows], object]], Path], ground: Floor, recorded: Recording
) -> None:
    """Robots whose log had no decision before the first were taken to have decided at their first sample."""

    def drop_undecided(rows: Rows) -> None:
        place = rows[0].index("d_f")
        for row in rows[1:]:
            row[place] = row[place].replace("2", "None")

    without = recording_of([read_log(changed(drop_undecided))], ground, preset("paper"))
    assert without.robots["decision_time_s"].to_list() == recorded.robots["decision_time_s"].to_list()
    assert any("without a decision, taken as not logged" in line for line in count_lines(without))


@pytest.mark.parametrize("orientation", ORIENTATIONS[1:])
def test_a_floor_that_is_turned_is_told_so(log: Log, ground: Floor, orientation: str) -> None:
    """What would have to be done to the floor that was given is the reverse of what was done to it."""
    wrong = Floor.filling(turned(ground.tiles, orientation))
    if np.array_equal(wrong.tiles, ground.tiles):
        pytest.skip("the floor is alike")
    with pytest.raises(InputError, match=r"does not fit: of random floors .* it fits"):
        recording_of([log], wrong, preset("paper"))
    fits = floor_fits(wrong, in_order(log).samples)
    assert np.array_equal(turned(wrong.tiles, fits[0].orientation), ground.tiles)
    assert fits[0].probability >= 1 / (floor_fit.FLOORS + 1)  # never 0, whatever other floors do
