"""``vibroswarm lab`` and ``calibrate`` at 60 columns: no line is too wide. Of other commands: ``test_cli_show.py``."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from helpers.commands import output_of
from vibroswarm import preset, simulate
from vibroswarm.calibrate.camera import RIGHT
from vibroswarm.calibrate.cross_validation import Fold, Reading, Score
from vibroswarm.calibrate.fit import Fit, Fitted
from vibroswarm.cli import main
from vibroswarm.documents.fit import fit_document
from vibroswarm.show.terminal import print_document

LAB = Path(__file__).parents[2] / "examples" / "lab"
LOGS = [str(LAB / f"session-{k}.csv") for k in (1, 2)]
FEW = ["--runs", "2", "--set", "run.t_end_s=60", "--set", "decision.min_observations=5"]
COMMANDS = {
    "lab replay": ["lab", "replay", "kept", "--strategy", "none,positive,soft", "--draws", "3"],
    "lab threshold": ["lab", "threshold", "kept"],
    "calibrate figures": ["calibrate", "figures", "kept", "lossy"],
    "calibrate compare": ["calibrate", "compare", "kept", "kept"],
    "calibrate bursts": ["calibrate", "bursts", "lossy"],
    "calibrate effect": ["calibrate", "effect", "paper", "calibrated", *FEW],
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lab")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(["lab", "import", *LOGS, "--floor", str(LAB / "floor.txt"), "--out", "kept", "-q"]) == 0
    short = {"run.t_end_s": 60.0, "swarm.robots": 3, "network.name": "loss", "network.loss.share": 0.3}
    simulate(preset("paper").with_values(short), 2, 2).write(folder / "lossy")
    return folder


def too_wide(printed: str) -> list[str]:
    """Return the lines that are wider than the terminal; names of files are not broken."""
    paths = ("Saved", "Page:")
    return [line for line in printed.splitlines() if len(line) > 60 and not line.startswith(paths)]


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_no_line_is_too_wide(
    name: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In a terminal of 60 columns; at others, too: ``unit/test_show_terminal.py``."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", "60")
    printed = output_of(capsys, *COMMANDS[name])
    assert printed
    assert too_wide(printed) == []


def test_a_fit_and_its_validation_too() -> None:
    """Of made-up numbers: to fit takes minutes."""
    names = ("speed factor, mean over robots", "avoidance: blind time after a turn, ms", "misalignment, s.d.")
    figures = tuple(Fitted(name, 1234.5678, 12.3, 1211.1, 1255.5) for name in names)
    changed = {
        "walk.blind_after_turn_ms": 1234.5678,
        "robot.speed_factor_sd": 0.01234,
        "network.name": "bursts",
    }
    predicted = {"share of samples with avoidance longer than 2 s": (0.1234, 0.2, 0.3)}
    fit = Fit(preset("paper"), changed, figures, predicted, 120, 3, RIGHT)
    scores = tuple(
        Score(name, 100, 0.9876, 0.9765, 0.9654, 0.0123, 0.0234, 0.0345) for name in ("avoidance", "places")
    )
    readings = (Reading("share of samples with avoidance", 0.25, 0.26, 0.01),)
    document = fit_document(fit, [Fold(k, fit, scores, readings, 0.55, 0.66) for k in range(3)])
    printed = io.StringIO()
    print_document(document, printed, 60)
    assert too_wide(printed.getvalue()) == []
    words = " ".join(printed.getvalue().split())
    assert "[1211.1, 1255.5]" in words
    assert 'network.name = "bursts"' in words
    assert "Outside the range of 95 % of the sessions simulated with the fit: share of samples" in words
    assert "tells 55.0 % of the stretches of 20 samples" in words
    assert words.count("-1.0") == 3
