"""Three kinds of tile by all commands: what holds for two kinds only is refused in words, the rest knows all three."""

from __future__ import annotations

from pathlib import Path

import pytest

from vibroswarm.cli import main
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result

FLOOR = "22202\n20212\n22122\n02221\n22022\n"
THREE = [
    "--set", "sensor.model=confusion", "--set", "sensor.confusion.accuracy=1", "--task", "majority",
    "--set", "decision.min_observations=40",
]  # fmt: skip


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


def test_a_decision_for_kind_2_is_no_undecided_robot_in_a_log(folder: Path) -> None:
    """The log of the study's robots has 2 for undecided, so that decisions of several kinds are not in it."""
    assert set(Result.read(folder / "run").robots["decision"]) == {2}
    recording = Recording.read(folder / "recording")
    assert set(recording.robots["decision"]) == {None}
    assert recording.runs["consensus"].to_list() == [None]
