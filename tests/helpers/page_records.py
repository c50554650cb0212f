"""Made-up runs for the page: robots that drive arcs, turn back at walls and at each other, stop and talk.

Only as plausible as a picture needs; the real models live elsewhere.
"""

from __future__ import annotations

import math
import random
from typing import Any

import numpy as np
import polars as pl
from scipy.special import betainc

from vibroswarm.floors.floor import Floor
from vibroswarm.run_page.payload import RunRecord

TICK_S, SPEED_M_S, STOP_S, SAMPLE_EVERY_S = 0.02, 0.055, 1.0, 3.778
KINDS = ("drive", "turn", "avoid", "stop")
TILES = (
    (0, 1, 0, 1, 0),
    (1, 0, 0, 1, 0),
    (1, 0, 1, 0, 1),
    (0, 1, 1, 0, 0),
    (1, 0, 0, 1, 0),
)


RULE: dict[str, Any] = {
    "credible_threshold": 0.95, "boundary": 0.5, "tested": 0.5, "prior_alpha": 1, "prior_beta": 1, "prior_belief": 0.5,
    "min_observations": 0, "gate": "total", "gate_counts_current": False, "gated": True, "by_belief": True,
    "answers": None, "asked_anew": False, "decides": "once", "opinions": False,
}  # fmt: skip
BODY = {
    "radius_m": 0.015, "ray_forward_m": 0.008, "ray_sides_m": [0.0, 0.0075, -0.0075],
    "ray_angles_rad": [0.0, math.radians(27), -math.radians(27)], "ray_range_m": 0.15, "ray_disc_radius_m": 0.0055,
    "avoidance_threshold_m": 0.055,
}  # fmt: skip


class Walker:
    """One robot on its random walk, a tick at a time; writes its poses and its samples."""

    def __init__(self, robot: int, seed: int, x: float, y: float) -> None:
        self.robot, self.chance = robot, random.Random(f"{seed}/{robot}")
        self.x, self.y, self.heading = x, y, self.chance.uniform(-math.pi, math.pi)
        self.veer = self.chance.uniform(-0.25, 0.25)
        self.kind, self.left_s, self.leg_s, self.clock_s, self.to_turn = "drive", 0.0, 10.0, 0.0, 0.0
        self.poses: list[tuple[Any, ...]] = []
        self.samples: list[tuple[Any, ...]] = []
        self.last: tuple[str, float, float] | None = None

    def step(self, now: float, others: list[Walker]) -> None:
        speed, rate = self.motion(others)
        wrapped = math.remainder(self.heading, 2 * math.pi)
        self.poses.append((self.robot, now, self.x, self.y, wrapped, self.kind))
        self.last = (self.kind, speed, rate)
        half = rate * TICK_S / 2
        chord = speed * TICK_S * (math.sin(half) / half if half else 1.0)
        self.x += chord * math.cos(self.heading + half)
        self.y += chord * math.sin(self.heading + half)
        self.heading += 2 * half

    def motion(self, others: list[Walker]) -> tuple[float, float]:
        """What the robot does in the next tick: its speed and turn rate; changes its state where it must."""
        if self.kind == "stop":
            return self.stand()
        self.clock_s += TICK_S if self.kind != "turn" else 0.0
        if self.kind in ("turn", "avoid"):
            return self.turn()
        self.leg_s -= TICK_S
        if self.leg_s <= 0:
            self.leg_s = min(max(7.86 + 10.725 * math.tan(self.chance.uniform(-1.5, 1.5)), 1.0), 30.0)
            return self.begin_turn("turn", self.chance.uniform(-math.pi, math.pi))
        if self.clock_s >= SAMPLE_EVERY_S:
            self.kind, self.left_s = "stop", STOP_S
            return 0.0, 0.0
        if self.blocked(others):
            return self.begin_turn("avoid", self.chance.uniform(-math.pi, math.pi))
        return SPEED_M_S, self.veer

    def begin_turn(self, kind: str, angle: float) -> tuple[float, float]:
        self.kind, self.to_turn = kind, angle
        return self.turn()

    def turn(self) -> tuple[float, float]:
        """Turn in place: fast at first, slowing down over the last 40 degrees, tick by tick."""
        self.to_turn -= (self.last[2] if self.last and self.last[0] == self.kind else 0.0) * TICK_S
        if abs(self.to_turn) <= math.radians(2.5):
            self.kind = "drive"
            return SPEED_M_S, self.veer
        rate = min(2.4, max(0.25, 3.4 * abs(self.to_turn)))
        return 0.0, math.copysign(rate, self.to_turn)

    def stand(self) -> tuple[float, float]:
        self.left_s -= TICK_S
        if self.left_s <= 1e-9:
            self.kind, self.clock_s = "drive", 0.0
            return SPEED_M_S, self.veer
        return 0.0, 0.0

    def blocked(self, others: list[Walker]) -> bool:
        x, y = self.x + 0.05 * math.cos(self.heading), self.y + 0.05 * math.sin(self.heading)
        if not (0.012 < x < 0.988 and 0.012 < y < 0.988):
            return True
        return any(o is not self and abs(o.x - x) < 0.03 and abs(o.y - y) < 0.03 for o in others)


def walk(robots: int, t_end_s: float, seed: int) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Motion and poses of ``robots`` walkers."""
    chance = random.Random(seed)
    spots = chance.sample([(0.15 + 0.14 * i, 0.15 + 0.14 * j) for i in range(6) for j in range(6)], robots)
    walkers = [Walker(robot, seed, *spot) for robot, spot in enumerate(spots)]
    for tick in range(round(t_end_s / TICK_S)):
        now = round(tick * TICK_S, 6)
        for walker in walkers:
            stood, pose = walker.kind == "stop", (walker.x, walker.y, walker.heading)
            walker.step(now, walkers)
            if stood and walker.kind == "drive":
                at = (walker.robot, len(walker.samples), now - STOP_S, now, *pose)
                walker.samples.append((*at, 3.8, 0.4, 0.2, STOP_S))
    names = ["robot", "sample", "stop_start_s", "time_s", "x_m", "y_m", "heading_rad"]
    times = ["drive_s", "turn_s", "avoid_s", "stop_s"]
    motion = pl.DataFrame([s for w in walkers for s in w.samples], schema=[*names, *times], orient="row")
    columns = ["robot", "time_s", "x_m", "y_m", "heading_rad", "kind"]
    poses = pl.DataFrame([s for w in walkers for s in w.poses], schema=columns, orient="row")
    kinds = {"robot": pl.UInt16}
    motion = motion.cast({**kinds, "sample": pl.UInt32, **dict.fromkeys(times, pl.Float32)})
    return motion.insert_column(0, _run(motion)), poses.cast(kinds).insert_column(0, _run(poses))


def believe(
    motion: pl.DataFrame, floor: Floor, seed: int, least: int, threshold: float, heard: float
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Observations and inference without feedback: a share ``heard`` of the bits sent to all arrives."""
    chance = np.random.default_rng(seed)
    tile = floor.tile_at(motion["x_m"].to_numpy(), motion["y_m"].to_numpy())
    truth = np.where(tile >= 0, floor.tiles.ravel()[tile], 0)
    energy = np.where(
        truth == 1,
        chance.gamma(5.335, 0.5132, len(tile)) - 0.2,
        chance.gamma(2.522, 0.2875, len(tile)) + 0.137,
    )
    bit = (energy > 1.33).astype(np.uint8)
    robot, time = motion["robot"].to_numpy(), motion["time_s"].to_numpy()
    counts = {int(r): [1, 1, 0, -1] for r in np.unique(robot)}  # alpha, beta, received, decision
    rows: list[Any] = [None] * len(time)
    for at in np.lexsort([robot, time]):
        own, seen = counts[int(robot[at])], int(bit[at])
        received, own[1 - seen] = own[2], own[1 - seen] + 1
        belief = float(betainc(own[0], own[1], 0.5))
        if own[3] < 0 and own[0] + own[1] - 3 > least and not 1 - threshold <= belief <= threshold:
            own[3] = int(belief < 0.5)
        rows[at] = (robot[at], motion["sample"][int(at)], seen, own[0], own[1], received, belief, own[3])
        for other, count in counts.items():
            if other != robot[at] and chance.random() < heard:
                count[1 - seen] += 1
                count[2] += 1
    key = motion.select("run", "robot", "sample")
    observations = key.with_columns(
        tile=pl.Series(tile, dtype=pl.Int32),
        energy=pl.Series(energy, dtype=pl.Float32),
        observation=pl.Series(bit),
    )
    names = ["robot", "sample", "message", "alpha", "beta", "messages_received", "belief_below", "decision"]
    inference = pl.DataFrame([tuple(map(_plain, row)) for row in rows], schema=names, orient="row")
    small = {
        "message": pl.UInt8,
        "alpha": pl.UInt32,
        "beta": pl.UInt32,
        "messages_received": pl.UInt32,
        "decision": pl.Int8,
    }
    inference = inference.cast({"robot": pl.UInt16, "sample": pl.UInt32, **small})
    return observations, inference.insert_column(0, _run(inference))


def summary(motion: pl.DataFrame, inference: pl.DataFrame) -> pl.DataFrame:
    """The robots table."""
    table = motion.join(inference.drop("run"), on=["robot", "sample"])
    first = (
        table.filter(pl.col("decision") >= 0)
        .group_by("robot")
        .agg(
            decision_time_s=pl.col("time_s").min(),
            belief_at_decision=pl.col("belief_below").sort_by("time_s").first(),
        )
    )
    last = table.group_by("robot").agg(
        pl.col("decision", "alpha", "beta", "messages_received").sort_by("time_s").last(),
        samples=pl.len(),
        sent=pl.len(),
    )
    robots = last.join(first, on="robot", how="left").sort("robot")
    return robots.insert_column(0, _run(robots)).cast({"samples": pl.UInt32, "sent": pl.UInt32})


def make_record(
    robots: int = 5,
    t_end_s: float = 240.0,
    seed: int = 3,
    title: str = "Five robots on a made-up floor",
    tiles: Any = TILES,
    min_observations: int = 120,
    border_m: float = 0.0,
    heard: float = 1.0,
    **fields: Any,
) -> RunRecord:
    """A whole record; ``fields`` replace what it would hold."""
    side = 1 - 2 * border_m
    shape = np.shape(tiles)
    floor = Floor(np.array(tiles), side / shape[1], side / shape[0], border_m, border_m, "made up")
    motion, poses = walk(robots, t_end_s, seed)
    rule = {**RULE, "min_observations": min_observations}
    observations, inference = believe(
        motion, floor, seed, min_observations, rule["credible_threshold"], heard
    )
    table = summary(motion, inference)
    truth = int(floor.fill_ratio > 0.5)
    decisions = set(table["decision"])
    consensus = "incomplete" if -1 in decisions else "split" if len(decisions) > 1 else "wrong"
    if decisions == {truth}:
        consensus = "right"
    known: dict[str, Any] = {
        "title": title, "arena": {"width_m": 1.0, "height_m": 1.0}, "floor": floor, "t_end_s": t_end_s,
        "strategy": "none", "seed": seed, "run": 0, "fill_ratio": floor.fill_ratio, "consensus": consensus,
        "consensus_time_s": None if -1 in decisions else float(table["decision_time_s"].max()),
        "rule": rule, "body": BODY, "motion": motion, "poses": poses,
        "observations": observations, "inference": inference, "robots": table,
        "details": {"scenario": "0f3a9c2e77b1", "vibroswarm": "0.1.0", "numpy": "2.4.6"},
    }  # fmt: skip
    return RunRecord(**{**known, **fields})


def _run(frame: pl.DataFrame) -> pl.Series:
    return pl.Series("run", np.zeros(len(frame), dtype=np.uint32))


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value
