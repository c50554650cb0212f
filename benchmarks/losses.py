"""Does it matter how packets are lost? What positive and soft feedback gain under losses of several kinds.

    python benchmarks/losses.py [--runs 400] [--column calibrated] [--threshold 1.40] [--recordings DIR]

Simulations lose each message at each receiver independently. Here the same share is lost in other ways: with all
receivers at once, in bursts, more at some robots than at others, along a tree; messages are late; and the other gates
and p_c. Each way: times without feedback by swarm size, and the differences of positive less none and soft less
positive, means over the sizes with standard errors over runs and, in brackets, those of 15 experiments a size.
Published: -39 and -76 s. None of the settings was chosen by these.

Decisions come from a replay of its own, which is held against the package where nothing is lost: it stops where they
differ. With recordings: what their robots lost, and how much of it while a robot was away, without samples for 9 s or
more.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numba import njit
from numpy.typing import NDArray
from scipy.special import betainc

from vibroswarm import preset, replay, simulate
from vibroswarm.inference.deliveries import Timeline, timeline_of
from vibroswarm.motion.source import Motion
from vibroswarm.paper.columns import published, sizes
from vibroswarm.paper.items.experiment_times import loss_of
from vibroswarm.paper.real_data import real_floor
from vibroswarm.result import Result

T_END_S = 1000.0
STRATEGIES = ("none", "positive", "soft")
TOTAL, RECEIVED, OWN = range(3)
GAP_S = 9.0
Draw = np.random.Generator


@njit
def decide(bounds, robot, bit, heard, time_s, arrives, u, strategy, gate, least, p_c, beliefs):  # type: ignore
    """Mean decision time of each run, (runs,); undecided robots count T_END_S."""
    robots = arrives.shape[1]
    out = np.empty(bounds.size - 1)
    for r in range(bounds.size - 1):
        low, high = bounds[r], bounds[r + 1]
        alpha, beta = np.ones(robots, np.int64), np.ones(robots, np.int64)
        own, received, read = (
            np.zeros(robots, np.int64),
            np.zeros(robots, np.int64),
            np.zeros(robots, np.int64),
        )
        decided, when = np.full(robots, -1), np.full(robots, T_END_S)
        said = np.zeros(high - low, np.int64)
        for k in range(low, high):
            i = robot[k]
            while read[i] < heard[k]:
                m = read[i]
                if robot[low + m] != i and arrives[low + m, i]:
                    alpha[i] += said[m]
                    beta[i] += 1 - said[m]
                    received[i] += 1
                read[i] += 1
            counted = own[i] + received[i] if gate == 0 else (received[i] if gate == 1 else own[i])
            alpha[i] += bit[k]
            beta[i] += 1 - bit[k]
            own[i] += 1
            p = beliefs[alpha[i] - 1, beta[i] - 1]
            if decided[i] < 0 and counted > least and (p > p_c or 1.0 - p > p_c):
                decided[i], when[i] = (0 if p > p_c else 1), time_s[k]
            said[k - low] = bit[k]
            if strategy == 1 and decided[i] >= 0:
                said[k - low] = decided[i]
            if strategy == 2:
                whole = alpha[i] + beta[i]
                variance = alpha[i] * beta[i] / (whole * whole * (whole + 1.0))
                weight = np.exp(-1500.0 * variance) * (0.5 - p) ** 2
                said[k - low] = 1 if u[k] < weight * (1.0 - p) + (1.0 - weight) * bit[k] else 0
        out[r] = when.mean()
    return out


class Case(NamedTuple):
    """A swarm of one size: its motion and what it read."""

    robots: int
    result: Result
    timeline: Timeline

    def times(self, way: Way, draw: Draw, beliefs: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """Mean decision time of each run under the three strategies, (runs,) each."""
        line = self.timeline
        u = draw.random(line.robot.size)
        arrives = way.arrives(self, loss_of(self.robots), draw)
        heard = late(line, self.result, way.delay_s)
        robot, bit = line.robot.astype(np.int64), self.result.observations["observation"].to_numpy()
        least = 381 // 5 if way.gate == OWN else 381
        return [
            decide(line.bounds, robot, bit.astype(np.int64), heard, line.time_s, arrives, u, strategy, way.gate,
                   least, way.p_c, beliefs)
            for strategy in range(3)
        ]  # fmt: skip


Arrives = Callable[[Case, float, Draw], NDArray[np.bool_]]


class Way(NamedTuple):
    """A way of losing messages, with what else is set."""

    words: str
    arrives: Arrives
    gate: int = TOTAL
    p_c: float = 0.95
    delay_s: float = 0.0


def late(line: Timeline, result: Result, delay_s: float) -> NDArray[np.int64]:
    """How many messages of its run each sample's robot has come past, (rows,)."""
    heard = line.heard[:, 0].astype(np.int64)
    begun = result.motion["stop_start_s"].to_numpy() - 0.04 - delay_s
    for low, high in zip(line.bounds[:-1], line.bounds[1:], strict=True) if delay_s > 0 else ():
        there = np.searchsorted(line.time_s[low:high], begun[low:high])
        heard[low:high] = np.minimum(there, heard[low:high])
    return heard


def every(case: Case, loss: float, draw: Draw) -> NDArray[np.bool_]:
    """Nothing is lost."""
    return np.ones((case.timeline.robot.size, case.robots), np.bool_)


def alone(case: Case, loss: float, draw: Draw) -> NDArray[np.bool_]:
    """Each message at each receiver."""
    return draw.random((case.timeline.robot.size, case.robots)) >= loss


def shared(case: Case, loss: float, draw: Draw) -> NDArray[np.bool_]:
    """A message at all receivers at once."""
    return np.repeat(draw.random((case.timeline.robot.size, 1)) >= loss, case.robots, axis=1)


def tree(case: Case, loss: float, draw: Draw) -> NDArray[np.bool_]:
    """Up to a root, then down to three branches: each hop loses alike."""
    hop = 1.0 - (1.0 - loss) ** 0.5
    down = draw.random((case.timeline.robot.size, 3)) >= hop
    return shared(case, hop, draw) & down[:, np.arange(case.robots) % 3]


def outages(where: str, mean_s: float) -> Arrives:
    """All messages in outages (Gilbert and Elliott's two states) of a receiver, a sender, or a pair."""

    def arrives(case: Case, loss: float, draw: Draw) -> NDArray[np.bool_]:
        line, n = case.timeline, case.robots
        found = np.empty((line.robot.size, n), np.bool_)
        for low, high in zip(line.bounds[:-1], line.bounds[1:], strict=True):
            second, sender = line.time_s[low:high].astype(int), line.robot[low:high]
            bad = two_states(n * n if where == "pair" else n, loss, mean_s, draw)
            if where == "receiver":
                found[low:high] = ~bad[:, second].T
            elif where == "sender":
                found[low:high] = ~bad[sender, second][:, None]
            else:
                found[low:high] = ~bad.reshape(n, n, -1)[sender, :, second]
        return found

    return arrives


def two_states(count: int, loss: float, mean_s: float, draw: Draw) -> NDArray[np.bool_]:
    """Whether each link is out in each second, (count, seconds)."""
    seconds = int(T_END_S) + 2
    out, now = np.empty((count, seconds), np.bool_), draw.random(count) < loss
    for second in range(seconds):
        out[:, second] = now
        u = draw.random(count)
        now = np.where(now, u >= 1.0 / mean_s, u < loss / (1.0 - loss) / mean_s)
    return out


def unequal(where: str) -> Arrives:
    """Rates that differ between receivers, senders or pairs: Gamma with a coefficient of variation of 1.5."""

    def arrives(case: Case, loss: float, draw: Draw) -> NDArray[np.bool_]:
        line, n = case.timeline, case.robots
        found = np.empty((line.robot.size, n), np.bool_)
        for low, high in zip(line.bounds[:-1], line.bounds[1:], strict=True):
            shape = {"receiver": (1, n), "sender": (n, 1), "pair": (n, n)}[where]
            rate = np.broadcast_to(np.minimum(draw.gamma(1 / 2.25, 2.25 * loss, shape), 1.0), (n, n))
            found[low:high] = draw.random((high - low, n)) >= rate[line.robot[low:high]]
        return found

    return arrives


def both(first: Arrives, second: Arrives) -> Arrives:
    """Half of the loss in one way, half in the other."""

    def arrives(case: Case, loss: float, draw: Draw) -> NDArray[np.bool_]:
        half = 1.0 - (1.0 - loss) ** 0.5
        return first(case, half, draw) & second(case, half, draw)

    return arrives


WAYS = (
    Way("nothing lost", every),
    Way("each alone (as simulated)", alone),
    Way("shared by all receivers", shared),
    Way("along a tree", tree),
    *(Way(f"outages of a receiver, {s:g} s", outages("receiver", s)) for s in (3.0, 10.0, 30.0, 100.0, 300.0)),
    Way("outages of a sender, 30 s", outages("sender", 30.0)),
    Way("outages of a pair, 60 s", outages("pair", 60.0)),
    *(Way(f"unequal {where}s", unequal(where)) for where in ("receiver", "sender", "pair")),
    Way("half outages of 25 s, half alone", both(outages("receiver", 25.0), alone)),
    Way("half shared, half alone", both(shared, alone)),
    Way("half shared, half outages of 25 s", both(shared, outages("receiver", 25.0))),
    Way("each alone, 5 s late", alone, delay_s=5.0),
    Way("each alone, 20 s late", alone, delay_s=20.0),
    Way("each alone, gate received", alone, gate=RECEIVED),
    Way("each alone, gate own", alone, gate=OWN),
    Way("shared, gate own", shared, gate=OWN),
    Way("each alone, p_c 0.9", alone, p_c=0.9),
    Way("each alone, p_c 0.99", alone, p_c=0.99),
)  # fmt: skip


def cases_of(column: str, threshold: float, runs: int, seed: int) -> list[Case]:
    """Swarms of all sizes on the real floor."""
    found = []
    for robots in sizes():
        values: dict[str, Any] = {
            "run.t_end_s": T_END_S,
            "swarm.robots": robots,
            "network.name": "ideal",
        }
        scenario = preset(column).with_values(
            {**real_floor(), **values, "sensor.rms_threshold": threshold, "decision.min_observations": 381}
        )
        result = simulate(scenario, seed, runs, energies=False)
        found.append(Case(robots, result, timeline_of(scenario, Motion(result.motion, result.ends, None))))
    return found


def check(case: Case, beliefs: NDArray[np.float64]) -> None:
    """Without loss, times are those of the package, run by run."""
    mine = case.times(WAYS[0], np.random.default_rng(1), beliefs)
    for name, times in zip(STRATEGIES[:2], mine, strict=False):
        whole = replay(case.result, case.result.scenario.with_values({"strategy.name": name})).robots
        there = (
            whole.group_by("run").agg(pl.col("decision_time_s").fill_null(T_END_S).mean()).sort("run")[:, 1]
        )
        if not np.allclose(times, there.to_numpy(), rtol=0, atol=1e-9):
            raise SystemExit(f"{name}: this replay differs from that of the package")


def show(way: Way, cases: list[Case], beliefs: NDArray[np.float64], seed: int) -> None:
    """One line: times without feedback by size, and both differences."""
    draw = np.random.default_rng(seed)
    times = [case.times(way, draw, beliefs) for case in cases]
    words = [f"{way.words:34}", *(f"{none.mean():4.0f}" for none, _, _ in times)]
    for first, second in ((1, 0), (2, 1)):
        gaps = [one[first] - one[second] for one in times]
        spread = np.array([gap.std(ddof=1) for gap in gaps])
        error = [float(np.sqrt((spread**2 / n).sum())) / len(gaps) for n in (gaps[0].size, 15)]
        mean = float(np.mean([gap.mean() for gap in gaps]))
        words.append(f" | {mean:5.0f} +- {error[0]:.0f} ({error[1]:.0f})")
    print(" ".join(words), flush=True)


def recorded(folder: Path) -> None:
    """What robots of the recordings lost, and how much of it while they were away."""
    lost = sent = away = 0
    lengths: list[float] = []
    for path in sorted(folder.glob("CAL_?.csv")):
        log = pl.read_csv(path, null_values=["None"], infer_schema_length=None)
        log = log.filter(pl.col("Swarm Send").is_not_null()).sort("Timestamp")
        robots = {i: log.filter(pl.col("ROV Number") == i) for i in sorted(log["ROV Number"].unique())}
        for i, mine in robots.items():
            t = mine["Timestamp"].to_numpy()
            to_it = np.zeros(
                t.size, dtype=np.int64
            )  # messages of others, a moment before each of its samples
            for j, theirs in robots.items():
                if j != i:
                    before = np.searchsorted(theirs["Timestamp"].to_numpy(), t - 0.6, side="right")
                    to_it += np.append(0, theirs["Swarm Send"].to_numpy() + 1)[before]
            missed = to_it - mine["Swarm Recv"].to_numpy()
            lost, sent = lost + int(missed[-1]), sent + int(to_it[-1])
            for k in np.flatnonzero(np.diff(t) > GAP_S):
                if missed[k + 1] - missed[k] >= 5:
                    away += int(missed[k + 1] - missed[k])
                    lengths.append(float(t[k + 1] - t[k]))
    print(
        f"recordings: {lost} of {sent} messages lost ({lost / sent:.1%}), {away / lost:.0%} of them in {len(lengths)} "
        f"stretches of {min(lengths):.0f} to {max(lengths):.0f} s in which the receiver took no sample"
    )


def main() -> None:
    """All ways, one line each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--column", default="calibrated")
    parser.add_argument("--threshold", type=float, default=1.40)
    parser.add_argument("--recordings", type=Path)
    asked = parser.parse_args()
    counts = np.arange(1, 1601)
    beliefs = betainc(counts[:, None], counts[None, :], 0.5)
    cases = cases_of(asked.column, asked.threshold, asked.runs, asked.seed)
    check(cases[0], beliefs)
    means = {name: np.array(published(f"experiments.decision_time_s.{name}")) for name in STRATEGIES}
    gaps = ((means[a] - means[b]).mean() for a, b in (("positive", "none"), ("soft", "positive")))
    print(f"{asked.column}, theta_E {asked.threshold}, {asked.runs} runs a size; differences in s")
    print(f"{'published':34}", *(f"{x:4.0f}" for x in means["none"]), *(f" | {gap:5.0f}" for gap in gaps))
    for way in WAYS:
        show(way, cases, beliefs, asked.seed)
    if asked.recordings:
        recorded(asked.recordings)


if __name__ == "__main__":
    main()
