"""``vibroswarm lab`` and ``calibrate`` at 60 and 80 columns: no lost name, no cut number, no line too wide."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from helpers.table_checks import check_table, lost
from vibroswarm import preset, simulate
from vibroswarm.calibrate.camera import Camera
from vibroswarm.calibrate.cross_validation import Fold, Reading, Score
from vibroswarm.calibrate.fit import Fit, Fitted
from vibroswarm.cli import main, tables
from vibroswarm.cli.calibrate_fit import print_fit, print_folds

LAB = Path(__file__).parents[2] / "examples" / "lab"
LOGS = [str(LAB / f"session-{k}.csv") for k in (1, 2)]
FEW = ["--runs", "2", "--set", "run.t_end_s=60", "--set", "decision.min_observations=5"]
COMMANDS = {
    "lab import": ["lab", "import", *LOGS, "--floor", str(LAB / "floor.txt"), "--out", "again", "--force"],
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
        assert main([*COMMANDS["lab import"][:-2], "kept", "-q"]) == 0
    short = {"run.t_end_s": 60.0, "swarm.robots": 3, "network.name": "loss", "network.loss.share": 0.3}
    simulate(preset("paper").with_values(short), 2, 2).write(folder / "lossy")
    return folder


@pytest.fixture
def laid_out(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Tables and the lines that they became, as commands print them."""
    found: list[Any] = []
    real = tables.layout

    def layout(table: Any, width: int) -> list[str]:
        lines = real(table, width)
        found.append((table, width, lines))
        return lines

    monkeypatch.setattr(tables, "layout", layout)
    return found


def check(found: list[Any], printed: str, columns: int, tables_expected: int) -> None:
    """Check tables at several widths, and all lines at the terminal's."""
    assert len(found) >= tables_expected
    for table, width, lines in list(found):
        assert width == columns
        assert lost(table, lines) == []
        check_table(table)
    paths = ("Saved", "Page:")  # names of files are not broken
    wide = [line for line in printed.splitlines() if len(line) > columns and not line.startswith(paths)]
    assert wide == []


@pytest.mark.slow
@pytest.mark.parametrize("columns", [60, 80])
@pytest.mark.parametrize("name", COMMANDS)
def test_nothing_is_lost_or_too_wide(
    name: str,
    columns: int,
    folder: Path,
    laid_out: list[Any],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", str(columns))
    assert main(COMMANDS[name]) == 0
    check(laid_out, capsys.readouterr().out, columns, name != "lab import")


@pytest.mark.parametrize("columns", [60, 80])
def test_a_fit_and_its_validation_too(
    columns: int, laid_out: list[Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of made-up numbers: to fit takes minutes."""
    names = ("speed factor, mean over robots", "avoidance: blind time after a turn, ms", "misalignment, s.d.")
    figures = tuple(Fitted(name, 1234.5678, 12.3, 1211.1, 1255.5) for name in names)
    changed = {
        "walk.blind_after_turn_ms": 1234.5678,
        "robot.speed_factor_sd": 0.01234,
        "network.name": "bursts",
    }
    predicted = {"share of samples with avoidance longer than 2 s": (0.1234, 0.2, 0.3)}
    camera = Camera.__new__(Camera)
    fit = Fit(preset("paper"), changed, figures, predicted, 120, 3, camera)
    scores = tuple(
        Score(name, 100, 0.9876, 0.9765, 0.9654, 0.0123, 0.0234, 0.0345) for name in ("avoidance", "places")
    )
    readings = (Reading("share of samples with avoidance", 0.25, 0.26, 0.01),)
    monkeypatch.setenv("COLUMNS", str(columns))
    print_fit(fit)
    print_folds([Fold(k, fit, scores, readings, 0.55, 0.66) for k in range(3)])
    check(laid_out, capsys.readouterr().out, columns, 4)
