"""What Python may be given: NumPy's whole numbers are taken, everything else is refused in words."""

# Wrong types are what these tests give:
# mypy: disable-error-code="arg-type"

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from vibroswarm import Floor, Result, StudyResult, inspect, make_floor, measure, pose, replay, write_run_page
from vibroswarm.analysis.decidability import mending_thresholds, samples_needed
from vibroswarm.analysis.verdict import verdict
from vibroswarm.calibrate.dataset import dataset_of
from vibroswarm.calibrate.fit import fit
from vibroswarm.calibrate.real_vs_simulated import compare, write_comparison_pictures
from vibroswarm.errors import InputError
from vibroswarm.floors import read_tiles
from vibroswarm.inspection.missed import plan
from vibroswarm.inspection.pod import fit_pod
from vibroswarm.inspection.stopping import Question
from vibroswarm.optimize.grid import Grid
from vibroswarm.optimize.loop import run_search
from vibroswarm.optimize.objective import Objective
from vibroswarm.optimize.pso import PsoSettings
from vibroswarm.optimize.scenario_comparison import compare_scenarios
from vibroswarm.optimize.space import Space
from vibroswarm.optimize.spec import Search, SearchSettings
from vibroswarm.plots import draw_belief, draw_density, draw_error_bars, draw_heat, draw_outcomes, draw_run
from vibroswarm.recordings.export import write_csv, write_webots
from vibroswarm.recordings.log_readers import read_log
from vibroswarm.recordings.recording import Recording, read_result
from vibroswarm.recordings.replay import replay_recording, with_beliefs
from vibroswarm.recordings.threshold import find_thresholds
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import check_runs, simulate
from vibroswarm.study.precision import Precision
from vibroswarm.study.run import merge
from vibroswarm.study.spec import Study
from vibroswarm.testing import check_network, check_task

SHORT = {"run.t_end_s": 20.0, "swarm.robots": 2}


def str_of(value: Any) -> str:
    return type(value).__name__


HUGE = 10**5000
"""More digits than Python turns into text."""


@pytest.fixture(scope="module")
def short() -> Scenario:
    return preset("paper").with_values(SHORT)


@pytest.mark.parametrize("seed", [1.5, "1", None, True, -1, 2**63, HUGE, [1], np.float64(1.0)], ids=str_of)
def test_a_seed_is_a_whole_number(short: Scenario, seed: Any) -> None:
    with pytest.raises(InputError, match=r"^seed: ") as caught:
        simulate(short, seed)
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize("runs", [0, -1, 1.5, "2", None, True, [], [1, 1], [0.5], ["a"], [-1], [2**32], HUGE, [HUGE],
                                  10**12, {1: 2}.items()], ids=str_of)  # fmt: skip
def test_runs_are_whole_numbers(short: Scenario, runs: Any) -> None:
    with pytest.raises(InputError, match=r"^runs: ") as caught:
        simulate(short, 1, runs)
    assert len(str(caught.value)) < 200


def test_whole_numbers_of_numpy_are_taken(short: Scenario) -> None:
    assert check_runs(np.uint64(2**62), np.int64(2)) == [0, 1]
    assert check_runs(1, np.array([3, 1])) == [1, 3]
    one, other = simulate(short, np.int64(3), np.int64(2)), simulate(short, 3, 2)
    assert one == other
    assert Study(short, {}, np.int64(5)).runs == 5
    values = {"swarm.robots": np.int64(4), "decision.revise": np.bool_(True), "strategy.name": "soft"}
    plain = {"swarm.robots": 4, "decision.revise": True, "strategy.name": "soft"}
    assert short.with_values(values) == short.with_values(plain)


OF_NUMPY: dict[str, Callable[[Any, Any], Any]] = {
    "Scenario.from_values": lambda whole, real: Scenario.from_values(
        {"swarm": {"robots": whole(2)}, "walk": {"leg_min_ms": real(0.5)}, "rays": {"side_m": [real(0.25)] * 3}}
    ).to_toml(),
    "Study": lambda whole, real: Study(
        {"swarm": {"robots": whole(3)}},
        {
            "grid": {"decision.min_observations": {"from": whole(2), "to": whole(4), "steps": whole(3)}},
            "list": [{"decision.credible_threshold": real(0.75)}],
        },
        runs=whole(2),
        seed=whole(4),
    ).to_toml(),
    "Precision": lambda whole, real: Study({}, until=Precision(real(0.25), level=real(0.75)), runs=None).to_toml(),
    "Question": lambda whole, real: repr(vars(Question(least_m=real(0.25), contrasts=(whole(1), real(0.5))))),
    "a search": lambda whole, real: Search(
        space=Space.of(
            {"decision.min_observations": {"from": whole(2), "to": whole(9)}, "swarm.robots": [whole(2), 3]}
        ),
        objectives=(Objective("errors", parameters={"miss": real(0.5)}),),
        settings=SearchSettings(budget=whole(5000), fresh=whole(10)),
        pso=PsoSettings(inertia_first=real(0.75)),
    ).to_toml(),
}  # fmt: skip


@pytest.mark.parametrize("call", OF_NUMPY)
def test_numbers_of_numpy_are_written_as_those_of_python(call: str) -> None:
    made = OF_NUMPY[call]
    assert made(np.int64, np.float32) == made(np.uint16, np.float64) == made(int, float)


@pytest.mark.parametrize("scenario", ["paper", None, {}, 5])
def test_a_scenario_is_one(scenario: Any) -> None:
    with pytest.raises(InputError, match=r"^scenario: "):
        simulate(scenario)


@pytest.mark.parametrize("motion", [None, 5, ["event"]])
def test_a_source_of_motion_is_a_name(short: Scenario, motion: Any) -> None:
    with pytest.raises(InputError, match=r"^motion: "):
        simulate(short, motion=motion)


def test_the_verdict_is_on_the_run_that_there_is(short: Scenario) -> None:
    result = simulate(short, 1, [5])
    assert verdict(result) == verdict(result, 5)
    for run in (0, "x", 10**5000):
        with pytest.raises(InputError, match=r"^run: there is no run"):
            verdict(result, run)
    with pytest.raises(InputError, match=r"^run: there is no run 0"):
        result.check(0)


@pytest.mark.parametrize("field", ["swarm.robots", "run.t_end_s", "floor.source", "rays.side_m"])
def test_numbers_of_thousands_of_digits_are_refused_in_a_scenario(field: str) -> None:
    with pytest.raises(InputError, match=field.replace(".", r"\."), check=lambda e: len(str(e)) < 300):
        preset("paper").with_values({field: HUGE})


WRONG: tuple[Any, ...] = (5, 1.5, True, b"x", [1], object(), HUGE)
"""Neither text nor None nor a table, wherever one of these is asked for."""

CALLS = {
    "preset": lambda x, r: preset(x),
    "Scenario.from_values": lambda x, r: Scenario.from_values(x),
    "Scenario.from_toml": lambda x, r: Scenario.from_toml(x),
    "Scenario.from_base": lambda x, r: Scenario.from_base(x),
    "Scenario.read": lambda x, r: Scenario.read(x),
    "Scenario.with_values": lambda x, r: r.scenario.with_values(x),
    "Scenario[]": lambda x, r: r.scenario[x],
    "simulate": lambda x, r: simulate(r.scenario, progress=x),
    "replay": lambda x, r: replay(x, r.scenario),
    "verdict": lambda x, r: verdict(x),
    "write_run_page": lambda x, r: write_run_page(x, "page.html"),
    "write_run_page path": lambda x, r: write_run_page(r, x),
    "pose": lambda x, r: pose(x, 0, 0, [1.0]),
    "Result.read": lambda x, r: Result.read(x),
    "Result.write": lambda x, r: r.write(x),
    "Study vary": lambda x, r: Study(r.scenario, x),
    "Study name": lambda x, r: Study(r.scenario, name=x),
    "Study folder": lambda x, r: Study(r.scenario, folder=x),
    "Study.from_toml": lambda x, r: Study.from_toml(x),
    "Study.from_values": lambda x, r: Study.from_values(x),
    "Study.read": lambda x, r: Study.read(x),
    "Study.run": lambda x, r: Study(r.scenario).run(x),
    "Study.run executor": lambda x, r: Study(r.scenario).run(executor=x),
    "Study.run job": lambda x, r: Study(r.scenario).run(job=x),
    "StudyResult.open": lambda x, r: StudyResult.open(x),
    "inspect": lambda x, r: inspect(x),
    "inspect run": lambda x, r: inspect(r, run=[x]),
    "inspect seed": lambda x, r: inspect(r.scenario, seed=[x]),
    "inspect laws": lambda x, r: inspect(r, laws=x),
    "inspect bits": lambda x, r: inspect(r, bits="x" if x is True else x),
    "inspect floor": lambda x, r: inspect(r, floor=x),
    "inspect size": lambda x, r: inspect(r, size_m=x),
    "inspect spreads": lambda x, r: inspect(r, spreads=x),
    "inspect question": lambda x, r: inspect(r, question=x),
    "inspect shapes": lambda x, r: inspect(r, shapes=x),
    "inspect looks": lambda x, r: inspect(r, looks=[x]),
    "inspect replicates": lambda x, r: inspect(r, replicates=[x]),
    "inspect sizes": lambda x, r: inspect(r, sides_m=[[x]], question=Question()),
    "Question": lambda x, r: Question(least_m=[x]),
    "Question contrasts": lambda x, r: Question(contrasts=x),
    "Question risk": lambda x, r: Question(risk=[x]),
    "Question strict": lambda x, r: Question(strict=[x]),
    "plan": lambda x, r: plan(x, [3], [60.0]),
    "plan robots": lambda x, r: plan(r.scenario, [[x]], [60.0]),  # type: ignore[list-item]
    "inspect spread": lambda x, r: inspect(r, spread_m=[x]),
    "Scenario.from_toml folder": lambda x, r: Scenario.from_toml("", folder=x),
    "Result.check": lambda x, r: r.check([x]),
    "verdict run": lambda x, r: verdict(r, np.zeros(2)),
    "write_run_page run": lambda x, r: write_run_page(r, "page.html", [x]),
    "Study.of_scenarios base": lambda x, r: Study.of_scenarios({"a": r.scenario}, base=x),
    "a choice": lambda x, r: Study(r.scenario, runs=1).run().to_xarray(np.zeros(2)),
    "plot": lambda x, r: Study(r.scenario, runs=1).run().plot([x]),
    "Objective statistic": lambda x, r: Objective(statistic=x),
    "Objective parameters": lambda x, r: Objective(parameters=x),
    "Search study": lambda x, r: Search(study=r.scenario if x == 5 else x),
    "Search space": lambda x, r: Search(space=x),
    "Search objectives": lambda x, r: Search(objectives=Objective() if x == 5 else x),
    "Search settings": lambda x, r: Search(settings=x),
    "Search pso": lambda x, r: Search(pso=x),
    "Search.from_toml": lambda x, r: Search.from_toml(x),
    "Search.read": lambda x, r: Search.read(x),
    "run_search": lambda x, r: run_search("search.toml" if x == 5 else x),
    "run_search folder": lambda x, r: run_search(Search(), x),
    "compare_scenarios": lambda x, r: compare_scenarios(r.scenario, x),
    "compare_scenarios seed": lambda x, r: compare_scenarios(r.scenario, r.scenario, seed=[x]),
    "draw_belief": lambda x, r: draw_belief(x),
    "draw_error_bars": lambda x, r: draw_error_bars(x),
    "draw_heat": lambda x, r: draw_heat(x),
    "draw_outcomes": lambda x, r: draw_outcomes(pl.LazyFrame({"cell": ["a"]}) if x == 5 else x),
    "write_csv": lambda x, r: write_csv(r, x),
    "write_webots": lambda x, r: write_webots(r, x),
    "write_webots run": lambda x, r: write_webots(r, "log.txt", [x]),
    "replay_recording": lambda x, r: replay_recording(r if x == 5 else x, r.scenario),
    "with_beliefs": lambda x, r: with_beliefs(r if x == 5 else x),
    "find_thresholds": lambda x, r: find_thresholds(r if x == 5 else x),
    "compare": lambda x, r: compare(r, "a folder" if x == 5 else x),
    "write_comparison_pictures": lambda x, r: write_comparison_pictures(r, r, r, x),
    "dataset_of": lambda x, r: dataset_of(r if x == 5 else x),
    "Recording.read": lambda x, r: Recording.read(x),
    "read_result": lambda x, r: read_result(x),
    "read_log": lambda x, r: read_log(x),
    "Grid.read": lambda x, r: Grid.read(x),
    "read_tiles": lambda x, r: read_tiles(x),
    "Picture.write": lambda x, r: draw_run(r).write(x),
    "check_network": lambda x, r: check_network("lost" if x == 5 else x),
    "check_task": lambda x, r: check_task("lost" if x == 5 else x),
    "fit": lambda x, r: fit([r] if x == 5 else x, r.scenario),
}  # fmt: skip


@pytest.fixture(scope="module")
def ran(short: Scenario) -> Result:
    return simulate(short, 1, 1, segments=True)


@pytest.mark.parametrize("call", CALLS)
def test_wrong_types_are_refused_in_words(
    call: str, ran: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for value in WRONG:
        with pytest.raises(InputError) as caught:
            CALLS[call](value, ran)
        assert len(str(caught.value)) < 300
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "value", [None, "x", b"x", [1], {}, object(), HUGE, float("nan"), float("inf")], ids=str_of
)
def test_sizes_and_numbers_out_of_range_are_refused(value: Any, ran: Result) -> None:
    calls = [
        lambda: Floor([[1]], value, 1.0),
        lambda: Floor([[1]], 1.0, 1.0, value),
        lambda: Floor.filling([[1]], value),
        lambda: ran.floor().fill_ratio_within(value, 1.0),
        lambda: ran.floor(value),
        lambda: pose(ran.segments, value, 0, [1.0]),
        lambda: pose(ran.segments, 0, value, [1.0]),
        lambda: ran.scenario.floor_for(value, 0),
        lambda: ran.scenario.floor_for(0, value),
        lambda: measure(value),
        lambda: measure([[1, 0]], [["x"]] if value is None else value),
        lambda: make_floor(value, 4, 0.5, 0.0),
        lambda: make_floor(4, 4, value, 0.0),
        lambda: make_floor(4, 4, 0.5, value),
        lambda: make_floor(4, 4, 0.5, 0.0, "x" if value is None else value),
        lambda: make_floor(4, 4, 0.5, 0.0, None, value),
        lambda: Study.of(ran.scenario, strategy__name=value) if value != [1] else Study.of(ran.scenario, value),
    ]  # fmt: skip
    for call in calls:
        with pytest.raises(InputError) as caught:
            call()
        assert len(str(caught.value)) < 300


def test_values_without_an_order_are_refused(short: Scenario) -> None:
    """Cells, and so the folder's hash, depended on the order of a set, which differs from process to process."""
    for values in ({"none", "soft"}, frozenset({"none", "soft"})):
        with pytest.raises(InputError, match=r"^strategy\.name: .*is not a list of values"):
            Study.of(short, strategy__name=values)


def test_what_is_missing_is_named(ran: Result) -> None:
    sizes = np.repeat([0.1, 0.2, 0.3], 10)
    for field, call in {
        "segments": lambda: pose(ran.motion, 0, 0, [1.0]),
        "progress": lambda: inspect(ran, progress=True),
        "half_width": lambda: Precision("2%"),  # it was told to give a percentage such as 2%
        "shares": lambda: merge(Path("all"), []),
        "cases": lambda: compare_scenarios(ran.scenario, ran.scenario, cases=[]),
        "curves": lambda: fit_pod(sizes, sizes > 0.1, 0, 10, curves=["linear"]),
        "false": lambda: fit_pod(sizes, sizes > 0.1, 11, 10),
        "boundary": lambda: mending_thresholds(ran.scenario.sensor, 0.4, -1.0),  # it searched without end
        "share": lambda: samples_needed(1.5, 0.5),
    }.items():
        with pytest.raises(InputError, match=f"^{field}: "):
            call()


def test_density_of_tiles_in_lists() -> None:
    places = pl.DataFrame({"x_m": [0.1, 0.2], "y_m": [0.3, 0.4], "count": [1, 2]})
    drawn = draw_density(places, tiles=[[1, 0], [0, 1]])
    assert drawn.svg() == draw_density(places, tiles=np.array([[1, 0], [0, 1]], dtype=np.uint8)).svg()
    with pytest.raises(InputError, match=r"^count: .*0 or more"):
        draw_density(places.with_columns(count=pl.Series([-1, 2])))
    with pytest.raises(InputError, match=r"^width_m: the arena needs an area"):
        draw_density(places, width_m=float("nan"))


def test_numbers_of_numpy_are_sizes() -> None:
    assert Floor.filling([[1, 0]], np.float32(2.0)).tile_width_m == 1.0


@pytest.mark.parametrize("count", [0, -1, 1.5, "2", HUGE], ids=str_of)
def test_workers_are_a_whole_number(short: Scenario, count: Any) -> None:
    """Thousands of digits once started threads without end."""
    with pytest.raises(InputError, match=r"^workers: "):
        Study(short).run(workers=count)


def test_an_unknown_argument_of_run_is_named(short: Scenario) -> None:
    with pytest.raises(InputError, match=r"^worker: .*did you mean 'workers'"):
        Study(short).run(worker=2)


FLAGS = {
    "segments": lambda x, r, out: simulate(r.scenario, segments=x),
    "energies": lambda x, r, out: simulate(r.scenario, energies=x),
    "replace": lambda x, r, out: r.write(out, replace=x),
    "replace ": lambda x, r, out: write_webots(r, out, replace=x),
    "bits": lambda x, r, out: inspect(r, bits=x),
    "allow_failures": lambda x, r, out: Study(r.scenario, runs=1).run(out, allow_failures=x),
    "equal_error": lambda x, r, out: Study(r.scenario, runs=1).run().compare(equal_error=x),
}  # fmt: skip


@pytest.mark.parametrize("flag", FLAGS)
def test_flags_are_true_or_false(flag: str, ran: Result, tmp_path: Path) -> None:
    """A text such as "no" was true: ``replace="no"`` replaced."""
    for value in ("no", 1, None, [], np.array([True])):
        with pytest.raises(InputError, match=rf"^{flag.strip()}: .*give True or False"):
            FLAGS[flag](value, ran, tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_flags_of_numpy_are_taken(short: Scenario) -> None:
    assert simulate(short, segments=np.bool_(True)).segments is not None
