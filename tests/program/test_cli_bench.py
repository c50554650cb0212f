"""``vibroswarm bench`` as a user meets it; nothing here asserts a speed."""

from __future__ import annotations

import json

import pytest

from vibroswarm.cli import main, stage_timing
from vibroswarm.cli.pymunk_walk import pymunk_version, pymunk_walk

SMALL = ["--robots", "2", "--runs", "1"]
FIGURE = {
    "work", "robots", "arena_side_m", "simulated_s_a_run", "cpu_ms_a_run", "cpu_ms_a_run_least",
    "cpu_ms_a_run_most", "simulated_s_per_cpu_s", "cpu_us_a_robot_second", "ratio_to_fixed_step",
}  # fmt: skip
STAGES = [
    "observation", "inference, every sample", "inference, outcomes only",
    "motion and 1 strategy", "motion and 34 strategies",
]  # fmt: skip


def test_json_is_one_document_with_all_figures(capsys):
    assert main(["bench", *SMALL, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [figure["work"] for figure in told["figures"]] == ["event", "fixed-step", *STAGES]
    for figure in told["figures"]:
        assert set(figure) == FIGURE
        assert 0 < figure["cpu_ms_a_run_least"] <= figure["cpu_ms_a_run"] <= figure["cpu_ms_a_run_most"]
        assert figure["robots"] == 2
        speed = 1000 * figure["simulated_s_a_run"] / figure["cpu_ms_a_run"]
        assert figure["simulated_s_per_cpu_s"] == pytest.approx(speed)
        assert figure["cpu_us_a_robot_second"] == pytest.approx(1e6 / speed / 2)
    event, stepped, *stages = told["figures"]
    assert event["ratio_to_fixed_step"] > 0
    assert stepped["ratio_to_fixed_step"] == 1
    assert all(figure["ratio_to_fixed_step"] is None for figure in stages)
    assert told["grid_of_34_strategies_ratio"] > 0
    assert told["machine"]["cpu"]
    assert told["machine"]["cores"] >= 1
    assert told["versions"]["numba"]
    assert (told["preset"], told["turns"], told["runs_a_turn"]) == ("paper-empirical", 7, 1)
    assert told["missing_peers"] == {}


def test_the_text_says_how_and_on_what(capsys):
    assert main(["bench", *SMALL]) == 0
    said = capsys.readouterr().out
    assert "CPU time of one process" in said
    assert stage_timing.cpu_model() in said
    assert "numba" in said
    assert "motion, 2 robots in 1 m x 1 m" in said
    assert "34 strategies" in said


def test_many_robots_get_room_less_time_and_a_comparison():
    report = stage_timing.measure([30], 1)
    sides = {(figure.robots, figure.side_m, figure.simulated_s) for figure in report.figures}
    assert sides == {(30, 2.5, 400.0), (10, 1.4, 1200.0)}


@pytest.mark.parametrize(("robots", "side_m", "end_s"), [(5, 1.0, 1200), (100, 4.5, 120), (1000, 14.0, 12)])
def test_sizes(robots, side_m, end_s):
    scenario = stage_timing.scenario_of(robots)
    assert (scenario.arena.width_m, scenario.arena.height_m, scenario.run.t_end_s) == (side_m, side_m, end_s)


def test_a_peer_that_is_not_there_is_said(capsys, monkeypatch):
    monkeypatch.setattr(stage_timing, "pymunk_version", lambda: None)
    assert main(["bench", *SMALL, "--peers"]) == 0
    assert "pymunk is not installed: pip install 'vibroswarm[bench]'" in capsys.readouterr().out


@pytest.mark.skipif(pymunk_version() is None, reason="pymunk is an extra")
class TestPymunk:
    def test_it_is_measured_beside_the_engines(self, capsys):
        assert main(["bench", *SMALL, "--peers", "--json"]) == 0
        told = json.loads(capsys.readouterr().out)
        peer = told["figures"][2]
        assert peer["work"] == "pymunk"
        assert peer["ratio_to_fixed_step"] > 0
        assert told["versions"]["pymunk"] == pymunk_version()

    def test_it_walks_as_the_engines_do(self):
        """Its robots sample about as often as the event engine's, so the work is the same."""
        scenario = stage_timing.scenario_of(5).with_values({"run.t_end_s": 100.0})
        expected = stage_timing.source("event").batch(scenario, 1, range(4), False).samples.height / 4
        assert pymunk_walk(scenario, 1, 100.0) == pytest.approx(expected, rel=0.15)


BAD = {
    "--robots 0": ("--robots", "0 is not from 1 to 10000"),
    "--robots 5,x": ("--robots", "'x' is not a whole number"),
    "--robots 5,": ("--robots", "'' is not a whole number"),
    "--robots 10001": ("--robots", "10001 is not from 1 to 10000"),
    "--runs x": ("--runs", "'x' is not a whole number"),
    "--runs 0": ("--runs", "0 is not from 1"),
    "--run 3": ("unrecognized arguments: --run", "did you mean '--runs'?"),
}


@pytest.mark.parametrize("line", BAD)
def test_bad_input_is_said_in_one_message(line, capsys):
    try:
        code = main(["bench", *line.split()])
    except SystemExit as error:
        code = error.code
    assert code == 2
    said = capsys.readouterr()
    assert said.out == ""
    for part in BAD[line]:
        assert part in said.err
