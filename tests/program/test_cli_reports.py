"""What studies show: pictures, the report in a browser, detection, trade-off, warnings; as a user meets them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import polars as pl
import pytest

from helpers.browser import Tabs
from helpers.commands import json_of, output_of, refusal_of, remarks_of, words_of
from vibroswarm.cli import main
from vibroswarm.documents.study_figures import time_figures
from vibroswarm.study.evaluation import evaluate
from vibroswarm.study.run import run
from vibroswarm.study.spec import Study
from vibroswarm.study.summary import outcome_of

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
        "shards",
        "summary.csv",
        "comparisons.csv",
        "references.csv",
    } <= there
    assert {"pictures", "report.html", "second-block"} <= there
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


def test_an_unfinished_repetition_is_resumed_with_its_study(
    swept: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By itself, it would be repeated on further seeds."""
    folder = tmp_path / "own"
    shutil.copytree(swept, folder)
    next(folder.glob("second-block/shards/*.json")).unlink()
    shown = output_of(capsys, "show", str(folder / "second-block"))
    assert shown.splitlines()[-1] == f"To resume: vibroswarm evaluate {folder}/study.toml --out {folder}"


def test_pictures_show_the_numbers_of_the_summary(swept: Path) -> None:
    summary = pl.read_csv(swept / "summary.csv")
    drawn = pl.read_csv(swept / "pictures" / "decision_time_s.csv")
    assert sorted(drawn["estimate"]) == pytest.approx(sorted(summary["decision_time_s"]))
    outcomes = pl.read_csv(swept / "pictures" / "outcomes.csv")
    assert outcomes["right"].to_list() == pytest.approx(summary["swarm_right"].to_list())
    assert outcomes["runs"].to_list() == [24] * 4


@pytest.mark.parametrize(("most", "said"), [(6, ""), (2, " (drawn: 2 of 3 values)")])
def test_decisions_over_time_have_a_picture_for_each_floor_where_one_would_be_crowded(
    most: int, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vibroswarm.documents.study_figures.MOST_PANELS", most)
    more = Study.from_toml(
        STUDY.replace("runs = 24", "runs = 2").replace('["random', '["random:0.44", "random')
    )
    titles = {figure.name: figure.title for figure in time_figures(outcome_of(run(more)))}
    assert {name for name in titles if name.startswith("incidence-")} == {
        f"incidence-{unit}-{number}" for unit in ("robots", "swarms") for number in range(1, min(most, 3) + 1)
    }
    assert titles["incidence-robots-1"] == f"Decisions of robots over time: fill ratio 0.44{said}"


FEW = ["evaluate", "--runs", "4", "--no-confirm", *SMALL]


@pytest.mark.usefixtures("one_picture", "empty_pictures")
def test_pictures_are_files_on_request_and_in_the_report_anyway(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = output_of(capsys, *FEW, "--out", tmp_path / "a")
    assert "report.html, study.toml, tables (CSV, Parquet), " in " ".join(out.split())
    assert not (tmp_path / "a" / "pictures").exists()
    page = (tmp_path / "a" / "report.html").read_text(encoding="utf-8")
    assert page.count("<svg") == 2  # the mark of the page and the only picture here
    out = output_of(capsys, *FEW, "--out", tmp_path / "a", "--pictures")
    assert "pictures/, " in " ".join(out.split())
    outcomes = tmp_path / "a" / "pictures" / "outcomes.csv"
    assert pl.read_csv(outcomes)["runs"].unique().to_list() == [4]
    # Pictures that exist do not stay behind when the study grows.
    assert main([*FEW[:2], "6", *FEW[3:], "--out", str(tmp_path / "a")]) == 0
    assert pl.read_csv(outcomes)["runs"].unique().to_list() == [6]
    # Without new pictures, a page and pictures of the same numbers stay, and those of others do not.
    for runs, stays in (("6", True), ("8", False)):
        assert main([*FEW[:2], runs, *FEW[3:], "--out", str(tmp_path / "a"), "--no-pictures"]) == 0
        for name in ("report.html", "pictures"):
            assert (tmp_path / "a" / name).exists() is stays, name


@pytest.mark.usefixtures("one_picture", "empty_pictures")
def test_pictures_of_older_numbers_do_not_stay_beside_a_page_made_in_python(tmp_path: Path) -> None:
    assert main([*FEW, "--out", str(tmp_path / "a"), "--pictures"]) == 0
    study = Study.read(tmp_path / "a" / "study.toml")
    for runs, stays in ((4, True), (6, False)):
        evaluate(study.with_runs(runs), tmp_path / "a", confirm=False)
        assert (tmp_path / "a" / "report.html").is_file()
        assert (tmp_path / "a" / "pictures").exists() is stays


def test_references_stand_beside_every_strategy(swept: Path) -> None:
    table = pl.read_csv(swept / "references.csv")
    assert table.height == 4
    assert (table["known_time_s"] <= 120).all()
    assert (table["strategy_time_s"] <= 120).all()
    assert table["packet_loss"].to_list() == [0.0] * 4
    # What could be known does not depend on what is said, but on the floor.
    assert table["known_time_s"][0] == table["known_time_s"][1] != table["known_time_s"][2]


def test_the_report_in_a_browser(swept: Path, tabs: Tabs) -> None:
    page = tabs.open((swept / "report.html").as_uri(), viewport={"width": 375, "height": 800})
    assert page.title() == "Strategies <b>and</b> thresholds"
    assert page.locator("h1 b").count() == 0
    pictures = page.locator("figure svg")
    assert pictures.count() >= 15
    assert all((pictures.nth(k).bounding_box() or {}).get("height", 0) > 40 for k in range(pictures.count()))
    assert page.evaluate("document.documentElement.scrollWidth") <= 375
    text = page.inner_text("body")
    for words in (
        "Can it be decided at all",
        "Compared run by run",
        "soft - none (random:0.48)",
        "second block",
    ):
        assert words in text
    assert tabs.emptied() == []


def test_a_floor_on_the_wrong_side_is_warned_of(capsys: pytest.CaptureFixture[str]) -> None:
    line = ["evaluate", "--runs", "4", "--no-pictures", *SMALL, "--set", "sensor.rms_threshold=1.55"]
    out = output_of(capsys, *line, "--floor", "random:0.52")
    assert "Warning: floor random:0.52, threshold 1.55: " in " ".join(out.split())
    out = output_of(capsys, *line[:-2], "--floor", "random:0.52")  # the negative control: 1.33 is right
    assert "Warning" not in out


def test_json_holds_all_and_nothing_else_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    out = output_of(capsys, "evaluate", "--runs", "12", "--strategy", "none,soft", "--json", *SMALL)
    about = json.loads(out)
    tables = about["tables"]
    assert [cell["name"] for cell in tables["cells"]] == ["none", "soft"]
    cell = tables["summary"][0]
    assert cell["runs"] == 12
    assert cell["decision_time_s_low"] <= cell["decision_time_s"] <= cell["decision_time_s_high"]
    assert {one["figure"] for one in tables["comparisons"]} >= {"decision_time_s", "right_share"}
    assert about["made_by"]["second block"].startswith("seed ")
    assert not about["made_by"]["second block"].startswith(f"seed {about['made_by']['seed']},")


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


def test_detect_warns_of_what_nobody_can_tell(capsys: pytest.CaptureFixture[str]) -> None:
    line = ["detect", "--fills", "0.01,0.1", "--tiles", "10x10", "--robots", "2", "--runs", "2"]
    line += ["--set", "run.t_end_s=20", "--set", "decision.decision_boundary=0.03"]
    told = words_of(capsys, *line, "--boundary-of", "readings")
    assert (
        "Warning: fill ratio 0.01: 15.1 % of the samples read as vibrating, but less than 3.0 % vibrates"
        in told
    )
    assert "Warning: fill ratio 0.1" not in told
    # robots that allow for their errors can, and so can those that weigh each reading by error rates
    assert json_of(capsys, *line, "--json")["warnings"] == []
    places = ["--boundary-of", "readings", "--strategy", "places"]
    assert json_of(capsys, *line, *places, "--json")["warnings"] == []
    mistaken = ["--set", "decision.assumed_false_positive=0.3"]
    assert "wrong side" in json_of(capsys, *line, *mistaken, "--json")["warnings"][0]


def test_detect_adds_floors_below_the_boundary_and_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    line = ["detect", "--tiles", "10x10", "--robots", "2", "--runs", "2", "--set", "run.t_end_s=20"]
    assert "Fill ratios added to count false alarms: 0 %, 1 % and 2 %." in words_of(
        capsys, *line, "--fills", "0.1", "--set", "decision.decision_boundary=0.03"
    )
    fills = {row["fill_ratio"] for row in json_of(capsys, *line, "--json")["tables"]["needed"]}
    assert min(fills) < 0.5 < max(fills)


def test_detect_says_that_a_floor_is_not_the_one_that_is_given(capsys: pytest.CaptureFixture[str]) -> None:
    line = ["detect", "--robots", "2", "--runs", "2", "--set", "run.t_end_s=20", "--fills", "0.4,0.6", "-q"]
    assert "Warning: --floor: of it only the number of tiles is used" in remarks_of(
        capsys, *line, "--floor", "diagonal:0.46"
    )
    assert "--floor" not in remarks_of(capsys, *line)


def test_detect_needs_no_floor_of_the_preset_on_other_tiles(capsys: pytest.CaptureFixture[str]) -> None:
    """48 % of 16 tiles, the share of the preset, are no whole number of tiles; no run has this share."""
    line = [
        "detect",
        "--robots",
        "2",
        "--runs",
        "2",
        "--set",
        "run.t_end_s=20",
        "--fills",
        "0.25,0.75",
        "--json",
    ]
    found = json_of(capsys, *line, "--tiles", "4x4")["tables"]["needed"]
    assert [row["fill_ratio"] for row in found] == [0.25, 0.75]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("detect --fills 2", "--fills: 2 is not from 0 to 1"),
        (
            "detect --fills 0.461 --runs 2",
            "error: --fills: 'random:0.461': 0.461 of 5 x 5 tiles is 11.525 tiles",
        ),
        ("detect --strategy soft --runs 2", "'soft' is neutral at a boundary of 0.5 only"),
        (
            "detect --strategy soft --runs 2",
            'set decision.boundary_of = "readings", or choose another strategy',
        ),
        (
            "detect --strategy soft --runs 2 --more-than 3% --tiles 10x10",
            "0.1651 of the readings; choose another",
        ),
        (
            "detect --boundary-of readings --set decision.boundary_of=tiles",
            "--boundary-of: is also set by --set",
        ),
        ("detect --false-alarms 2 --runs 2", "--false-alarms: '2' is not a percentage"),
        ("detect --error 5", "--error: '5' is not a percentage above 0% and below 100%; give one such as 2%"),
        ("detect --error 100%", "--error: '100%' is not a percentage above 0% and below 100%"),
        ("detect --robots x", "--robots: 'x' is not a whole number"),
        ("evaluate tradeoff --thresholds 1.2 --runs 3", "decision.credible_threshold: 1.2 is wrong"),
        ("evaluate tradeoff --observations a", "--observations: 'a' is not a whole number"),
        ("evaluate tradeoff --thresholds x", "--thresholds: 'x' is not a number"),
        ("evaluate tradeoff --runs 0", "runs: 0 is wrong; give a whole number from 1"),
        ("evaluate --pictures", "--pictures: needs --out DIR, where the pictures are saved"),
        ("evaluate --pictures --no-pictures", "conflicts with --pictures"),
        ("evaluate --style poster", "--style: there is no 'poster' (choices: column, page, slide)"),
        ("evaluate --vary strategy.soft.eta", "is not of the form section.field=value,value"),
        (
            "evaluate --vary network.loss.share=0,0.1",
            "has no effect: network.name is 'ideal'; set it to 'loss'",
        ),
        (
            "evaluate --strategy none,positive --vary strategy.soft.eta=1,2",
            "has no effect: strategy.name is 'none' and 'positive'; set it to 'soft', or leave this out",
        ),
        (
            "evaluate --strategy none,positive --set strategy.soft.eta=1",
            "set it to 'soft', or leave this out",
        ),
        (
            "run --set network.loss.share=0.1",
            "--set network.loss.share: has no effect: network.name is 'ideal'",
        ),
        (
            "run --set faults.false_positive_shift=0.1 --set faults.sensor_from_s=60",
            "--set faults.false_positive_shift: has no effect without faults.biased; set it too",
        ),
        (
            "run --set faults.biased=0.2 --set faults.misread_shift=0.1 --set faults.opposite_from_s=60",
            "--set faults.opposite_from_s: has no effect without faults.opposite",
        ),
        ("evaluate --vary odometry.level=good,poor", "--vary odometry.level: has no effect on robots that"),
        ("detect --set task.share.kind=0", "--set task.share.kind: has no effect"),
        ("league --vary none:strategy.soft.eta=1,2", "--vary strategy.soft.eta: has no effect"),
        (
            "league --strategy none --set faults.sensor_from_s=9 --set strategy.soft.eta=1",
            "--set strategy.soft.eta: has no effect",
        ),
    ],
)
def test_bad_input_is_said(line: str, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(line.split()) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert words in said.err
    assert "Traceback" not in said.err


@pytest.mark.usefixtures("empty_pictures")
def test_tradeoff_tells_the_front(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "trade"
    line = [
        "evaluate",
        "tradeoff",
        "--runs",
        "30",
        "--thresholds",
        "0.8,0.95",
        "--observations",
        "0,20,40",
        "--out",
        out,
        *SMALL,
    ]
    said = output_of(capsys, *line)
    assert "6 settings of p_c and O_c, replayed on the same 30 runs" in " ".join(said.split())
    table = pl.read_csv(out / "tradeoff.csv")
    assert table.height == 6
    front = table.filter(pl.col("pareto")).sort("decision_time_s")
    assert front["error"].is_sorted(descending=True)
    assert (out / "scenario.toml").is_file()
    assert not (out / "pictures").exists()
    fastest, surest = front.row(0, named=True), front.row(-1, named=True)
    page = (out / "report.html").read_text(encoding="utf-8").replace("\xa0", " ")
    for text in (" ".join(said.split()), page):
        for word, row in (("Fastest", fastest), ("Least often wrong", surest)):
            setting = f"p_c {row['credible_threshold']:g}, O_c {row['min_observations']}"
            assert f"{word}: {setting}, {row['decision_time_s']:.0f} s [" in text
        assert f"{100 * surest['error']:.1f} % [" in text
    assert output_of(capsys, *line) == said, "the same work is done again"
    assert output_of(capsys, "show", out) in said
    assert page.count("<figure") == 1
    output_of(capsys, *line, "--no-pictures")
    assert "<figure" not in (out / "report.html").read_text(encoding="utf-8")
    output_of(capsys, *line, "--pictures")
    assert {"front.svg", "front.csv"} <= {path.name for path in (out / "pictures").iterdir()}
    output_of(capsys, *line)
    assert (out / "pictures" / "front.svg").is_file(), "pictures that were requested before are drawn again"
    refusal = refusal_of(capsys, *line, "--seed", "2")
    assert "exists already" in refusal
    assert "give another --out, or add --force" in refusal
    output_of(capsys, *line, "--seed", "2", "--force")
    assert not pl.read_csv(out / "tradeoff.csv").equals(table), "other runs"


def test_a_tradeoff_of_a_single_run_has_a_time_without_limits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "trade"
    line = ["evaluate", "tradeoff", "--runs", "1", "--thresholds", "0.8", "--observations", "0", *SMALL]
    said = output_of(capsys, *line, "--out", out)
    (row,) = pl.read_csv(out / "tradeoff.csv").iter_rows(named=True)
    assert row["decision_time_s_low"] is None
    said = " ".join(said.split())
    assert "Fastest and least often wrong: p_c 0.8, O_c 0, " in said
    assert f"0.8 0 {row['decision_time_s']:.0f} {100 * row['error']:.1f} [" in said


def test_a_tradeoff_without_right_answers_has_no_front(capsys: pytest.CaptureFixture[str]) -> None:
    line = ["evaluate", "tradeoff", "--runs", "2", "--thresholds", "0.8", "--observations", "0", *SMALL]
    said = output_of(capsys, *line, "--task", "mean")
    assert said.startswith("No decision is right in these runs")
    assert "The front" not in said
    assert "The front" in output_of(capsys, *line)
    boundary = words_of(capsys, *line, "--floor", "random:0.52", "--tiles", "5x5")
    assert "Warning: " not in boundary
    boundary = words_of(capsys, *line, "--floor", "random:0.5", "--tiles", "4x4")
    assert "Warning: The fill ratio is the boundary itself, 50.0 %: neither decision is right." in boundary


def test_until_a_precision_tells_the_interval_that_was_looked_at(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["evaluate", "--until", "40%", "--json", "--no-confirm", "--no-pictures", *SMALL]
    tables = json_of(capsys, *line)["tables"]
    (cell,), (precision,) = tables["summary"], tables["precision"]
    assert cell["runs"] == precision["runs"] == 100
    assert precision["reached"]
    assert precision["level"] == pytest.approx(1 - 0.05 * 6 / 3.14159**2, abs=1e-5)
    assert cell["level"] == 0.95  # of all other figures
    half = (cell["decision_time_s_high"] - cell["decision_time_s_low"]) / 2
    assert half <= 0.4 * cell["decision_time_s"]


def test_a_precision_that_is_not_reached_is_warned_of(capsys: pytest.CaptureFixture[str]) -> None:
    line = ["evaluate", "--until", "0.5%", "--max-runs", "150", "--no-confirm", "--no-pictures", *SMALL]
    assert "decision_time_s is not known to 0.5 % after 150 runs" in words_of(capsys, *line)
