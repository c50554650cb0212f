"""What studies show: pictures, the report in a browser, detection, trade-off, warnings; as a user meets them."""

from __future__ import annotations

import json
from pathlib import Path

import polars as pl
import pytest

from helpers.commands import json_of, output_of
from vibroswarm.cli import main

pytestmark = pytest.mark.slow

SMALL = ["--set", "run.t_end_s=120", "--set", "decision.min_observations=20", "--robots", "3"]
STUDY = """
name = "Strategies <b>and</b> thresholds"
runs = 24
[scenario]
run = { t_end_s = 120 }
decision = { min_observations = 20 }
swarm = { robots = 3 }
[grid]
"floor.source" = ["random:0.48", "random:0.56"]
"strategy.name" = ["none", "soft"]
"""


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("my studies") / "first one"
    file = folder.with_suffix(".toml")
    file.write_text(STUDY, encoding="utf-8")
    assert main(["evaluate", str(file), "--out", str(folder), "--pictures"]) == 0
    return folder


def test_a_study_keeps_numbers_pictures_and_a_report(swept: Path) -> None:
    there = {path.name for path in swept.iterdir()}
    assert {
        "study.toml",
        "vibroswarm.json",
        "runs",
        "summary.csv",
        "comparisons.csv",
    } <= there
    assert {"pictures", "report.html"} <= there
    captions = pl.read_csv(swept / "pictures" / "captions.csv")
    for name in captions["name"]:
        for suffix in ("svg", "pdf", "png", "csv"):
            assert (swept / "pictures" / f"{name}.{suffix}").stat().st_size > 0
    wanted = {
        "outcomes",
        "decision_time_s",
        "incidence-robots",
        "consensus-box",
        "detection",
    }
    assert wanted | {"front-1", "compared-decision-time-s", "density", "belief"} <= set(captions["name"])


def test_json_holds_all_and_nothing_else_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    out = output_of(capsys, "evaluate", "--runs", "12", "--strategy", "none,soft", "--json", *SMALL)
    about = json.loads(out)
    tables = about["tables"]
    assert [cell["name"] for cell in tables["cells"]] == ["none", "soft"]
    cell = tables["summary"][0]
    assert cell["runs"] == 12
    assert cell["decision_time_s_low"] <= cell["decision_time_s"] <= cell["decision_time_s_high"]
    assert {one["figure"] for one in tables["comparisons"]} >= {"decision_time_s", "right_share"}


@pytest.mark.usefixtures("empty_pictures")
def test_detect_tells_what_is_needed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "how many"
    line = ["detect", "--robots", "2,6", "--fills", "0.2,0.48,0.8", "--runs", "60", "--error", "20%"]
    line += ["--false-alarms", "25%", "--set", "run.t_end_s=300", "--set", "decision.min_observations=30"]
    said = output_of(capsys, *line, "--out", out)
    assert "at most 20 % misses, and at most 25 % false alarms on floors up to 48 %" in " ".join(said.split())
    need = pl.read_csv(out / "needed.csv")
    assert need["fill_ratio"].to_list() == [0.2, 0.2, 0.48, 0.48, 0.8, 0.8]
    assert need["robots"].to_list() == [2, 6, 2, 6, 2, 6]
    assert need["false_alarm"].null_count() == 2  # above the boundary there are none
    pairs = pl.read_csv(out / "pairs.csv")
    assert pairs.select("fill_ratio", "fill_ratio_below", "robots").unique().height == pairs.height == 4
    easy = need.filter((pl.col("fill_ratio") == 0.2) & (pl.col("robots") == 6))
    assert easy["needed_s"][0] < 300
    assert easy["missed_high"][0] < 0.2
    assert need.filter(pl.col("fill_ratio") == 0.48)["needed_s"].null_count() == 2
    assert not (out / "pictures").exists()
    found = pairs.filter((pl.col("robots") == 6) & pl.col("time_s").is_not_null()).sort("fill_ratio")
    fill, time_s = found.select("fill_ratio", "time_s").row(0)
    sentence = (
        f"6 robots with strategy none find {100 * fill:g} % vibrating within {time_s:.0f} s, with at most"
    )
    assert sentence in " ".join(said.split())
    page = (out / "report.html").read_text(encoding="utf-8").replace("\xa0", " ")
    assert sentence in page
    assert page.count("<figure") == 3
    output_of(capsys, *line, "--out", out, "--pictures")
    drawn = {"captions.csv", "detection-2-robots.svg", "detection-robots.pdf"}
    assert drawn <= {path.name for path in (out / "pictures").iterdir()}
    tables = json_of(capsys, *line, "--json")["tables"]
    assert len(tables["needed"]) == 6
    assert tables["pairs"] == pairs.to_dicts()
    assert len(tables["found"]) == 2
    assert len(tables["detection"]) == pl.read_csv(out / "detection.csv").height


def test_until_a_precision_tells_the_interval_that_was_looked_at(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["evaluate", "--until", "40%", "--json", "--no-pictures", *SMALL]
    tables = json_of(capsys, *line)["tables"]
    (cell,), (precision,) = tables["summary"], tables["precision"]
    assert cell["runs"] == precision["runs"] == 100
    assert precision["reached"]
    assert precision["level"] == pytest.approx(1 - 0.05 * 6 / 3.14159**2, abs=1e-5)
    assert cell["level"] == 0.95  # of all other figures
    half = (cell["decision_time_s_high"] - cell["decision_time_s_low"]) / 2
    assert half <= 0.4 * cell["decision_time_s"]
