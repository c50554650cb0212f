"""Scenarios whose messages and decisions go every way there is, to compare two accounts of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from hypothesis import strategies as st

from random_scenarios import fitted, random_values
from vibroswarm.robot.walk import TIMERS
from vibroswarm.scenario.scenario import Scenario

RAY_COUNTS = (3, 3, 4)
"""As many as other tests compile engines for, which takes half a minute each; ``random_scenarios`` draws 1 to 9."""
FLOORS: dict[str, dict[str, Any]] = {
    "filling": {},
    "border": {
        "floor.source": "diagonal:0.46",
        "floor.tile_width_m": 0.07,
        "floor.tile_height_m": 0.06,
        "floor.left_m": 0.15,
        "floor.bottom_m": 0.1,
    },
    "cut": {
        "floor.tiles": ["10", "01", "11"],
        "floor.tile_width_m": 0.4,
        "floor.tile_height_m": 0.45,
        "floor.left_m": -0.1,
        "floor.bottom_m": -0.2,
    },
}
FELT: dict[str, dict[str, Any]] = {
    "plain": {},
    "edges": {"sensor.edge_reach_m": 0.01, "sensor.edge_blur_m": 0.02},
    "all": {
        "sensor.edge_reach_m": -0.01,
        "sensor.edge_blur_m": 0.01,
        "sensor.tile_spread": 0.3,
        "sensor.robot_spread": 0.2,
    },
    "robots": {"sensor.edge_reach_m": 0.03, "sensor.robot_spread": 0.4},
}
QUICK: dict[str, Any] = {
    "run.t_end_s": 150.0,
    "decision.min_observations": 12,
    "decision.credible_threshold": 0.8,
    "strategy.soft.eta": 20.0,
    "strategy.soft.kappa": 0.5,
}
"""Short, with decisions early enough that every branch is taken."""


@dataclass(frozen=True)
class Draw:
    """One choice of everything that messages and decisions depend on."""

    strategy: str = "none"
    loss: float = 0.0
    stop: str = "t_end"
    gate: str = "total"
    current: bool = False
    revise: bool = False
    timer: str = "reset_after_turn"
    interrupts: bool = True
    robots: int = 5
    floor: str = "filling"
    stop_ms: float = 1000.0
    interval_ms: float = 2000.0
    period_ms: int = 20
    prior: tuple[int, int] = (1, 1)
    felt: str = "plain"
    motion: dict[str, Any] = field(default_factory=dict)
    """If any, values of all that motion depends on (``random_scenarios``), in place of those above."""

    def scenario(self, **more: Any) -> Scenario:
        values = {
            "strategy.name": self.strategy,
            "network.name": "loss",
            "network.loss.share": self.loss,
            "run.stop": self.stop,
            "decision.gate": self.gate,
            "decision.gate_counts_current": self.current,
            "decision.revise": self.revise,
            "decision.prior_alpha": self.prior[0],
            "decision.prior_beta": self.prior[1],
            "sample.timer": self.timer,
            "sample.interrupts_avoidance": self.interrupts,
            "sample.stop_ms": self.stop_ms,
            "sample.sample_interval_ms": self.interval_ms,
            "swarm.robots": self.robots,
            "run.control_period_ms": self.period_ms,
        }
        more = {name.replace("__", "."): value for name, value in more.items()}
        values = QUICK | values | FLOORS[self.floor] | FELT[self.felt]
        if not self.motion:
            return Scenario().with_values(values | more)
        values |= self.motion
        for name in ("floor.tile_width_m", "floor.left_m", "floor.tile_height_m", "floor.bottom_m"):
            if name in values:  # as much of the arena as if it were of 1 m
                side = "arena.width_m" if "width" in name or "left" in name else "arena.height_m"
                values[name] *= max(values[side], 2.0 * values.get("robot.body_radius_m", 0.015))
        return fitted(values, robot_steps=20_000).with_values(more)


class Drawn:
    """Choices made by Hypothesis, which looks for the simplest that fails."""

    def __init__(self, draw: st.DrawFn) -> None:
        self.draw = draw

    def one(self, values: Sequence[Any]) -> Any:
        return values[self.draw(st.integers(0, len(values) - 1))]

    def between(self, low: float, high: float) -> float:
        return self.draw(st.floats(low, high))


@st.composite
def motions(draw: st.DrawFn) -> dict[str, Any]:
    """Values of all fields that motion depends on, as widely as a scenario allows."""
    return random_values(Drawn(draw), RAY_COUNTS)


draws = st.builds(
    Draw,
    strategy=st.sampled_from(["none", "positive", "soft"]),
    loss=st.sampled_from([0.0, 0.1, 0.5, 1.0]),
    stop=st.sampled_from(["t_end", "all_decided"]),
    gate=st.sampled_from(["total", "received", "own"]),
    current=st.booleans(),
    revise=st.booleans(),
    timer=st.sampled_from(TIMERS),
    interrupts=st.booleans(),
    robots=st.sampled_from([1, 2, 5, 20]),
    floor=st.sampled_from(sorted(FLOORS)),
    stop_ms=st.sampled_from([1000.0, 0.0, 20.0, 30.0, 250.0]),
    interval_ms=st.sampled_from([2000.0, 500.0, 100.0, 3778.0, 57.0]),
    period_ms=st.sampled_from([20, 13, 50]),
    prior=st.sampled_from([(1, 1), (4, 2)]),
    felt=st.sampled_from(sorted(FELT)),
    motion=st.one_of(st.just({}), motions()),
)
