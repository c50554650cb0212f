"""Results on disk: written and read without loss, whole or not at all, and refused when damaged."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from helpers.commands import printed_by
from vibroswarm import strategies
from vibroswarm.core.folders import FORMAT
from vibroswarm.errors import InputError, RunError
from vibroswarm.inference.reports import REPORTS
from vibroswarm.motion.source import FAILURES
from vibroswarm.result import TABLES, Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate, versions

SHORT: dict[str, Any] = {
    "run.t_end_s": 60.0,
    "decision.min_observations": 10,
    "decision.credible_threshold": 0.7,
    "change.at_s": 30,
    "change.to": "invert",
}


@pytest.fixture(scope="module")
def result() -> Result:
    """Two runs out of order, with everything."""
    scenario = Scenario().with_values({**SHORT, "faults.stuck_at_1": [2], "localisation.method": "mixture"})
    simulated = simulate(scenario, 2**62 + 1, [4, 2**31], segments=True, moves=True)
    assert simulated.failures is None  # only simulators of physics fail
    return replace(
        simulated,
        failures=pl.DataFrame([(4, 59.0, "for a test")], schema=FAILURES, orient="row"),
        reports=pl.DataFrame(
            [(4, 0, 0, "trust", 0, 0.5), (4, 0, 1, "trust", 0, math.inf)], schema=REPORTS, orient="row"
        ),
    )


@pytest.fixture(scope="module")
def other() -> Result:
    """One run, with less."""
    return simulate(Scenario().with_values(SHORT), 9)


@pytest.fixture(scope="module")
def written(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result on disk, in a folder whose name is not a plain word."""
    path = tmp_path_factory.mktemp("written") / "two runs, über 60 s"
    result.write(path)
    return path


@pytest.fixture
def folder(written: Path, tmp_path: Path) -> Path:
    """A copy of the folder."""
    return Path(shutil.copytree(written, tmp_path / written.name))


def without_leftovers(path: Path) -> bool:
    """Whether nothing but ``path`` itself stands in its folder."""
    return [p for p in path.parent.iterdir() if p != path] == []


def test_reading_gives_back_an_equal_result(result: Result, written: Path) -> None:
    again = Result.read(written)
    assert again == result
    assert again.same_tables(result)
    assert (again.seed, again.scenario.hash, again.source) == (2**62 + 1, result.scenario.hash, result.source)
    assert dict(again.versions) == versions()
    assert Result.read(str(written)) == result
    assert without_leftovers(written)


QUICK = ("places", "dc")
"""Strategies whose messages, posteriors or beliefs are not those of the study; all others take longer to compile."""


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[] if n in QUICK else pytest.mark.slow) for n in strategies.known()]
)
def test_a_result_of_every_strategy_is_read_back(name: str, tmp_path: Path) -> None:
    """Many have no posterior, no belief, or messages without a bit: their columns are null."""
    simulated = simulate(Scenario().with_values({"strategy.name": name, "run.t_end_s": 40.0}), 1, 1)
    simulated.write(tmp_path / "one")
    assert Result.read(tmp_path / "one").same_tables(simulated)


CHANGED = {"strategy.name": "reset", "strategy.reset.tells_change": True, "task.name": "changed"}


@pytest.mark.parametrize(
    "values",
    [
        {"faults.radio_dead": [1], "faults.radio_dead_from_s": 30.0},
        pytest.param({**SHORT, **CHANGED}, marks=pytest.mark.slow),
        {"floor.values": [[0.0, 0.5], [1.0, 0.25]], "floor.source": "a file that is gone.csv"},
    ],
    ids=["no messages", "no belief", "values of a file"],
)
def test_a_result_that_lacks_something_is_read_back(values: dict[str, Any], tmp_path: Path) -> None:
    simulated = simulate(Scenario().with_values({"run.t_end_s": 60.0, **values}), 1, 1)
    simulated.write(tmp_path / "one")
    assert Result.read(tmp_path / "one") == simulated


def test_equality_sees_every_part(result: Result) -> None:
    """Negative control of the test above."""
    others = [
        replace(result, seed=result.seed + 1),
        replace(result, source="fixed-step"),
        replace(result, versions={}),
        replace(result, scenario=result.scenario.with_values({"run.t_end_s": 61.0})),
        replace(result, segments=None),
        replace(result, motion=result.motion.reverse()),
        replace(result, inference=result.inference.with_columns(pl.col("belief_below") + 1e-16)),
        replace(result, observations=result.observations.cast({"energy": pl.Float64})),
        replace(result, floors=result.floors.with_columns(name=pl.lit("other"))),
    ]
    assert [other == result for other in others] == [False] * len(others)
    assert result == replace(result)
    assert result != "a result"


def test_without_segments_and_energies(tmp_path: Path) -> None:
    result = simulate(Scenario().with_values(SHORT), 3, energies=False)
    assert result.segments is None
    result.write(tmp_path / "r")
    assert not (tmp_path / "r" / "segments.parquet").exists()
    again = Result.read(tmp_path / "r")
    assert again == result
    assert again.segments is None
    assert again.observations["energy"].is_null().all()


def test_a_run_in_which_nobody_sampled(tmp_path: Path) -> None:
    result = simulate(Scenario().with_values({"run.t_end_s": 0.5, "localisation.method": "mixture"}), 3)
    assert result.motion.height == 0
    assert result.places is not None
    assert result.places.height == 0
    assert result.robots.height == 5
    result.write(tmp_path / "r")
    assert Result.read(tmp_path / "r") == result


def test_each_table_says_what_it_is_of(result: Result, written: Path) -> None:
    """Scenario, seed and versions stand in each Parquet file's own metadata."""
    for name in TABLES:
        metadata = pl.read_parquet_metadata(written / f"{name}.parquet")
        about = json.loads(metadata["vibroswarm"])
        assert about["seed"] == result.seed
        assert about["versions"] == versions()
        assert about["scenario_hash"] == result.scenario.hash
        assert Scenario.from_toml(metadata["scenario"]) == result.scenario


def test_the_folder_holds_the_scenario(result: Result, written: Path) -> None:
    assert Scenario.read(written / "scenario.toml") == result.scenario
    assert sorted(p.name for p in written.iterdir()) == sorted(
        ["scenario.toml", "vibroswarm.json", *(f"{name}.parquet" for name in TABLES)]
    )


def test_versions_name_what_made_the_result() -> None:
    assert {"vibroswarm", "numpy", "numba", "scipy", "polars", "python", "architecture", "code"} <= set(
        versions()
    )
    assert all(versions().values())


@pytest.mark.skipif(
    not versions()["architecture"].endswith("X86_V3"), reason="needs an x86 processor with AVX2"
)
def test_versions_tell_processors_apart_that_round_otherwise() -> None:
    """NumPy's exp and log have other last bits with other vector instructions."""
    program = "from vibroswarm.simulation import versions; print(versions()['architecture'])"
    without = printed_by(program, NPY_DISABLE_CPU_FEATURES="X86_V3 X86_V4")
    assert without.strip() != versions()["architecture"]
    assert without.startswith(versions()["architecture"].split()[0])


def test_the_floor_of_each_run_comes_back(result: Result, written: Path) -> None:
    again = Result.read(written)
    for run in (4, 2**31):
        floor = result.scenario.floor_for(result.seed, run)
        assert again.floor(run) == floor
        assert again.floor(run).name == floor.name
    assert again.floor(4) != again.floor(2**31)
    with pytest.raises(InputError, match="no run 5"):
        again.floor(5)


def test_a_floor_with_a_place_of_its_own_comes_back() -> None:
    values = SHORT | {
        "floor.tiles": ["110", "001"],
        "floor.tile_width_m": 0.1,
        "floor.left_m": 0.2,
        "floor.bottom_m": 1 / 3,
    }
    scenario = Scenario().with_values(values)
    assert simulate(scenario, 1).floor(0) == scenario.floor_for(1, 0)


# What is there already


def test_an_existing_folder_is_refused(result: Result, folder: Path) -> None:
    before = (folder / "vibroswarm.json").stat().st_mtime_ns
    with pytest.raises(InputError, match="exists already") as caught:
        result.write(folder)
    assert str(folder) in str(caught.value)
    assert (folder / "vibroswarm.json").stat().st_mtime_ns == before
    assert without_leftovers(folder)


@pytest.mark.parametrize("target", ["empty", "folder"])
def test_a_symbolic_link_is_called_one(result: Result, folder: Path, tmp_path: Path, target: str) -> None:
    (tmp_path / "empty").mkdir()
    link = tmp_path / "link"
    link.symlink_to(folder if target == "folder" else tmp_path / "empty")
    with pytest.raises(InputError, match="is a symbolic link; give the name of a folder"):
        result.write(link, replace=True)


def test_a_result_may_be_replaced_and_nothing_else(
    result: Result, other: Result, folder: Path, tmp_path: Path
) -> None:
    other.write(folder, replace=True)
    assert Result.read(folder) == other
    assert not (folder / "segments.parquet").exists()  # nothing of the old one is left in it
    assert without_leftovers(folder)
    foreign = tmp_path / "letters"
    foreign.mkdir()
    (foreign / "letter.txt").write_text("dear", encoding="utf-8")
    with pytest.raises(InputError, match="not a vibroswarm result"):
        result.write(foreign, replace=True)
    assert (foreign / "letter.txt").read_text(encoding="utf-8") == "dear"
    with pytest.raises(InputError, match="is a file"):
        result.write(foreign / "letter.txt", replace=True)


def test_an_empty_folder_is_filled(result: Result, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    result.write(tmp_path / "empty")
    assert Result.read(tmp_path / "empty") == result


# Failure in the middle


class OtherError(Exception):
    """Something else than an error of the disk."""


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), OtherError()])
@pytest.mark.parametrize("replacing", [False, True])
def test_nothing_half_written_is_left(
    result: Result,
    other: Result,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    error: Exception,
    replacing: bool,
) -> None:
    path = tmp_path / "r"
    if replacing:
        other.write(path)
    write, written = Path.write_bytes, []

    def fail_at_the_fourth(self: Path, data: bytes) -> int:
        written.append(self)
        if len(written) == 4:
            raise error
        return write(self, data)

    expected, words = (RunError, "No space left") if isinstance(error, OSError) else (OtherError, None)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", fail_at_the_fourth)
        with pytest.raises(expected, match=words):
            result.write(path, replace=replacing)
    assert len(written) == 4
    if replacing:
        assert Result.read(path) == other
    else:
        assert not path.exists()
    assert without_leftovers(path)


# Damage


@pytest.mark.parametrize("name", sorted(TABLES))
def test_a_missing_table_is_named(folder: Path, name: str) -> None:
    (folder / f"{name}.parquet").unlink()
    with pytest.raises(InputError, match="is missing") as caught:
        Result.read(folder)
    assert caught.value.field == str(folder / f"{name}.parquet")


@pytest.mark.parametrize("name", ["runs", "segments"])  # one that every result has, and one that not
@pytest.mark.parametrize("damage", ["empty", "cut", "text", "foreign"])
def test_a_damaged_table_is_named(folder: Path, name: str, damage: str) -> None:
    path = folder / f"{name}.parquet"
    whole = path.read_bytes()
    if damage == "foreign":
        pl.DataFrame({"a": [1]}).write_parquet(path)
    else:
        path.write_bytes({"empty": b"", "cut": whole[: len(whole) // 2], "text": b"run,robot\n1,2\n"}[damage])
    with pytest.raises(InputError) as caught:
        Result.read(folder)
    assert caught.value.field == str(path)


def test_a_newer_format_is_refused(folder: Path) -> None:
    head = json.loads((folder / "vibroswarm.json").read_text(encoding="utf-8"))
    head["format"] = FORMAT + 1
    (folder / "vibroswarm.json").write_text(json.dumps(head), encoding="utf-8")
    with pytest.raises(InputError, match="update vibroswarm"):
        Result.read(folder)


def test_a_damaged_scenario_is_refused(folder: Path) -> None:
    (folder / "scenario.toml").write_text("[walk]\nleg_min_ms = -3\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"walk\.leg_min_ms"):
        Result.read(folder)
    (folder / "scenario.toml").unlink()
    with pytest.raises(InputError, match=r"scenario\.toml"):
        Result.read(folder)


def test_what_is_no_result_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "nothing", tmp_path / "file"):
        (tmp_path / "file").write_text("x", encoding="utf-8")
        with pytest.raises(InputError, match="is not a run of vibroswarm"):
            Result.read(path)
