"""The reproduction of a few items: what is computed, kept, taken again, and shown."""

from __future__ import annotations

import os
import re
from pathlib import Path

import polars as pl
import pytest

from helpers.commands import json_of, refusal_of, words_of
from vibroswarm.cli import main
from vibroswarm.core.atomic_io import folder_lock
from vibroswarm.documents.reproduction import reproduction_document
from vibroswarm.errors import InputError
from vibroswarm.paper.cells import Cell, differences, options_of
from vibroswarm.paper.claims import CHECKED, VERDICTS, all_claims
from vibroswarm.paper.columns import parameters, scenario_of
from vibroswarm.paper.item import CLAIMS, Settings
from vibroswarm.paper.items import all_items, items_named
from vibroswarm.paper.reproduce import ITEMS, reproduce
from vibroswarm.scenario.scenario import preset

pytestmark = pytest.mark.usefixtures("without_layout")

RUNS = 40
NAMES = ["difficulty", "fill_ratios"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The command's output for two items and two columns."""
    out = tmp_path_factory.mktemp("paper") / "out"
    asked = ["--runs", str(RUNS), "--columns", "paper,text", "--pictures", "--out", str(out)]
    assert main(["reproduce", "--only", *NAMES, *asked]) == 0
    return out


def test_the_command_leaves_report_tables_and_pictures(folder: Path) -> None:
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "<svg" in page
    assert "reproduce --only fill-ratios --runs 40 --seed 1 --columns paper,text" in page
    assert "inconclusive: 40 runs are too few to decide; use " in page
    assert 'src="http' not in page
    captions = pl.read_csv(folder / "pictures" / "captions.csv")
    assert captions.height == 6 + 3
    for name in captions["name"]:
        for kind in ("svg", "pdf", "csv"):
            assert (folder / "pictures" / f"{name}.{kind}").stat().st_size > 100
    cells = pl.read_csv(folder / "tables" / "fill-ratios-cells.csv")
    assert cells.height == 2 * 4 * 3
    shares = pl.col("robots_right") + pl.col("robots_wrong") + pl.col("robots_undecided")
    assert (cells.select(shares).to_series() - 1.0).abs().max() < 1e-9  # type: ignore[operator]


def test_pictures_stand_before_long_tables_and_these_are_folded(folder: Path) -> None:
    page = (folder / "report.html").read_text(encoding="utf-8")
    item = page[page.index("Fill ratios</h2>") :]
    places = [item.index(words) for words in ("<table", "<svg", "All numbers</h3>", "restricted mean time")]
    assert places == sorted(places)
    assert re.search(r"<details>\s*<summary>", item[: places[2]])
    difficulty = page[page.index("Difficulty of the five patterns</h2>") : page.index("Fill ratios</h2>")]
    assert "<details>" not in difficulty  # it has no picture
    cell = r'<td class="(good|bad|open)">(not reproduced|reproduced|inconclusive)( \([^<]*\))?:\n−'
    assert re.search(cell, item)


def test_verdicts_have_their_words_and_reasons_and_checks_a_table(folder: Path) -> None:
    claims = pl.read_csv(folder / "tables" / "claims.csv")
    words = claims.select(pl.col("paper", "text").str.replace(r" \(.*", "")).unpivot()["value"].unique()
    assert set(words.drop_nulls()) <= {*VERDICTS, *CHECKED.values()}
    wrong_side = claims.filter(pl.col("claim") == "soft-belief")
    assert "2 cannot be asked" in wrong_side["text"][0]
    assert "wrong side: 42.2 % of the readings are ones; wrong side: 39.4 %" in wrong_side["text: why not"][0]
    assert "cannot be asked" not in wrong_side["paper"][0]
    values = pl.read_csv(folder / "tables" / "claims-measured.csv")
    why = values.filter(pl.col("why").is_not_null())
    assert set(why["column"]) == {"text"}
    assert why["why"].str.contains("wrong side").all()
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "why not" in page
    assert "Checks, which do not count as verdicts" not in page  # neither item has one


def test_every_number_of_the_page_is_in_a_table(folder: Path) -> None:
    """Cells of the page's tables hold values of the kept tables, digit by digit."""
    page = (folder / "report.html").read_text(encoding="utf-8")
    shown = {float(value) for value in re.findall(r'data-value="([^"]+)"', page)}
    known: set[float] = set()
    for path in (folder / "tables").glob("*.csv"):
        frame = pl.read_csv(path, infer_schema_length=None)
        for name in frame.columns:
            if frame.schema[name].is_numeric():
                known |= set(frame[name].drop_nulls().cast(pl.Float64).to_list())
    assert len(shown) > 100
    assert not shown - known


def test_one_cell_alone_gives_the_same_numbers(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cells = pl.read_csv(folder / "tables" / "fill-ratios-cells.csv")
    row = cells.filter((pl.col("column") == "text") & (pl.col("strategy") == "soft")).row(1, named=True)
    words = row["command"].split()[1:]
    (told,) = json_of(capsys, *words, "--json")["tables"]["summary"]
    assert told["decision_time_s"] == row["decision_time_s"]
    assert told["belief_in_truth_low"] == row["belief_in_truth_low"]


def test_a_second_run_takes_what_is_there(folder: Path) -> None:
    settings = Settings(runs=RUNS, columns=("paper", "text"))
    told: list[str] = []
    made = reproduce(settings, folder, items_named(NAMES), lambda what, share: told.append(what))
    assert told == []
    assert made.results is None
    assert {one.claim.item for one in made.decided} == {"difficulty", "fill-ratios"}


def test_what_was_changed_or_damaged_is_made_again(tmp_path: Path) -> None:
    settings = Settings(runs=6, columns=("paper",))
    items = items_named(["fill-ratios"])
    first = reproduce(settings, tmp_path, items)
    kept = tmp_path / ITEMS / "fill-ratios" / "cells.parquet"
    kept.write_bytes(kept.read_bytes()[:50])
    with_cells = reproduce(settings, tmp_path, items)
    assert with_cells.results is not None
    assert with_cells.made[0].tables["cells"].equals(first.made[0].tables["cells"])
    other = reproduce(Settings(runs=7, columns=("paper",)), tmp_path, items)
    assert other.results is not None
    assert other.made[0].tables["cells"]["runs"][0] == 7


def test_ctrl_c_keeps_what_is_done(tmp_path: Path) -> None:
    """The item before the one that is broken off is kept, and so are the runs."""
    settings = Settings(runs=4, columns=("paper",))
    items = items_named(["fill-ratios", "swarm-sizes"])

    def stopped(what: str, share: float) -> None:
        if what == "swarm-sizes":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        reproduce(settings, tmp_path, items, stopped)
    assert (tmp_path / ITEMS / "fill-ratios" / "cells.parquet").is_file()
    assert not (tmp_path / ITEMS / "swarm-sizes").exists()
    told: list[str] = []
    made = reproduce(settings, tmp_path, items, lambda what, share: told.append(what))
    assert "fill-ratios" not in told
    assert "swarm-sizes" in told
    assert all(one.tables for one in made.made)


def test_checks_are_not_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["--runs", "4", "--columns", "paper", "--no-pictures", "--out", str(tmp_path)]
    assert main(["reproduce", "--only", "headline", *asked]) == 0
    # The verdicts too have the command that makes them: with all items, intervals are corrected for more claims.
    commands = pl.read_csv(tmp_path / "tables" / "index.csv")["command"].to_list()
    assert all(command.startswith("vibroswarm reproduce --only headline --runs") for command in commands)
    printed = capsys.readouterr().out
    assert "Preset paper: of 2 checks 1 passed, 1 open." in printed
    assert "passed: 0.0 s" in printed
    assert "Checks, which do not count as verdicts" in printed
    assert "claims" not in printed
    assert "Preset paper: of 2 checks 1 passed, 1 open." in (tmp_path / "report.html").read_text(
        encoding="utf-8"
    )


def test_the_page_of_a_control_says_so(tmp_path: Path) -> None:
    settings = Settings(runs=4, columns=("paper",), control="threshold")
    made = reproduce(settings, tmp_path, items_named(["difficulty"]))
    assert "negative control, not the reproduction" in reproduction_document(made).warnings[0]


@pytest.mark.usefixtures("blank_pictures", "empty_pictures")
def test_pictures_are_files_on_request_and_in_the_report_anyway(tmp_path: Path) -> None:
    command = [
        "reproduce",
        "--only",
        "fill-ratios",
        "--columns",
        "paper",
        "--runs",
        "4",
        "--out",
        str(tmp_path),
    ]
    pages = []
    for option in ([], ["--pictures"], []):
        assert main([*command, *option]) == 0
        pages.append((tmp_path / "report.html").read_bytes())
        requested_before = len(pages) > 1
        assert (tmp_path / "pictures" / "captions.csv").exists() == requested_before
    assert pages[0] == pages[1] == pages[2]
    assert b"<svg" in pages[0]


def test_items_have_numbers_names_and_claims_that_are_measured(folder: Path) -> None:
    numbers = [item.number for item in all_items()]
    assert numbers == sorted(set(numbers))
    measured = pl.read_parquet(folder / ITEMS / "fill-ratios" / f"{CLAIMS}.parquet")
    wanted = {claim.value or claim.id: claim.cells for claim in all_claims() if claim.item == "fill-ratios"}
    counted = measured.filter(pl.col("column") == "paper").group_by("value").len()
    assert dict(counted.iter_rows()) == wanted
    with pytest.raises(InputError, match="fill-ratios"):
        items_named(["fill-ratio"])


def test_scenarios_of_the_columns() -> None:
    assert scenario_of("paper", parameter_set="P0") == preset("paper-empirical")
    assert scenario_of("paper", parameters("P_star")) == preset("paper")
    swapped = scenario_of("paper", control="labels").sensor
    assert swapped.vibrating_shape == preset("paper").sensor.still_shape
    assert scenario_of("text", control="threshold").sensor.rms_threshold == 1.55
    with pytest.raises(InputError, match="labels"):
        scenario_of("paper", control="label")


def test_a_cells_options_make_its_scenario() -> None:
    values = {"floor.source": "stripe:0.46", "strategy.name": "soft", "walk.leg_min_ms": 500.0}
    cell = Cell("calibrated", scenario_of("calibrated", values, parameter_set="P0"))
    assert set(values) < set(differences(cell.scenario, preset("calibrated")))
    words = options_of("calibrated", cell.scenario)
    assert words[:3] == ["--preset calibrated", "--floor stripe:0.46", "--strategy soft"]


def test_recordings_that_lack_files_cost_their_item_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "recordings").mkdir()
    asked = ["--only", "calibration", "difficulty", "--runs", "4", "--no-pictures"]
    out = tmp_path / "out"
    told = words_of(capsys, "reproduce", *asked, "--recordings", tmp_path / "recordings", "--out", out)
    assert "calibration: skipped. The folder of recordings lacks CAL_1.csv" in told
    assert [path.name for path in (out / ITEMS).iterdir()] == ["difficulty"]


def test_items_that_need_other_presets_are_skipped_in_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = ["experiments", "experiments-beside", "hidden-threshold"]
    asked = ["--columns", "text", "--runs", "4", "--no-pictures", "--out", str(tmp_path)]
    told = words_of(capsys, "reproduce", "--only", *names, *asked)
    for name in names[:2]:
        assert f"{name}: skipped. It needs preset `paper` or `calibrated`: add it to `--columns`." in told
    assert "hidden-threshold: skipped. It needs preset `paper`: add it to `--columns`." in told


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--only", "fill"], "--only: there is no 'fill'"),
        (["--columns", "papers"], "--columns: there is no 'papers', did you mean 'paper'"),
        (["--control", "label"], "--control: there is no 'label'"),
        (["--runs", "1"], "is not from 2 to"),
    ],
)
def test_wrong_options(
    options: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert says in refusal_of(capsys, "reproduce", *options, "--out", tmp_path)


def test_a_second_one_in_the_same_folder_is_refused_in_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["reproduce", "--only", "difficulty", "--runs", "4", "--no-pictures", "--out", str(tmp_path)]
    with folder_lock(tmp_path):
        assert main(command) == 2
    assert f"{tmp_path}: is in use by process {os.getpid()} on " in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
