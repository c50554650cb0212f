"""``benchmarks/stage_timing.py``, its peer, and ``benchmarks/stage_ratios.py``; nothing here asserts a speed."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

import stage_ratios
import stage_timing
from pymunk_walk import pymunk_version, pymunk_walk
from stage_timing import main
from vibroswarm.strategies import known

FIGURE = {
    "work", "robots", "arena_side_m", "simulated_s_a_run", "cpu_ms_a_run", "cpu_ms_a_run_least",
    "cpu_ms_a_run_most", "simulated_s_per_cpu_s", "cpu_us_a_robot_second", "ratio_to_fixed_step",
}  # fmt: skip
STAGES = [
    "observation", "inference, every sample", "inference, outcomes only",
    "motion and 1 strategy", "motion and 34 strategies",
]  # fmt: skip


@pytest.fixture(scope="module")
def report():
    return stage_timing.measure([2], 1, peers=True)


def test_json_is_one_document_with_all_figures(report):
    told = json.loads(json.dumps(report.as_dict()))
    figures = told["figures"]
    assert [figure["work"] for figure in figures if figure["work"] != "pymunk"] == [
        "event",
        "fixed-step",
        *STAGES,
    ]
    for figure in figures:
        assert set(figure) == FIGURE
        assert 0 < figure["cpu_ms_a_run_least"] <= figure["cpu_ms_a_run"] <= figure["cpu_ms_a_run_most"]
        assert figure["robots"] == 2
        speed = 1000 * figure["simulated_s_a_run"] / figure["cpu_ms_a_run"]
        assert figure["simulated_s_per_cpu_s"] == pytest.approx(speed)
        assert figure["cpu_us_a_robot_second"] == pytest.approx(1e6 / speed / 2)
    ratios = {figure["work"]: figure["ratio_to_fixed_step"] for figure in figures}
    assert ratios["event"] > 0
    assert ratios["fixed-step"] == 1
    assert all(ratios[name] is None for name in STAGES)
    assert told["grid_of_34_strategies_ratio"] > 0
    assert told["machine"]["cpu"]
    assert told["machine"]["cores"] >= 1
    assert told["versions"]["numba"]
    assert (told["preset"], told["turns"], told["runs_a_turn"]) == ("paper-empirical", 7, 1)


def test_the_text_gives_method_and_machine(report, capsys):
    stage_timing.print_report(report)
    said = capsys.readouterr().out
    assert "CPU time of one process" in said
    assert stage_timing.cpu_model() in said
    assert "numba" in said
    assert "motion, 2 robots in 1 m x 1 m" in said
    assert "34 strategies" in said


@pytest.mark.parametrize(("robots", "side_m", "end_s"), [(5, 1.0, 1200), (100, 4.5, 120), (1000, 14.0, 12)])
def test_sizes(robots, side_m, end_s):
    scenario = stage_timing.scenario_of(robots)
    assert (scenario.arena.width_m, scenario.arena.height_m, scenario.run.t_end_s) == (side_m, side_m, end_s)


def test_many_robots_get_a_reference_for_the_cost_of_a_robot_second(monkeypatch):
    """What is measured, without the measuring."""
    measured = []
    monkeypatch.setattr(stage_timing, "compared", lambda scenario, works: measured.append(scenario) or [])
    monkeypatch.setattr(stage_timing, "stages_of", lambda scenario, runs: ([], 1.0))
    stage_timing.measure([30], 1)
    assert [(s.swarm.robots, s.arena.width_m, s.run.t_end_s) for s in measured] == [
        (30, 2.5, 400.0),
        (10, 1.4, 1200.0),
    ]


def test_a_missing_peer_is_named(capsys, monkeypatch):
    monkeypatch.setattr(stage_timing, "pymunk_version", lambda: None)
    monkeypatch.setattr(stage_timing, "compared", lambda scenario, works: [])
    monkeypatch.setattr(stage_timing, "stages_of", lambda scenario, runs: ([], 1.0))
    assert main(["--robots", "2", "--runs", "1", "--peers"]) == 0
    assert "pymunk is not installed: pip install pymunk" in capsys.readouterr().out


@pytest.mark.skipif(pymunk_version() is None, reason="pymunk is not installed")
class TestPymunk:
    def test_it_is_measured_beside_the_engines(self, report):
        peer = report.figures[2]
        assert peer.work == "pymunk"
        assert peer.yardstick > 0
        assert report.versions["pymunk"] == pymunk_version()

    def test_it_walks_as_the_engines_do(self):
        """Its robots sample about as often as the event engine's, so the work is the same."""
        scenario = stage_timing.scenario_of(5).with_values({"run.t_end_s": 100.0})
        expected = stage_timing.source("event").batch(scenario, 1, range(4), False).samples.height / 4
        assert pymunk_walk(scenario, 1, 100.0) == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize("line", ["--robots 0", "--robots 5,x", "--robots 10001", "--runs 0", "--run 3"])
def test_bad_input_is_refused(line, capsys):
    with pytest.raises(SystemExit) as error:
        main(line.split())
    assert error.value.code == 2
    assert line.split()[0] in capsys.readouterr().err


def test_ratios_are_of_every_stage_and_strategy_and_a_loss_is_marked(capsys, monkeypatch, tmp_path):
    """What each task would do is not done."""
    monkeypatch.setattr(stage_ratios, "RECORDED", tmp_path / "ratios.csv")
    done = []
    works = [work for work, runs, call in stage_ratios.tasks()]
    for stage in ("motion, 5 robots", "motion, 100 robots", "observation", "localisation"):
        assert stage in works
    assert {f"inference, {name}" for name in known()} <= set(works)
    assert stage_ratios.recorded() == {}
    ratios = stage_ratios.measure([(work, 2, lambda: done.append(1)) for work in works], turns=1)
    assert len(done) == 2 * len(works)
    assert all(each.least == each.ratio == each.most > 0 for each in ratios)
    stage_ratios.write([replace(each, ratio=1.0) for each in ratios])
    now = [replace(each, ratio=1.3 if each.work == "observation" else 1.05) for each in ratios]
    rows = stage_ratios.compared(now, stage_ratios.recorded())
    assert [row["work"] for row in rows if row["is_loss"]] == ["observation"]
    assert {round(row["change"], 6) for row in rows} == {0.3, 0.05}
    stage_ratios.print_ratios(rows)
    assert "Slower by more than 10 %: observation." in capsys.readouterr().out


def test_every_stage_and_strategy_has_a_recorded_ratio():
    assert set(stage_ratios.recorded()) == {work for work, _, _ in stage_ratios.tasks()}
