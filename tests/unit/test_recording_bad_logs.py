"""What is wrong with a log is said with its row, and what can be mended is counted."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
import polars as pl
import pytest

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.recordings import floor_fit
from vibroswarm.recordings.assemble_recording import count_lines, recording_of
from vibroswarm.recordings.column_map import seconds_of
from vibroswarm.recordings.floor_fit import ORIENTATIONS, check_floor, floor_fits, turned
from vibroswarm.recordings.log import COUNTED, Log, in_order, unwrapped
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


def test_a_clock_that_starts_late_is_told(
    changed: Callable[[Callable[[Rows], object]], Path], ground: Floor
) -> None:
    def later(rows: Rows) -> None:
        rows[1:] = [[row[0], str(float(row[1]) + 100.0), *row[2:]] for row in rows[1:]]

    recording = recording_of([read_log(changed(later))], ground, preset("paper"))
    told = "  100 s before the first row, of which nothing is known: times count from the clock's 0"
    assert told in count_lines(recording)


def test_times_in_milliseconds_are_told(
    changed: Callable[[Callable[[Rows], object]], Path], ground: Floor, recorded: Recording
) -> None:
    def thousandfold(rows: Rows) -> None:
        rows[1:] = [[row[0], str(round(float(row[1]) * 1000.0)), *row[2:]] for row in rows[1:]]

    told = "  220 s usually between two rows of a robot: times must be in seconds"
    recording = recording_of([read_log(changed(thousandfold))], ground, preset("paper"))
    found = [list(count_lines(one)) for one in (recording, recorded)]
    assert told in found[0]
    assert not any("times must be" in line for line in found[1])


def test_a_robot_that_stops_early_is_counted(
    changed: Callable[[Callable[[Rows], object]], Path], ground: Floor
) -> None:
    def stop(rows: Rows) -> None:
        rows[1:] = [row for row in rows[1:] if row[2] != "3" or float(row[1]) < 30.0]

    recording = recording_of([read_log(changed(stop))], ground, preset("paper"))
    assert recording.sessions[0]["told"]["robots_gone"] == 1
    assert "  1 robot last seen more than a minute before the end" in count_lines(recording)


def test_a_robot_that_starts_late_is_counted(
    changed: Callable[[Callable[[Rows], object]], Path], ground: Floor, recorded: Recording
) -> None:
    """It stood at its first place until then, without a word."""

    def start(rows: Rows) -> None:
        rows[1:] = [row for row in rows[1:] if row[2] != "3" or float(row[1]) > 70.0]

    recording = recording_of([read_log(changed(start))], ground, preset("paper"))
    found = [list(count_lines(one)) for one in (recording, recorded)]
    late = "  1 robot first seen more than a minute after another: taken to stand there until then"
    assert [late in lines for lines in found] == [True, False]


def test_markers_that_are_swapped_for_a_second_are_counted(
    changed: Callable[[Callable[[Rows], object]], Path], ground: Floor, recorded: Recording
) -> None:
    def swap(rows: Rows) -> None:
        for row in rows[1:]:
            if row[6] == "None" and 50.0 < float(row[1]) < 51.0:
                row[2:4] = {"1": ["2", "11.0"], "2": ["1", "10.0"]}.get(row[2], row[2:4])

    recording = recording_of([read_log(changed(swap))], ground, preset("paper"))
    found = [one.sessions[0]["told"]["jumps"] for one in (recording, recorded)]
    assert found == [4, 0]  # two robots, there and back


def test_a_robot_whose_marker_is_lost_early_has_old_positions(
    changed: Callable[[Callable[[Rows], object]], Path], ground: Floor
) -> None:
    """Then it has fewer tracked positions than samples, which are a camera's all the same."""

    def lose(rows: Rows) -> None:
        rows[1:] = [row for row in rows[1:] if row[6] != "None" or row[2] != "1" or float(row[1]) < 20.0]

    told = recording_of([read_log(changed(lose))], ground, preset("paper"), any_floor=True).sessions[0][
        "told"
    ]
    assert told["positions_old"] > 10
    assert told["jumps"] == 0


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


def test_a_sample_without_an_energy_leaves_the_path_through_all_others(tmp_path: Path, ground: Floor) -> None:
    """Its row was taken for the only one of a camera: the robot stood there for the whole session."""
    places = [(10.0 * k, 0.1 * k) for k in range(1, 9)]
    rows = [f"1,{time_s},{x_m:.1f},0.5,{'' if time_s == 30.0 else 1.25}," for time_s, x_m in places]
    log = read_plain(tmp_path, "\n".join([PLAIN.format("note").strip(), *rows]))
    recording = recording_of([log], ground, preset("paper"), any_floor=True)
    path = recording.segments.select("start_s", "x_m").rows()
    assert [(time_s, pytest.approx(x_m)) in path for time_s, x_m in places] == [True] * 8
    assert recording.sessions[0]["told"]["positions_old"] == 0


def test_a_stop_begins_no_sooner_than_the_session_or_the_sample_before(tmp_path: Path, ground: Floor) -> None:
    log = read_plain(tmp_path, PLAIN.format("note") + "1,0.2,0.5,0.5,1.25,\n1,0.5,0.5,0.5,1.25,\n")
    recording = recording_of([log], ground, preset("paper"), any_floor=True)
    assert recording.motion["stop_start_s"].to_list() == [0.0, 0.2]


@pytest.mark.parametrize(("last_s", "silent_s"), [(300.0, 0.0), (400.0, 200.0)])
def test_a_silence_is_longer_than_three_usual_steps(
    last_s: float, silent_s: float, tmp_path: Path, ground: Floor
) -> None:
    rows = "".join(f"1,{time_s},0.5,0.5,1.25,\n" for time_s in (50.0, 100.0, 150.0, 200.0, last_s))
    log = read_plain(tmp_path, PLAIN.format("note") + rows)
    recording = recording_of([log], ground, preset("paper"), any_floor=True)
    assert recording.sessions[0]["told"]["silent_s"] == silent_s


def test_a_step_is_a_jump_only_if_it_is_long_and_fast(tmp_path: Path, ground: Floor) -> None:
    """Nine steps of 5 cm at the usual speed, and one of 5 mm in 10 ms."""
    places = [*((float(k), 0.1 + 0.05 * k) for k in range(10)), (9.01, 0.555)]
    rows = "".join(f"1,{time_s},{x_m:.3f},0.5,,\n" for time_s, x_m in places)
    log = read_plain(tmp_path, PLAIN.format("note") + rows + "1,10.0,0.555,0.5,1.25,\n")
    recording = recording_of([log], ground, preset("paper"), any_floor=True)
    assert recording.sessions[0]["told"]["jumps"] == 0


def test_a_gap_in_tracking_is_counted_with_its_length(
    changed: Callable[[Callable[[Rows], object]], Path], ground: Floor
) -> None:
    def hide(rows: Rows) -> None:
        robot = rows[1][2]
        rows[1:] = [
            row
            for row in rows[1:]
            if row[2] != robot or row[6] != "None" or not 100.0 < float(row[1]) < 102.0
        ]

    told = recording_of([read_log(changed(hide))], ground, preset("paper")).sessions[0]["told"]
    assert told["tracking_gaps"] == 1
    assert told["tracking_gap_longest_s"] == pytest.approx(2.0, abs=0.5)


def test_positions_of_another_unit_are_refused(
    changed: Callable[[Callable[[Rows], object]], Path], ground: Floor
) -> None:
    def thousandfold(rows: Rows) -> None:
        rows[1:] = [[*row[:4], str(float(row[4]) * 1000.0), *row[5:]] for row in rows[1:]]

    log = read_log(changed(thousandfold))
    with pytest.raises(
        InputError, match=r"no sample lies on 'ours': their x is .* Positions must be in metres"
    ):
        recording_of([log], ground, preset("paper"))
    recording_of([log], ground, preset("paper"), any_floor=True)


def test_a_text_in_utf_16_is_named(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("robot,time_s\n0,1\n", encoding="utf-16")
    with pytest.raises(InputError, match="or text in UTF-16; give a text log in UTF-8"):
        read_log(tmp_path / "log.csv")


def test_a_robot_that_never_moved_is_counted(
    changed: Callable[[Callable[[Rows], object]], Path], ground: Floor
) -> None:
    def stand(rows: Rows) -> None:
        rows[1:] = [[*row[:4], "0.5", "0.5", *row[6:]] if row[2] == "3" else row for row in rows[1:]]

    recording = recording_of([read_log(changed(stand))], ground, preset("paper"), any_floor=True)
    assert "  1 robot that never moved" in count_lines(recording)


def test_other_robots_are_refused(log: Log) -> None:
    assert in_order(log, [1, 2, 3, 4, 5]).samples.height > 0
    with pytest.raises(InputError, match=r"unknown robot 5, in .* rows; there are 1, 2, 3, 4"):
        in_order(log, [1, 2, 3, 4])


def test_counters_that_wrap_go_on() -> None:
    out, times, odd = unwrapped(np.array([65.0, 65.5, 0.2, 1.0]), 65.536, np.array([0.0, 1.0, 2.0, 3.0]))
    assert out.tolist() == pytest.approx([65.0, 65.5, 65.736, 66.536])
    assert (times, odd.any()) == (1, False)


def test_a_counter_that_runs_ahead_of_time_is_set_null_there() -> None:
    out, _, odd = unwrapped(np.array([1.0, 2.0, 40.0, 41.0]), 65.536, np.array([0.0, 1.0, 2.0, 3.0]))
    assert odd.tolist() == [False, False, True, False]
    assert np.isnan(out[2])
    assert out[3] == 3.0


def test_no_log_at_all(tmp_path: Path) -> None:
    (tmp_path / "some.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match=r"is not in a known log format \(rugbot, webots, camera\)"):
        read_log(tmp_path / "some.csv")
    with pytest.raises(InputError, match="there is no such file"):
        read_log(tmp_path / "none.csv")
    with pytest.raises(InputError, match="--reader: there is no 'rugbut', did you mean 'rugbot'"):
        read_log(tmp_path / "some.csv", "rugbut")
    (tmp_path / "map.toml").write_text('[columns]\nrobot = "a"\n')
    with pytest.raises(InputError, match="does not name the column for time_s"):
        read_log(tmp_path / "some.csv", columns=tmp_path / "map.toml")


PLAIN = "robot,time_s,x_m,y_m,energy,{}\n"
PLAIN_MAP = "[columns]\n" + "".join(
    f'{use} = "{use}"\n' for use in ("robot", "time_s", "x_m", "y_m", "energy")
)


def read_plain(folder: Path, text: str) -> Log:
    (folder / "plain.csv").write_text(text, encoding="utf-8")
    (folder / "map.toml").write_text(PLAIN_MAP, encoding="utf-8")
    return read_log(folder / "plain.csv", columns=folder / "map.toml")


def test_a_counter_wraps_above_0(tmp_path: Path) -> None:
    columns = PLAIN_MAP + 'sent = { name = "sent", wraps_at = 0 }\n'
    (tmp_path / "plain.csv").write_text(PLAIN.format("sent") + "1,2.0,0.5,0.5,1.25,2\n")
    (tmp_path / "map.toml").write_text(columns)
    with pytest.raises(InputError, match=r"columns\.sent, wraps_at: 0 is not above 0"):
        read_log(tmp_path / "plain.csv", columns=tmp_path / "map.toml")


@pytest.mark.parametrize("robots", [2, 1000])
def test_many_robots_send_more_messages_between_two_samples_than_few(robots: int, tmp_path: Path) -> None:
    """A log of 1000 robots was refused: its counts of received messages grew by more than 1000."""
    rows = [PLAIN.format("recv"), *(f"{robot},1.0,0.5,0.5,1.25,0\n" for robot in range(robots))]
    (tmp_path / "plain.csv").write_text("".join([*rows, "0,5.0,0.5,0.5,1.25,1500\n"]))
    (tmp_path / "map.toml").write_text(PLAIN_MAP + 'messages_received = "recv"\n')
    log = read_log(tmp_path / "plain.csv", columns=tmp_path / "map.toml")
    if robots == 1000:
        assert in_order(log).samples.height == 1001
    else:
        with pytest.raises(InputError, match="and then 1500; such a count only grows, by 1,000 at most"):
            in_order(log)


def test_alpha_without_beta_is_refused(tmp_path: Path) -> None:
    """A recording with one of them could be written, but not read again."""
    (tmp_path / "plain.csv").write_text(
        PLAIN.format("alpha,beta") + "1,2.0,0.5,0.5,1.25,2,1\n1,9.0,0.5,0.5,1.2,3,\n"
    )
    (tmp_path / "map.toml").write_text(PLAIN_MAP + 'alpha = "alpha"\n')
    with pytest.raises(InputError, match="names a column for one of alpha and beta"):
        read_log(tmp_path / "plain.csv", columns=tmp_path / "map.toml")
    (tmp_path / "map.toml").write_text(PLAIN_MAP + 'alpha = "alpha"\nbeta = "beta"\n')
    with pytest.raises(InputError, match=r"plain\.csv, row 3: has one of alpha and beta"):
        read_log(tmp_path / "plain.csv", columns=tmp_path / "map.toml")


def test_times_may_count_from_the_first_row(tmp_path: Path) -> None:
    """Logs with seconds since 1970 could be read by no column map: each session begins at another time."""
    (tmp_path / "plain.csv").write_text(
        PLAIN.format("") + "1,1700000003253,0.5,0.5,1.25,\n1,1700000006273,0.5,0.5,1.2,\n"
    )
    text = PLAIN_MAP.replace('"time_s"', '{ name = "time_s", times = 0.001, first = 0.5 }')
    (tmp_path / "map.toml").write_text(text)
    log = read_log(tmp_path / "plain.csv", columns=tmp_path / "map.toml")
    assert log.samples["time_s"].to_list() == [0.5, 3.52]
    (tmp_path / "map.toml").write_text(PLAIN_MAP.replace('"x_m"', '{ name = "x_m", first = 0 }'))
    with pytest.raises(InputError, match="only time_s has first"):
        read_log(tmp_path / "plain.csv", columns=tmp_path / "map.toml")


def test_timestamps_count_from_the_earliest_also_if_it_is_not_the_first() -> None:
    cells, lines = pl.Series(["2026-05-01T10:00:01", "2026-05-01T10:00:00.5"]), pl.Series([2, 3])
    assert seconds_of(cells, lines, "a.csv", "time", missing=("",)).to_list() == [0.5, 0.0]


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


def test_a_column_may_be_named_line(tmp_path: Path) -> None:
    log = read_plain(tmp_path, PLAIN.format("line") + "\n1,2.0,0.5,0.5,1.25,77\n")
    assert log.samples["line"].to_list() == [3]
    assert log.samples["energy"].to_list() == [1.25]


def test_a_log_may_begin_with_an_empty_line(tmp_path: Path) -> None:
    """It was taken for the header: "5 cells, but the header has 0"."""
    log = read_plain(tmp_path, "\n" + PLAIN.format("note") + "1,2.0,0.5,0.5,1.25,a\n")
    assert log.samples["line"].to_list() == [3]


def test_a_log_may_begin_with_comments_and_its_separator(tmp_path: Path) -> None:
    rest = PLAIN.format("note") + "1,2.0,0.5,0.5,1.25,a\n"
    assert read_plain(tmp_path, "sep=,\r\n# made by x, on y\n\n#\n" + rest).samples["line"].to_list() == [6]
    assert read_plain(tmp_path, '"SEP=,"\n' + rest).samples["line"].to_list() == [3]
    with pytest.raises(InputError, match="';' between columns"):
        read_plain(tmp_path, "sep=;\n" + rest.replace(",", ";"))
    with pytest.raises(InputError, match="it has '# robot'"):  # no comment but a header: numbers follow
        read_plain(tmp_path, "# by x\n# " + rest)
    names = PLAIN_MAP.replace('robot = "robot"', 'robot = { name = "#robot", values = { ada = 1 } }')
    (tmp_path / "map.toml").write_text(names)
    (tmp_path / "plain.csv").write_text("#" + rest.replace("\n1,", "\nada,"))  # nor if a map has its name
    assert read_log(tmp_path / "plain.csv", columns=tmp_path / "map.toml").samples["robot"].to_list() == [1]


def test_a_header_whose_repeated_names_cannot_be_told_apart_is_refused(tmp_path: Path) -> None:
    """The second of two columns "note" is named "note (7)", after its number."""
    text = PLAIN.format("note,note") + "1,2.0,0.5,0.5,1.25,a,b\n"
    assert read_plain(tmp_path, text).samples.height == 1
    with pytest.raises(InputError, match=r"has two columns 'note \(7\)'; give them different names"):
        read_plain(tmp_path, PLAIN.format("note,note,note (7)") + "1,2.0,0.5,0.5,1.25,a,b,c\n")


def test_line_breaks_in_cells_do_not_shift_the_numbers_of_lines(tmp_path: Path) -> None:
    text = PLAIN.format('"a\nnote"') + '1,2.0,0.5,0.5,1.25,"two\nlines"\n\n1,4.0,0.5,0.5,1.25,one\n'
    assert read_plain(tmp_path, text).samples["line"].to_list() == [3, 6]
    with pytest.raises(InputError, match=r"row 7: 'late' in column 'time_s' is not a number"):
        read_plain(tmp_path, text + '1,late,0.5,0.5,1.25,"one\nmore"\n')
    with pytest.raises(InputError, match=r"row 7: 1 cell, but the header has 6"):
        read_plain(tmp_path, text + "1\n")


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


def test_the_contrast_of_a_floor_is_of_logarithms() -> None:
    floor = Floor.filling([[0, 1, 1], [0, 0, 1]])
    row, column = np.divmod(np.arange(6), 3)
    places = {"x_m": (column + 0.5) / 3, "y_m": 1 - (row + 0.5) / 2}
    best = floor_fits(floor, pl.DataFrame({**places, "energy": np.exp(2.0 * floor.tiles.ravel())}))[0]
    assert (best.orientation, best.contrast) == ("as it is", pytest.approx(2.0))


def test_a_floor_that_does_not_fit_is_taken_on_request(log: Log, ground: Floor) -> None:
    wrong = Floor.filling(turned(ground.tiles, "turned by 180 degrees"))
    recording_of([log], wrong, preset("paper"), any_floor=True)


def test_energies_that_fit_no_floor_are_told_of(log: Log, ground: Floor) -> None:
    samples = in_order(log).samples
    mixed = samples.with_columns(energy=pl.col("energy").shuffle(seed=3))
    assert check_floor(ground, mixed).startswith("The floor may be wrong: of random floors")
    assert check_floor(ground, samples).startswith("The floor fits")


CORRECTIONS = {  # where each moves the tile in row r and column c of 5 x 5
    "Turned by 90 degrees anticlockwise": lambda r, c: (4 - c, r),
    "Turned by 180 degrees": lambda r, c: (4 - r, 4 - c),
    "Turned by 90 degrees clockwise": lambda r, c: (c, 4 - r),
    "Mirrored left to right": lambda r, c: (r, 4 - c),
    "Mirrored top to bottom": lambda r, c: (4 - r, c),
    "Mirrored along the diagonal from the top left": lambda r, c: (c, r),
    "Mirrored along the diagonal from the top right": lambda r, c: (4 - c, 4 - r),
}


@pytest.mark.parametrize("words", CORRECTIONS)
def test_the_correction_of_a_floor_is_the_one_that_is_named(
    words: str, ground: Floor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(floor_fit, "FLOORS", 2000)
    given = [(r, c) for r in range(5) for c in range(5)]
    truth = [CORRECTIONS[words](r, c) for r, c in given]
    samples = pl.DataFrame(
        {
            "x_m": [0.1 + 0.2 * column for _, column in truth],
            "y_m": [0.9 - 0.2 * row for row, _ in truth],
            "energy": [1.0 + ground.tiles[tile] + 0.01 * k for k, tile in enumerate(given)],
        }
    )
    with pytest.raises(InputError, match=f"\\. {words} it fits"):
        check_floor(ground, samples)


def test_what_was_read_is_counted_in_words() -> None:
    """Every count that is made, once and often; what was never found is not said."""
    once = dict.fromkeys(COUNTED, 1.0)
    often = {**dict.fromkeys(COUNTED, 2000.0), "tracking_gap_longest_s": 4.694123, "off_the_floor": 0}
    sessions = [
        {"log": "a.csv", "reader": "rugbot", "told": once},
        {"log": "b.csv", "reader": "csv", "told": often},
    ]
    lines = list(count_lines(cast("Recording", SimpleNamespace(sessions=sessions))))
    assert lines[0] == "session 1: a.csv (rugbot)"
    assert lines[1:5] == [
        "  1 row read",
        "  1 s before the first row, of which nothing is known: times count from the clock's 0",
        "  1 repeated row: removed",
        "  1 late row (by up to a second): sorted in",
    ]
    assert lines[5:7] == ["  1 sample", "  1 sample without a row, by the count of messages sent"]
    assert lines[22] == "session 2: b.csv (csv)"
    assert lines[23] == "  2,000 rows read"
    assert lines[25] == "  2,000 repeated rows: removed"
    assert "  4.694 s, the longest such gap" in lines
    assert not [line for line in lines[22:] if "off all tiles" in line]
