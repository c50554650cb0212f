"""A run is the beginning of the same run that goes on longer; studies make use of it."""

from __future__ import annotations

import pytest

from vibroswarm import preset
from vibroswarm.motion.source import moved
from vibroswarm.study.batch import beginning
from vibroswarm.study.runs import groups_of
from vibroswarm.study.spec import Study

RUNS = list(range(5))


@pytest.mark.parametrize(
    ("name", "motion"),
    [("paper", "event"), ("calibrated", "event"), ("text", "event"), ("paper", "fixed-step")],
)
def test_the_beginning_of_a_longer_motion_is_the_shorter_one(name: str, motion: str) -> None:
    """Ends at, just before and just after samples and the stops for them, and off the ticks."""
    longer = preset(name).with_values({"swarm.robots": 6, "run.t_end_s": 120.0})
    whole = moved(motion, longer, 1, RUNS)
    some = whole.samples.filter((whole.samples["run"] == 3) & (whole.samples["time_s"] > 60.0))
    moments = [time_s for column in ("time_s", "stop_start_s") for time_s in some[column].to_list()[:3]]
    for moment in moments:
        for shift in (-0.02, -0.01, 0.0, 0.02, 0.04):
            shorter = longer.with_values({"run.t_end_s": round(moment + shift, 4)})
            own, cut = moved(motion, shorter, 1, RUNS), beginning(whole, shorter)
            assert cut.samples.equals(own.samples)
            known = ["run", "robot", "end_s", "stop_start_s"]
            assert cut.ends.select(known).equals(own.ends.select(known)), (moment, shift)


@pytest.mark.slow
def test_cells_of_several_ends_share_motion_and_come_out_as_alone() -> None:
    varied = {"grid": {"run.t_end_s": [150.0, 333.33, 400.0], "strategy.name": ["none", "soft"]}}
    base = preset("paper").with_values(
        {"decision.min_observations": 50, "network.name": "loss", "network.loss.share": 0.05}
    )
    study = Study(base, varied, runs=6)
    assert len(groups_of(study.cells)) == 1
    together = study.run()
    for cell in study.cells:
        alone = Study(cell.scenario, runs=6).run()
        for one, other in zip(together.tables(cell), alone.tables(alone.cells[0]), strict=True):
            assert one.equals(other), cell.name
