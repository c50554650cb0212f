"""``vibroswarm inspect``: a file, and a plan."""

from __future__ import annotations

from pathlib import Path

import pytest

from helpers.commands import json_of, output_of
from helpers.documents import ROOT

PLATE, LAWS = (ROOT / "examples" / "inspection" / name for name in ("plate.csv", "reference.csv"))


def test_a_plate_is_inspected_and_saved(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    asked = (
        PLATE,
        "--laws",
        LAWS,
        "--size",
        "1x1",
        "--tiles",
        "5x5",
        "--contrasts",
        "1",
        "--replicates",
        "99",
    )
    found = json_of(capsys, "inspect", *asked)
    assert found["answer"][0].startswith("DAMAGE: 2 patches")
    assert [round(patch["x_m"], 1) for patch in found["tables"]["patches"]] == [0.7, 0.3]
    assert found["tables"]["map"][1]["3"] == 100
    text = output_of(capsys, "inspect", *asked, "--out", tmp_path / "plate")
    assert "2 of 25 tiles vibrate" in text
    assert {"report.html", "samples.csv", "maps.csv", "checks.csv"} <= {
        path.name for path in (tmp_path / "plate").iterdir()
    }


@pytest.mark.slow
def test_a_plan_is_made(capsys: pytest.CaptureFixture[str]) -> None:
    found = json_of(capsys, "inspect", "--plan", "5", "--minutes", "10", "--runs", "4", "--plates", "40")
    assert found["tables"]["plan"][0]["robots"] == 5
    assert 0.03 < found["tables"]["plan"][0]["a90_m"] < 0.3
