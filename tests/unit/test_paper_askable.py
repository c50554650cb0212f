"""What a column cannot ask is found from its sensor and its floors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from vibroswarm.paper.cells import CellResults
from vibroswarm.paper.columns import real_floor, scenario_of
from vibroswarm.paper.item import Settings, Work, cannot_ask
from vibroswarm.simulation import simulate


@pytest.mark.parametrize(
    ("column", "floor", "reason"),
    [
        ("paper", "random:0.48", None),
        ("paper", "random:0.52", None),
        ("paper", "alternating:0.48", None),
        ("text", "random:0.48", None),
        ("text", "random:0.52", "wrong side"),
        ("text", "random:0.56", "wrong side"),
        ("calibrated", "random:0.48", None),
        ("calibrated", "random:0.52", None),
        ("calibrated", "stripe:0.46", "tiles of 200 mm; these have 100 mm"),
        ("calibrated", "alternating:0.48", "tiles of 200 mm"),
    ],
)
def test_reasons(column: str, floor: str, reason: str | None) -> None:
    found = cannot_ask(scenario_of(column, {"floor.source": floor}))
    assert (found is None) if reason is None else (found is not None and reason in found)


@pytest.mark.parametrize("column", ["paper", "calibrated"])
def test_the_physics_asks_on_tiles_as_large_as_those_that_it_was_fitted_on(column: str) -> None:
    for floor in ("random:0.48", "random:0.52"):
        assert cannot_ask(scenario_of(column, {"floor.source": floor}, control="physics")) is None
    small = cannot_ask(scenario_of(column, {"floor.source": "stripe:0.46"}, control="physics"))
    assert small == "the physics of vibration was fitted on tiles of 200 mm; these have 100 mm"


def test_an_edge_that_reaches_nowhere_leaves_the_side_to_decide() -> None:
    values = {"floor.source": "alternating:0.48", "sensor.edge_reach_m": 0.0}
    assert cannot_ask(scenario_of("calibrated", values)) is None
    assert cannot_ask(scenario_of("text", real_floor() | {"sensor.rms_threshold": 1.33})) is not None


@pytest.mark.parametrize(("column", "fill"), [("text", 0.52), ("paper", 0.52), ("calibrated", 0.52)])
def test_the_side_is_that_of_simulated_readings(column: str, fill: float) -> None:
    """Ones of all robots over 60 runs: their mean is clearly on the side that decides whether it can be asked."""
    scenario = scenario_of(column, {"floor.source": f"random:{fill}"})
    found = simulate(scenario, 3, 60, energies=False).observations
    ones = found.group_by("run").agg(pl.col("observation").mean())["observation"].to_numpy()
    error = ones.std(ddof=1) / np.sqrt(ones.size)
    right = ones.mean() > 0.5
    assert abs(ones.mean() - 0.5) > 2 * error
    assert (cannot_ask(scenario) is None) == right


def test_a_negative_control_is_no_reason_not_to_ask() -> None:
    """With swapped labels every floor leans to the wrong side: that is what the control shows."""
    plain, control = Settings(columns=("paper",)), Settings(columns=("paper",), control="labels")
    cells = {
        name: one.cell("paper", {"floor.source": "random:0.48"})
        for name, one in (("p", plain), ("c", control))
    }
    assert cannot_ask(cells["c"].scenario) is not None
    work = Work(control, {"x": cells["c"]}, CellResults(1, 1, {}), Path(), plain={"x": cells["p"]})
    assert work.cannot("x") is None
    assert Work(plain, {"x": cells["c"]}, CellResults(1, 1, {}), Path()).cannot("x") is not None
