"""``vibroswarm inspect``: its sources, its words, and what it refuses."""

from __future__ import annotations

import errno
import re
import shutil
from collections.abc import Sequence
from datetime import datetime, timedelta
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from matplotlib import figure

from helpers.commands import json_of, output_of, refusal_of, words_of
from helpers.documents import ROOT
from vibroswarm import cli, preset, simulate
from vibroswarm.documents.inspection import inspection_document
from vibroswarm.inspection import missed
from vibroswarm.inspection.inspection import inspect
from vibroswarm.inspection.missed import pooled_trials
from vibroswarm.inspection.stopping import Question
from vibroswarm.observation.energy_model import energy_of
from vibroswarm.plots.picture import Picture
from vibroswarm.show.document import Figure

PLATE, LAWS = (ROOT / "examples" / "inspection" / name for name in ("plate.csv", "reference.csv"))
HEAD, *LINES = PLATE.read_text(encoding="utf-8").splitlines()
ROWS = [line.split(",") for line in LINES]
"""Robot, time, x, y in mm and value of each sample of the example."""


def small(csv: Path, *words: str | Path) -> tuple[str | Path, ...]:
    """The words that inspect a file as the example is inspected."""
    return (csv, "--laws", LAWS, "--size", "1x1", *words)


def saved(path: Path, rows: Sequence[Sequence[object]], head: str = HEAD) -> Path:
    """Save a CSV with these rows, and return its path."""
    path.write_text("\n".join([head, *(",".join(map(str, row)) for row in rows)]), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def plate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A CSV of places and values in mm and minutes, and one of measured energies."""
    folder = tmp_path_factory.mktemp("plate")
    scenario = preset("paper").with_values({"run.t_end_s": 600.0})
    result = simulate(scenario, seed=5)
    frame = result.motion.join(result.observations, on=["run", "robot", "sample"])
    rows = ["robot,time_min,x_mm,y_mm,value"]
    rows += [
        f"{robot},{time_s / 60:.4f},{1000 * x:.1f},{1000 * y:.1f},{energy:.4f}"
        for robot, time_s, x, y, energy in frame.select("robot", "time_s", "x_m", "y_m", "energy").iter_rows()
    ]
    (folder / "plate.csv").write_text("\n".join(rows))
    u = (np.arange(500) + 0.5) / 500
    lines = ["kind,energy"]
    for kind, word in ((False, "still"), (True, "vibrating")):
        lines += [f"{word},{energy:.4f}" for energy in energy_of(scenario.sensor, kind, u)]
    (folder / "reference.csv").write_text("\n".join(lines))
    floor = result.floor().tiles
    (folder / "floor.txt").write_text("\n".join("".join(map(str, row)) for row in floor))
    return folder


def run(*words: str | Path) -> int:
    return cli.main([str(word) for word in words])


def error_of(capsys: pytest.CaptureFixture[str], *words: str | Path) -> str:
    return refusal_of(capsys, "inspect", *words)


def test_a_csv_becomes_a_map(plate: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    given = [
        plate / "plate.csv",
        "--laws",
        plate / "reference.csv",
        "--size",
        "1x1",
        "--floor",
        plate / "floor.txt",
    ]
    document = json_of(capsys, "inspect", *given, "--out", tmp_path / "out", "--json")
    assert "25 of 25 tiles right" in " ".join(document["answer"])
    assert "500 measured values on still places" in " ".join(document["robots_were_told"])
    assert "plate.csv" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


@pytest.mark.usefixtures("blank_pictures")
def test_a_table_that_no_spreadsheet_can_hold_is_saved_as_parquet_only(
    plate: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The maps of each of 1000 robots over time were 900 MB of CSV."""
    out = tmp_path / "out"
    command = ("inspect", plate / "plate.csv", "--laws", plate / "reference.csv", "--size", "1x1", "--tiles", "5x5",
               "--out", out, "--force")  # fmt: skip
    assert run(*command) == 0
    rows = pl.read_csv(out / "map.csv").height
    monkeypatch.setattr("vibroswarm.study.summary.MOST_CSV_ROWS", rows - 1)
    assert run(*command) == 0
    assert not (out / "map.csv").exists(), "of the earlier result"
    assert pl.read_parquet(out / "map.parquet").height == rows
    assert (out / "samples.csv").exists()


def test_a_csv_without_a_truth(plate: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = [plate / "plate.csv", "--laws", plate / "reference.csv", "--size", "1x1"]
    out = output_of(capsys, "inspect", *given, "--tiles", "5x5", "--spread-mm", "10")
    assert "tiles vibrate" in out
    assert "true floor" not in out
    assert "10 mm" in out
    assert "surer of single tiles" not in out
    narrow = words_of(capsys, "inspect", *given, "--tiles", "10x10", "--spread-mm", "50")
    assert (
        "Tiles are 2.0 times as wide as places are uncertain (standard deviation): below 3 the map is surer"
        in narrow
    )
    # the mean of its only tile is that of a still one
    assert "0 of 1 tile vibrate and 1 is still, each" in output_of(
        capsys, "inspect", *small(PLATE, "--tiles", "1x1")
    )


@pytest.mark.usefixtures("few_draws")
def test_results_that_cannot_be_saved_are_printed(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They were lost, and the code was that of a failure. With a certificate, too."""
    # As if the file were not there yet when the command begins.
    monkeypatch.setattr("vibroswarm.cli.out_folder.refuse_unwritable", lambda path: None)
    (tmp_path / "file").write_text("")
    for rest, answer in ((("--tiles", "5x5"), "tiles vibrate"), (("--replicates", "19"), "DAMAGE")):
        assert run("inspect", *small(PLATE, *rest), "--out", tmp_path / "file" / "sub") == 2
        printed = capsys.readouterr()
        assert answer in printed.out
        assert "Saved" not in printed.out
        assert "cannot be made" in printed.err


def test_without_samples_the_error_says_so(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Nobody gave --run."""
    settings = ("--set", "sample.sample_interval_ms=100000000", "--set", "run.t_end_s=60")
    error = error_of(capsys, *settings)
    assert "no robot took a sample in run 0" in error
    assert "--run" not in error


def test_options_of_what_a_csv_does_not_have_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert "--bits: leave it out" in error_of(capsys, *small(PLATE, "--tiles", "5x5", "--bits"))
    assert "--run: leave it out" in error_of(capsys, *small(PLATE, "--tiles", "5x5", "--run", "3"))
    for option in (
        ("--network", "tree"),
        ("--task", "mean"),
        ("--energies", "own.csv"),
        ("--preset", "paper"),
    ):
        assert "leave the options of a simulation out" in error_of(capsys, *small(PLATE, *option))


def test_a_saved_run_is_inspected_as_it_was_simulated(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    scenario = preset("optimised-places").with_values({"run.t_end_s": 100.0})
    simulate(scenario, seed=3).write(tmp_path / "run")
    saved = json_of(capsys, "inspect", tmp_path / "run", "--json")
    found = inspect(scenario, seed=3)
    last = found.maps.filter(pl.col("time_s") == found.times_s[-1]).drop("time_s")
    assert found.last_maps.equals(last)
    assert saved["made_by"]["samples"] == found.samples.hash
    assert "estimated by the robots" in saved["robots_were_told"][0]
    assert "Places taken as independent" in found._repr_html_()


def test_true_places_are_called_an_upper_bound(capsys: pytest.CaptureFixture[str]) -> None:
    assert "upper bound" in output_of(
        capsys, "inspect", "--preset", "paper", "--set", "run.t_end_s=100", "--bits"
    )


def test_what_is_wrong_is_one_line(plate: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    csv, laws = plate / "plate.csv", ("--laws", plate / "reference.csv")
    text = csv.read_text()
    for name, head in (
        ("two.csv", "robot,time_min,x_mm,x_m,value"),
        ("none.csv", "robot,time_min,across,up,value"),
        ("odd.csv", "robot,time_min,x_furlong,y_furlong,value"),
        ("mixed.csv", "robot,time_min,x_mm,y_m,value"),
        ("valueless.csv", "robot,time_min,x_mm,y_mm,weight"),
    ):
        (tmp_path / name).write_text(text.replace("robot,time_min,x_mm,y_mm,value", head))
    first, *lines = text.splitlines()
    twice = [f"{line},{line.rpartition(',')[2]}" for line in text.splitlines()]
    for name, changed in (
        ("semicolons.csv", text.replace(",", ";")),
        ("tabs.csv", text.replace(",", "\t")),
        ("repeated.csv", "\n".join(twice)),
        ("robots.csv", "\n".join(f"{line.partition(',')[0]},{line}" for line in text.splitlines())),
        ("few.csv", "\n".join(text.splitlines()[:6])),
        ("gone.csv", "\n".join([first, *(f"{line.rpartition(',')[0]}," for line in lines)])),
        ("many.csv", text.splitlines()[0] + "".join(f"\n{row},1.0,500,500,0.9" for row in range(1001))),
    ):
        (tmp_path / name).write_text(changed)
    for name, words in (
        ("two.csv", "two columns: x_mm and x_m"),
        ("repeated.csv", "one column of values"),  # the first was taken
        ("robots.csv", "robot in two columns"),
        ("none.csv", "no column for x"),
        ("odd.csv", "not a unit"),
        ("mixed.csv", "one unit"),
        ("valueless.csv", "column of values"),
        ("semicolons.csv", "';' between columns; use ','"),
        ("tabs.csv", "tabs between columns; use ','"),
        ("few.csv", "has 5 samples; nothing can be said"),
        ("gone.csv", f"has 0 samples and {len(lines)} rows without a value; nothing can be said"),
        ("many.csv", "has 1,001 different robots, not 1,000 or fewer; if it numbers samples"),
        ("missing.csv", "no such file"),
    ):
        assert words in error_of(capsys, tmp_path / name, *laws, "--size", "1x1")
    for words, *given in (
        ("--size", csv, *laws),
        ("--laws", csv, "--size", "1x1"),
        ("size of the surface in m", csv, *laws, "--size", "1000x1000"),
        ("outside the surface", csv, *laws, "--size", "0.1x0.1"),
        ("WxH", csv, *laws, "--size", "1"),
        ("--size", "--size", "1x1"),
    ):
        assert str(words) in error_of(capsys, *given)


@pytest.mark.usefixtures("few_draws", "blank_pictures")
def test_without_a_grid_damage_is_called_and_certified(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("vibroswarm.cli.progress.LINE_EVERY_S", 0.0)
    monkeypatch.setattr("vibroswarm.cli.progress.FIRST_LINE_S", 0.0)
    assert run("inspect", *small(PLATE, "--replicates", "39", "--out", tmp_path / "out")) == 0
    out, err = capsys.readouterr()
    shares = [int(share) for share in re.findall(r"^inspecting: (\d+) %$", err, re.MULTILINE)]
    assert shares == sorted(shares)
    assert len(shares) > 3  # with many samples it takes minutes
    assert "DAMAGE: 2 patches, 20 cm x 20 cm at x = 0.70 m, y = 0.70 m" in out
    assert "20 cm x 20 cm at x = 0.30 m, y = 0.30 m" in out
    # The centre of a crack was in its region of "90 %" in 40 to 80 % of cases, as only squares are scanned for.
    said = " ".join(out.split())
    assert "The region presumes the shapes that were scanned for" in said
    # "None up to 1" was said of squares of 10 cm, beside an a90 of 8.8 cm at contrast 1.
    assert re.search(r"a dash: not shown up to 1 by \d+ drawn surfaces of each contrast", said)
    assert re.search(
        r"Damage of \S+ cm and contrast 1 would .* found in 90 % .*Model-assisted", out, re.DOTALL
    )
    certificate = (tmp_path / "out" / "certificate.html").read_text()
    assert re.search(r'<p class="verdict[^>]*>[^<]*DAMAGE', certificate)
    # It had a50, contrasts, ranges and dashes, and did not say what they are.
    assert "A dash: not reached." in certificate
    assert "of one joint 90" in certificate
    assert "Not covered" in certificate


@pytest.fixture
def report_blank(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures of the report are blank; that of the certificate, which has another style, is drawn."""
    drawn = Figure.drawn.func
    blank = Picture(figure.Figure(figsize=(1, 1)), pl.DataFrame({"blank": [0]}), "Blank.")

    def of_certificate(self: Figure) -> Picture:
        return drawn(self) if self.on_page == "column" else blank

    monkeypatch.setattr(Figure, "drawn", property(of_certificate))


@pytest.mark.usefixtures("few_draws", "report_blank")
def test_a_certificate_of_many_shapes_and_a_long_name_prints_on_one_sheet(
    tmp_path: Path, browser: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing is certified, which is said in large letters. It was two sheets, and the name was cut off.

    Many warnings, and a reference with a long name, made it two sheets again.
    """
    rows = [[k % 2, k % 3, k % 4, k % 5, *row] for k, row in enumerate(ROWS)]
    plate = saved(tmp_path / f"{'крыло' * 24}.csv", rows + rows[:9], f"floor,plate,run,session,{HEAD}")
    laws = shutil.copy(LAWS, tmp_path / f"{'крыло' * 24}-laws.csv")
    more = ("--shapes", "square,disc,crack", "--looks", "4", "--loss", "20%", "--spread-mm", "5")
    given = (plate, "--laws", laws, "--size", "1x1", "--replicates", "19", *more)
    said = output_of(capsys, "inspect", *given, "--out", tmp_path / "out")
    shapes = re.findall(r"^(square|disc|crack) ", said, re.MULTILINE)
    assert shapes == [*["square"] * 3, "disc", "crack"]  # of three contrasts
    words = " ".join(said.split())
    assert "4 looks, T and its p-value are of the largest over them" in words
    assert "all but 20 % of the others" in words
    page = browser.new_page()
    page.goto((tmp_path / "out" / "certificate.html").as_uri())
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    assert len(re.findall(rb"/Type\s*/Page[^s]", page.pdf(prefer_css_page_size=True))) == 1
    page.set_viewport_size({"width": 700, "height": 1000})
    assert page.evaluate("document.documentElement.scrollWidth") == 700
    page.emulate_media(media="print")
    letters = """Math.min(...[...document.querySelectorAll("svg text")].map((e) =>
        parseFloat(getComputedStyle(e).fontSize) * Math.hypot(e.getScreenCTM().a, e.getScreenCTM().b)))"""
    assert 6.5 < page.evaluate(letters) < 20.0
    page.close()


@pytest.mark.usefixtures("blank_pictures", "few_draws")
def test_a_robot_with_another_gain_is_not_certified(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The control: one robot reads 1.5 times as much."""
    louder = [[r, t, x, y, 1.5 * float(v) if r == "2" else v] for r, t, x, y, v in ROWS]
    asked = ("--contrasts", "1", "--replicates", "19", "--sizes", "10,20,disc14,30x5")
    given = small(saved(tmp_path / "plate.csv", louder), *asked)
    said = words_of(capsys, "inspect", *given, "--out", tmp_path / "out")
    assert "Not certified: the samples contradict the law of the sensor" in said
    assert "Scan of 10, 20, 14 (disc), 30 x 5 and 5 x 30 cm" in said
    assert re.search(
        r"\(\S+ of 10, \S+ of 20, \S+ of 14 \(disc\), \S+ of 30 x 5 and \S+ of 5 x 30 cm\)", said
    )
    assert (
        '<p class="verdict refused">Not certified</p>' in (tmp_path / "out" / "certificate.html").read_text()
    )


@pytest.mark.usefixtures("few_draws")
def test_a_wrong_grid_is_named_where_robots_disagree_on_it_and_damage_on_parts_of_tiles(
    capsys: pytest.CaptureFixture[str],
) -> None:
    given = small(PLATE, "--tiles", "7x7", "--no-pictures")
    assert "the grid is right, is not checked" in words_of(capsys, "inspect", *given)
    said = words_of(capsys, "inspect", *given, "--damage", "--contrasts", "1", "--replicates", "19")
    assert "the samples contradict the other robots' map of this grid (places" in said
    assert "damage on a part of one is in the scan" in said


@pytest.mark.usefixtures("few_draws")
def test_questions_that_make_no_sense_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    for words, *asked in (
        ("--shapes", "--shapes", "star"),
        ("--loss", "--loss", "2"),
        ("--sizes", "--sizes", "200"),
        ("at least 19", "--replicates", "5"),
        ("--least-cm: squares of 200 cm do not fit", "--least-cm", "200", "--replicates", "19"),
        ("--contrasts", "--contrasts", "2"),
        ("--risk", "--risk", "0%"),
    ):
        assert words in error_of(capsys, *small(PLATE, *asked))


def test_a_plan_says_what_robots_and_time_buy(capsys: pytest.CaptureFixture[str]) -> None:
    small = ["--plan", "3", "--minutes", "1,6", "--runs", "4", "--plates", "20"]
    document = json_of(capsys, "inspect", *small, "--want-cm", "25", "--json")
    rows = document["tables"]["plan"]
    assert [row["robots"] for row in rows] == [3, 3]
    assert rows[1]["samples"] > rows[0]["samples"]
    # They were min and cm, named until_s and a90_m. What is enough was given without its false calls.
    assert [row["until_min"] for row in rows] == [1, 6]
    assert rows[1]["a50_cm"] > 5
    assert rows[1]["sweep_a90_cm"] is None or rows[1]["sweep_a90_cm"] > 5
    assert re.search(r"are enough for squares of 25 cm: .* cm, at \S+ % false calls", document["answer"][0])
    assert document["robots_were_told"] == ["Places: estimated by the robots."]
    assert document["made_by"]["seed"] == "1"
    few = ["--plan", "3", "--minutes", "1", "--runs", "4", "--plates", "10"]
    told = "Places: true places, which no real robot knows: an upper bound."
    said = words_of(capsys, "inspect", *few, "--preset", "paper")
    assert said.startswith(told)
    assert "squares of contrast 1 drawn from the law" in said
    assert "leave out the result or file" in error_of(capsys, "plate.csv", "--plan", "3")
    for option, value in (("--minutes", "5"), ("--want-cm", "10"), ("--plates", "20"), ("--runs", "10")):
        assert f"{option}: needs --plan" in error_of(capsys, "--floor", "random:0.48", option, value)
    for unread in (
        ["--bits"], ["--sizes", "30"], ["--strict"], ["--laws", "paper"], ["--replicates", "19"], ["--robots", "8"],
        ["--floor", "random:0.48"],
    ):  # fmt: skip
        assert f"{unread[0]}: " in error_of(capsys, "--plan", "3", *unread)
    for words, *asked in (
        ("--minutes: 0 is not", "--minutes", "0"),
        ("arena: is 0.2 m x 1 m; a plan draws", "--set", "arena.width_m=0.2"),
        ("faults.stuck: a plan draws energies of sensors that work", "--set", "faults.stuck=0.4"),
        (
            "not all inspections have a sample after 0.6 s",
            "--minutes",
            "0.01,4",
            "--runs",
            "4",
            "--plates",
            "10",
        ),
    ):
        assert words in error_of(capsys, "--plan", "3", *asked)


@pytest.mark.parametrize(("runs", "plates", "drawn"), [(8, 10, 8), (5, 10, 10), (30, 10, 15)])
def test_a_plan_says_how_many_surfaces_were_drawn(
    runs: int, plates: int, drawn: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    trials = []

    def kept(*given: Any, **more: Any) -> Any:
        trials.append(pooled_trials(*given, **more))
        return trials[-1]

    monkeypatch.setattr(missed, "pooled_trials", kept)
    assert run("inspect", "--plan", "2", "--minutes", "1", "--runs", str(runs), "--plates", str(plates)) == 0
    assert trials[0].found.size == drawn * len(missed.SIDES_M)
    assert f"; {trials[0].found.size} surfaces with" in " ".join(capsys.readouterr().out.split())


@pytest.mark.usefixtures("empty_pictures", "few_draws")
def test_samples_of_one_time_have_one_map(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """They had 60, all of that time: the page of their map was a traceback."""
    once = saved(tmp_path / "once.csv", [[r, 7, x, y, v] for r, _, x, y, v in ROWS[:100]])
    asked = ("--tiles", "5x5", "--damage", "--contrasts", "1", "--replicates", "19")
    out = json_of(capsys, "inspect", *small(once, *asked, "--out", tmp_path / "out", "--json"))
    assert "tiles vibrate" in out["answer"][-1]
    assert len(out["tables"]["risk"]) == 1  # eight times 0 s
    assert out["tables"]["weakest"][0].keys() >= {
        "side_cm",
        "area_cm2",
    }  # which were named side_m and area_m2
    for name, cells in (("map", 25), ("raster", 40 * 40)):
        table = pl.read_parquet(tmp_path / "out" / f"{name}.parquet")
        assert table.filter(pl.col("robot").is_null()).height == cells


def test_energies_are_not_judged_by_a_law_of_classes(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    law = preset("paper").with_values({"sensor.model": "confusion", "sensor.confusion.kinds": 2})
    (tmp_path / "law.toml").write_text(law.to_toml())
    error = error_of(capsys, PLATE, "--size", "1x1", "--tiles", "5x5", "--laws", tmp_path / "law.toml")
    assert "--laws: is of sensor 'confusion', which reads classes from 0 to 1; 1.492 is none" in error


def test_a_reference_of_some_of_the_values_that_it_judges_is_warned_of(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Of all of them it was warned of before, of all but one not."""
    random = np.random.default_rng(1)
    rows = [[*row, f"{float(value) + 1e-3 * random.random():.6f}"] for *row, value in ROWS]
    known = [("vibrating" if float(value) > 2.0 else "still", value) for *_, value in rows[:600]]
    own = saved(tmp_path / "own.csv", known, "kind,energy")
    given = (saved(tmp_path / "plate.csv", rows), "--size", "1x1", "--tiles", "5x5", "--laws")
    said = words_of(capsys, "inspect", *given, own)
    assert "The session judges itself: the law was fitted to its own samples: 600 of its 948 values" in said
    assert "judges itself" not in output_of(capsys, "inspect", *given, LAWS)


def test_what_is_odd_about_a_file_is_said(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    in_m = [
        [r, t, float(x) / 1000, float(y) / 1000, v] if r in "13" else [r, t, x, y, v]
        for r, t, x, y, v in ROWS
    ]
    # Of an origin that was 7 cm off in x and in y a certificate was issued.
    shifted = [[r, t, int(x) + 70, int(y) + 70, v] for r, t, x, y, v in ROWS]
    for words, odd in (
        ("378 of 948 places are in the lower left corner", in_m),
        ("948 of 948 values are outside of those of the law", [[*row, 1000 * float(v)] for *row, v in ROWS]),
        ("All samples of each robot have the same time", [[r, 7, x, y, v] for r, _, x, y, v in ROWS]),
        ("s apart, as if times were in a smaller unit", [[r, 1000 * float(t), *row] for r, t, *row in ROWS]),
        ("No sample for 168.0 h; of several inspections", [  # a week later
            [r, float(t) + 604800 * (k >= 500), *row] for k, (r, t, *row) in enumerate(ROWS)
        ]),
        ("190 of 948 rows have no value", [[*row, v if k % 5 else ""] for k, (*row, v) in enumerate(ROWS)]),
        ("Robots 0 and 5 have the same times, places and values", ROWS + [[5, *row] for r, *row in ROWS if r == "0"]),
        ("The file repeats 1 row", [*ROWS, ROWS[7]]),  # which counted twice without a word
        ("948 samples of 5 robots on 1 m x 1 m, 19 of them outside of it.", [
            [r, t, -30 if k % 50 == 0 else x, y, v] for k, (r, t, x, y, v) in enumerate(ROWS)
        ]),
        ("of 948 places are outside the surface, by up to 3.9 cm", shifted),
    ):  # fmt: skip
        assert words in words_of(
            capsys, "inspect", *small(saved(tmp_path / "odd.csv", odd), "--tiles", "5x5")
        )
    # All samples counted as one robot's, without a word. The name of a file may be in capitals.
    renamed = saved(tmp_path / "RENAMED.CSV", ROWS, HEAD.replace("robot", "robot_id"))
    laws = shutil.copy(LAWS, tmp_path / "LAWS.CSV")
    said = words_of(
        capsys, "inspect", renamed, "--laws", laws, "--size", "1x1", "--tiles", "5x5", "--robot-spread", "10%"
    )
    assert "all samples count as one robot's; not read: 'robot_id'" in said
    # Rows of two floors were taken as one, without a word.
    floors = saved(tmp_path / "floors.csv", [[k % 2, *row] for k, row in enumerate(ROWS)], f"floor,{HEAD}")
    said = words_of(capsys, "inspect", *small(floors, "--tiles", "5x5"))
    assert "Not read: column 'floor' with 2 values; all rows" in said
    # A raster may begin in the corner: one of 16 places.
    raster = [[r, t, k % 4 * 333, k // 4 % 4 * 333, v] for k, (r, t, _, _, v) in enumerate(ROWS)]
    assert "Warning" not in output_of(
        capsys, "inspect", *small(saved(tmp_path / "raster.csv", raster), "--tiles", "4x4")
    )
    # Places that the stated spread explains may be outside.
    given = small(saved(tmp_path / "shifted.csv", shifted), "--tiles", "5x5", "--spread-mm", "20")
    said = words_of(capsys, "inspect", *given)
    assert "129 of them outside of it" in said
    assert "outside the surface" not in said


def test_times_may_be_timestamps(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """They count from the first; without a column of robots they also stood for the robots' numbers."""
    begin = datetime(2026, 5, 1, 10, 0)
    rows = [[f"{begin + timedelta(seconds=float(time_s))}Z", *rest] for _, time_s, *rest in ROWS]
    csv = saved(tmp_path / "plate.csv", rows, HEAD.partition(",")[2])
    assert "after 596 s" in words_of(
        capsys, "inspect", *small(csv, "--tiles", "5x5")
    )  # of 599 s, less the first 3


def test_empty_lines_of_spreadsheets_are_left_out(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """They are written as separators only, and were refused as a robot and as a kind of tile without a name."""
    csv = saved(tmp_path / "plate.csv", [*ROWS, [""] * 5])
    laws = tmp_path / "laws.csv"
    laws.write_text(f"{LAWS.read_text()}\n,\n,\n")
    given = ("--laws", laws, "--size", "1x1", "--tiles", "5x5")
    assert f"{len(ROWS)} samples of 5 robots" in output_of(capsys, "inspect", csv, *given)


def test_a_header_in_the_middle_is_called_one(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Its name of the robot was refused as no number."""
    csv = saved(tmp_path / "two.csv", [*ROWS[:9], HEAD.split(","), *ROWS[9:]])
    assert "two.csv, row 11: is the header again" in error_of(capsys, *small(csv))


def test_the_order_of_rows_does_not_matter(tmp_path: Path) -> None:
    """It did if a robot had several samples of one time: as whole minutes, a90 was 9.7, 9.0 and 9.5 cm by the order."""
    rows = pl.read_csv(PLATE).with_columns(pl.col("time_s") // 60 * 60)
    found = []
    for name, table in {"rows": rows, "exchanged": rows.sample(fraction=1.0, shuffle=True, seed=3)}.items():
        table.write_csv(tmp_path / f"{name}.csv")
        given = inspect(tmp_path / f"{name}.csv", laws=str(LAWS), size_m=(1.0, 1.0), floor=(5, 5))
        found.append(given.samples)
    assert found[0].frame.equals(found[1].frame)
    assert found[0].hash == found[1].hash


def test_a_reference_is_fitted_once_unless_its_file_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vibroswarm.inspection.laws.MEASURED", 4)
    laws = tmp_path / "laws.csv"
    laws.write_text("\n".join([*LAWS.read_text().splitlines()[::8], "still,0.5"]))
    first, second = (inspect(PLATE, laws=laws, size_m=(1.0, 1.0), floor=(5, 5)).samples.law for _ in range(2))
    assert first is second
    laws.write_text(laws.read_text().replace("still,0.5", "still,0.51"))
    third = inspect(PLATE, laws=laws, size_m=(1.0, 1.0), floor=(5, 5)).samples.law
    assert third.hash != first.hash
    assert third.sessions != first.sessions


@pytest.mark.usefixtures("few_draws")
def test_a_beam_is_asked_of_what_can_lie_on_it(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    beam = saved(tmp_path / "beam.csv", [[r, t, x, int(y) // 20, v] for r, t, x, y, v in ROWS])
    given = (beam, "--laws", LAWS, "--size", "1x0.05", "--contrasts", "1", "--replicates", "19")
    assert "squares: at most 5 cm" in error_of(capsys, *given)
    assert "--least-cm: squares of 10 cm" in error_of(capsys, *given, "--sizes", "5,20x2")
    assert run("inspect", *given, "--sizes", "5,20x2", "--least-cm", "5", "--shapes", "crack") == 0


def undamaged(robots: int = 2) -> pl.DataFrame:
    """Samples of robots, one in each square of 5 cm of an undamaged plate of 1 m x 1 m."""
    x_mm, y_mm = (axis.ravel() for axis in np.meshgrid(*[np.arange(25, 1000, 50)] * 2))
    value = energy_of(preset("paper").sensor, 0, np.random.default_rng(1).random(400))
    columns = {"robot": np.arange(400) % robots, "time_s": np.arange(400), "x_mm": x_mm, "y_mm": y_mm}
    return pl.DataFrame({**columns, "value": value})


@pytest.mark.usefixtures("few_draws")
def test_the_maps_of_the_first_robots_are_drawn(tmp_path: Path) -> None:
    """Those of 300 robots took minutes to draw; the tables have them all."""
    undamaged(14).write_csv(tmp_path / "many.csv")
    found = inspect(
        tmp_path / "many.csv", laws="paper", size_m=(1, 1), question=Question(contrasts=(1.0,)), replicates=19
    )
    parts = chain.from_iterable(getattr(part, "parts", ()) for part in inspection_document(found).parts)
    [figure] = [part for part in parts if isinstance(part, Figure) and part.name == "raster"]
    assert figure.title.endswith("by robot (drawn: 11 of 14 robots)")
    assert figure.drawn.numbers["panel"].str.starts_with("robot").sum() == 11 * 1600
    assert found.rasters["robot"].n_unique() == 15


@pytest.mark.usefixtures("few_draws")
def test_a_plate_with_a_part_that_does_not_exist_is_told_why_it_is_open(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """More samples were asked for, and not where: of an L none would ever have been enough."""
    undamaged().filter((pl.col("x_mm") < 500) | (pl.col("y_mm") < 500)).write_csv(tmp_path / "l.csv")
    asked = ("--laws", "paper", "--size", "1x1", "--contrasts", "1", "--replicates", "19")
    said = words_of(capsys, "inspect", tmp_path / "l.csv", *asked)
    assert "more samples are needed: 25 % of the cells of 10 cm have none." in said


@pytest.mark.usefixtures("few_draws")
def test_a_plate_that_is_cleared_with_a_hole_is_said_to_have_one(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """The risk is an average over places; the answer told it without its hole."""
    undamaged().filter((pl.col("x_mm") > 300) | (pl.col("y_mm") > 300)).write_csv(tmp_path / "hole.csv")
    asked = ("--laws", "paper", "--size", "1x1", "--contrasts", "1", "--replicates", "19", "--least-cm", "20")
    said = words_of(capsys, "inspect", tmp_path / "hole.csv", *asked)
    assert "CLEAR of damage of 20 cm or larger, contrast 1: risk" in said
    assert "on average over places (tolerated: 5 %); 9.0 % of the cells of 10 cm have no sample." in said
    strict = words_of(capsys, "inspect", tmp_path / "hole.csv", *asked, "--strict")
    assert "OPEN" in strict
    assert re.search(r"the largest L of all places \([^)]*\) and contrasts \(1\)\.", strict)


def test_rows_without_a_value_are_counted_and_differences_of_robots_stated(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    lines = (ROOT / "examples" / "inspection" / "plate.csv").read_text().splitlines()
    lines[4] = lines[4].rpartition(",")[0] + ",nan"
    (tmp_path / "plate.csv").write_text("\n".join(lines))
    given = small(tmp_path / "plate.csv", "--tiles", "5x5", "--robot-spread", "12%", "--tile-spread", "15%")
    said = words_of(capsys, "inspect", *given)
    assert "1 row of the file without a value left out" in said
    serials = [line if k == 0 else f"8800{line}" for k, line in enumerate(lines)]  # numbers of devices
    (tmp_path / "serials.csv").write_text("\n".join(serials))
    assert "has a robot 8800" in error_of(capsys, *small(tmp_path / "serials.csv", "--tiles", "5x5"))
    assert "places of 20 cm presumed to differ by 15 %, robots by 12 %" in said
    assert "--robot-spread" in error_of(capsys, "--preset", "paper", "--robot-spread", "12%")
    assert "at least 99" in error_of(
        capsys, *small(tmp_path / "plate.csv", "--replicates", "50", "--level", "1%")
    )


@pytest.mark.usefixtures("few_draws")
def test_the_map_of_a_floor_that_changes_is_scored_by_the_floor_at_each_time_and_not_certified(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    changing = {
        "run.t_end_s": 300.0,
        "change.at_s": 150.0,
        "change.to": "invert",
        "floor.source": "random:0.4",
    }
    result = simulate(preset("paper").with_values(changing), seed=2)
    result.write(tmp_path / "run")
    found, before = inspect(result), result.floor(0).tiles.ravel().astype(float)
    assert found.pooled is not None
    assert found.vibrates is not None
    for time_s, p, truth, brier in zip(
        found.times_s, found.pooled, found.vibrates, found.scores["brier"], strict=True
    ):
        floor = before if time_s < 150.0 else 1.0 - before
        assert (truth == floor).all()
        assert brier == pytest.approx(np.mean((p - floor) ** 2), abs=1e-12)
    said = words_of(capsys, "inspect", tmp_path / "run", "--damage", "--contrasts", "1", "--replicates", "19")
    assert "Not certified" in said
    assert "the floor changed at 150 s, but is presumed to stay as it is" in said


def test_energies_of_sensors_that_fail_are_those_of_sensors_that_work() -> None:
    """All sensors were stuck at 1, and the map was right, without a word."""
    result = simulate(preset("paper").with_values({"run.t_end_s": 60.0, "faults.stuck_at_1": 1.0}), seed=2)
    assert "Faults (stuck_at_1) change readings only" in inspect(result).samples.warning
    nobody = simulate(preset("paper").with_values({"run.t_end_s": 60.0, "faults.stuck_at_1": 0.01}), seed=2)
    assert inspect(nobody).samples.warning == ""
    of_bits = inspect(result, bits=True).samples
    assert of_bits.warning == ""
    assert of_bits.column("value").all()


@pytest.mark.usefixtures("empty_pictures", "few_draws")
def test_damage_of_three_kinds_is_told_without_contrasts(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    kinds = {
        "sensor.model": "confusion", "task.name": "majority", "strategy.name": "dirichlet",
        "floor.source": "random:0.6,0.2,0.2", "run.t_end_s": 600.0,
    }  # fmt: skip
    simulate(preset("paper").with_values(kinds), seed=1).write(tmp_path / "run")
    given = (
        "inspect",
        tmp_path / "run",
        "--damage",
        "--contrasts",
        "1",
        "--replicates",
        "19",
        "--out",
        tmp_path / "out",
    )
    said = output_of(capsys, *given)
    assert "Probability that each tile is of another kind than 0" in said
    assert "law of still places" in said
    assert "weakest contrast" not in said
    assert (tmp_path / "out" / "certificate.html").exists()

    raster = pl.read_parquet(tmp_path / "out" / "raster.parquet")
    assert raster["time_s"].n_unique() == 6
    assert raster["robot"].n_unique() == 6
    assert pl.read_parquet(tmp_path / "out" / "map.parquet")["time_s"].n_unique() == 60


def test_a_recording_may_have_places_of_the_robots_themselves(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """A log whose robots say where they believe they are, with a camera or without."""
    scenario = preset("optimised-places").with_values({"run.t_end_s": 300.0})
    result = simulate(scenario, seed=4, segments=True)
    both = result.motion.join(result.observations, on=["run", "robot", "sample"]).join(
        result.places, on=["run", "robot", "sample"], suffix="_own"
    )
    rows = both.select("robot", "time_s", "x_m", "y_m", "energy", "x_m_own", "y_m_own", "spread_m").rows()
    head = "robot,t,x,y,energy,own_x,own_y,own_spread"
    track = [(row[0], row[1] - 0.1, *row[2:4], "", "", "", "") for row in rows]
    floor = result.floor().tiles
    (tmp_path / "floor.txt").write_text("\n".join("".join(map(str, row)) for row in floor))
    for name, lines, x, y in (("seen", [*rows, *track], "x", "y"), ("alone", rows, "own_x", "own_y")):
        ordered = sorted(lines, key=lambda row: (row[1], row[0]))
        text = "\n".join([head, *(",".join(map(str, row)) for row in ordered)])
        (tmp_path / f"{name}.csv").write_text(text)
        (tmp_path / f"{name}.toml").write_text(
            f'[columns]\nrobot = "robot"\ntime_s = "t"\nx_m = "{x}"\ny_m = "{y}"\nenergy = "energy"\n'
            'place_x_m = "own_x"\nplace_y_m = "own_y"\nplace_spread_m = "own_spread"\n'
        )
        given = (
            tmp_path / f"{name}.csv",
            "--columns",
            tmp_path / f"{name}.toml",
            "--floor",
            tmp_path / "floor.txt",
        )
        assert run("lab", "import", *given, "--tiles", "5x5", "--any-floor", "--out", tmp_path / name) == 0
        words = words_of(capsys, "inspect", tmp_path / name, "--laws", "optimised-places")
        assert "Places: estimated by the robots" in words
        assert ("within 1, 2 and 4 stated standard deviations" in words) == (name == "seen")
        assert ("how wrong they are is not known" in words) == (name == "alone")
    assert "there is no session 9" in error_of(capsys, tmp_path / "seen", "--run", "9")
    assert "--spread-mm" in error_of(
        capsys, tmp_path / "seen", "--laws", "optimised-places", "--spread-mm", "5"
    )
    assert "--size" in error_of(capsys, tmp_path / "seen", "--size", "1x1")
    head, *named = (tmp_path / "seen.toml").read_text().splitlines()
    again = (tmp_path / "seen.csv", "--columns", tmp_path / "seen.toml", "--floor", tmp_path / "floor.txt")
    again = ("lab", "import", *again, "--tiles", "5x5", "--any-floor", "--out", tmp_path / "again")
    (tmp_path / "seen.toml").write_text("\n".join([head, *named[:-1]]))
    assert "name all or none" in refusal_of(capsys, *again)
    (tmp_path / "seen.toml").write_text("\n".join([head, *named[:-3]]))
    assert run(*again) == 0
    for spread, words in (
        ("0", "taken as exact and independent; how wrong they are is not known"),
        ("5", "taken as independent"),
    ):
        assert f"Places {words}" in words_of(
            capsys, "inspect", tmp_path / "again", "--laws", "optimised-places", "--spread-mm", spread
        )


def test_a_full_disk_leaves_a_folder_that_the_same_command_fills(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["inspect", "--set", "run.t_end_s=20", "--out", tmp_path / "out"]

    def full(self: Path, data: bytes) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        assert run(*line) == 1
    assert "No space left on device" in capsys.readouterr().err
    assert run(*line) == 0
    assert (tmp_path / "out" / "report.html").is_file()


@pytest.mark.usefixtures("few_draws")
def test_physics_on_another_floor_than_that_of_its_law_is_refused_with_the_reason() -> None:
    physics = {"sensor.model": "acceleration", "floor.source": "random:0.08", "run.t_end_s": 300.0}
    scenario = preset("optimised-places").with_values(physics)
    found = inspect(scenario, seed=2, question=Question(contrasts=(1.0,)), replicates=19)
    assert found.assessment is not None
    assert "law of still places" in found.assessment.refusals[0]
    assert any("depends on the tiles around it" in word for word in found.assessment.refusals)
    # The control: a wrong law of a sensor that feels the tile below alone is refused without that reason.
    alone = preset("optimised-places").with_values({"floor.source": "random:0.08", "run.t_end_s": 300.0})
    wrong = alone.with_values({"sensor.still_scale": 1.5})
    found = inspect(wrong, seed=2, laws=alone, question=Question(contrasts=(1.0,)), replicates=19)
    assert found.assessment is not None
    assert "law of still places" in found.assessment.refusals[0]
    assert not any("depends on the tiles around it" in word for word in found.assessment.refusals)
