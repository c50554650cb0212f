"""``vibroswarm inspect``: its sources, its words, and what it refuses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from helpers.commands import json_of, output_of, words_of
from helpers.documents import ROOT
from vibroswarm import cli, preset, simulate
from vibroswarm.inspection.inspection import inspect
from vibroswarm.observation.energy_model import energy_of

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
