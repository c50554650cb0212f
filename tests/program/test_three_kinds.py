"""Three kinds of tile by all commands: what holds for two kinds only is refused in words, the rest knows all three."""

from __future__ import annotations

from pathlib import Path

import pytest

from helpers.commands import output_of
from vibroswarm.cli import main
from vibroswarm.documents.run import result_document
from vibroswarm.recordings.recording import Recording
from vibroswarm.recordings.replay import replay_recording
from vibroswarm.result import Result

FLOOR = "22202\n20212\n22122\n02221\n22022\n"
THREE = [
    "--set", "sensor.model=confusion", "--set", "sensor.confusion.accuracy=1", "--task", "majority",
    "--set", "decision.min_observations=40",
]  # fmt: skip
OF_TWO = "other kinds than 0 (still) and 1 (vibrating)"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run, its log, and the recording that is imported from it."""
    folder = tmp_path_factory.mktemp("three")
    (folder / "floor.txt").write_text(FLOOR)
    asked = [*THREE, "--floor", str(folder / "floor.txt")]
    dirichlet = ["--strategy", "dirichlet", "--set", "run.t_end_s=200"]
    assert main(["run", *asked, *dirichlet, "--out", str(folder / "run")]) == 0
    assert main(["lab", "export", str(folder / "run"), "--out", str(folder / "log.csv")]) == 0
    log = ["lab", "import", str(folder / "log.csv"), "--out", str(folder / "recording")]
    assert main([*log, *asked, "--strategy", "dirichlet"]) == 0
    return folder


def test_a_replayed_recording_reads_all_kinds(folder: Path) -> None:
    recording = Recording.read(folder / "recording")
    replayed = replay_recording(
        recording, recording.scenario.with_values({"strategy.name": "places"}), draws=2
    )
    assert set(replayed.robots["decision"]) == {2}  # as bits, kinds 1 and 2 would be one
    at_first = Result.read(folder / "run")
    assert set(at_first.robots["decision"]) == {2}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("lab threshold recording", OF_TWO),
        ("calibrate figures recording", OF_TWO),
        ("inspect recording", OF_TWO),
        ("lab replay recording --strategy none", "'none' reads 0 or 1"),
        ("verify run", ""),
        ("inspect run", ""),
    ],
)
def test_what_is_for_two_kinds_says_so(
    arguments: str,
    words: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    assert (main(arguments.split()) != 0) == bool(words)
    assert words in capsys.readouterr().err


def test_detection_asks_for_the_task_first(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["detect", *THREE, "--floor", "random:0.4,0.36,0.24", "--strategy", "dirichlet"]) != 0
    assert "must be fill_ratio to detect, not 'majority'" in capsys.readouterr().err


@pytest.mark.usefixtures("one_picture")
def test_tables_name_the_kind_that_is_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = [
        *THREE,
        "--floor",
        "random:0.4,0.36,0.24",
        "--strategy",
        "dirichlet,places",
        "--set",
        "run.t_end_s=60",
    ]
    assert main(["evaluate", *asked, "--runs", "4", "--no-confirm", "--out", str(tmp_path / "study")]) == 0
    page = (tmp_path / "study" / "report.html").read_text(encoding="utf-8")
    assert "read as kind 1" in page
    assert "read as vibrating" not in page
    asked[asked.index("--strategy") + 1] = "places"
    assert "share of ones" not in output_of(capsys, "run", *asked)


def test_a_decision_for_kind_2_is_no_undecided_robot_in_a_log(folder: Path) -> None:
    """The log of the study's robots has 2 for undecided, so that decisions of several kinds are not in it."""
    assert set(Result.read(folder / "run").robots["decision"]) == {2}
    recording = Recording.read(folder / "recording")
    assert set(recording.robots["decision"]) == {None}
    assert recording.runs["consensus"].to_list() == [None]


def test_an_estimate_that_the_task_does_not_ask_for_is_named(folder: Path) -> None:
    """Asked for the most common kind, robots have an estimate all the same: the share of kind 1."""
    result = Result.read(folder / "run")
    robots = result_document(result).tables["robots"]
    assert robots.columns["posterior"].title == "share of kind 1 (95 %)"
    ones = (result.observations["observation"] == 1).mean()
    assert robots.frame["posterior"].mean() == pytest.approx(ones, abs=0.02)
