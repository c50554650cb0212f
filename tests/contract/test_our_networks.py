"""Our networks: their limits are the ideal network, and each does what its page says."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from helpers.plain_reference import equals_plain
from vibroswarm import networks
from vibroswarm.core.rng import ALONE, NETWORK
from vibroswarm.inference.deliveries import timeline_of
from vibroswarm.inference.replay import advance, classes_and_values, replayer_of
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.motion.pose import pose
from vibroswarm.networks import tree
from vibroswarm.networks.loss import share_lost
from vibroswarm.paper.columns import published
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import replay, simulate
from vibroswarm.strategies.world import Draws

BASE = preset("paper").with_values({"run.t_end_s": 200.0, "decision.min_observations": 20})
TABLES = ("inference", "robots", "runs")


def over(network: str, robots: int = 5, **params: Any) -> Scenario:
    values = {"network.name": network, "strategy.name": "none", "swarm.robots": robots}
    return BASE.with_values(values | {f"network.{network}.{name}": value for name, value in params.items()})


def same(one: Result, other: Result) -> bool:
    return all(getattr(one, name).equals(getattr(other, name)) for name in TABLES)


@pytest.mark.parametrize(
    ("limit", "control"),
    [
        (("loss", {"share": 0.0}), ("loss", {"share": 0.1})),
        (("range", {"range_m": math.inf}), ("range", {"range_m": 0.4})),
        (("delay", {"fixed_s": 0.0, "random_s": 0.0}), ("delay", {"fixed_s": 9.0, "random_s": 0.0})),
        (("tree", {"frame_ms": 0.0}), ("tree", {"frame_ms": 20.0})),
        (("bursts", {"bad_share": 0.0, "lost_in_good": 0.0}), ("bursts", {"bad_share": 0.5})),
    ],
)  # fmt: skip
def test_at_its_limit_a_network_is_ideal(
    limit: tuple[str, dict[str, Any]], control: tuple[str, dict[str, Any]]
) -> None:
    runs = simulate(over("ideal"), 3, 2, moves=True)
    assert same(runs, replay(runs, over(limit[0], **limit[1])))
    # Negative control: off its limit it is another.
    assert not same(runs, replay(runs, over(control[0], **control[1])))


@pytest.mark.parametrize("network", ["bursts", "delay", "loss_by_size", "range", "tree"])
def test_kernels_do_what_plain_python_does(network: str) -> None:
    """Tick by tick, with the functions of the network uncompiled."""
    params = {"bursts": {"bad_share": 0.3}, "range": {"range_m": 0.4}, "tree": {"frame_ms": 20.0}}
    scenario = over(network, robots=6, **params.get(network, {})).with_values({"run.t_end_s": 40.0})
    assert list(equals_plain(scenario)) == []


def log_of(result: Result, run: int) -> SimpleNamespace:
    """Sender, tick and ticks of arrival (-1: never) of a run's messages, and which are to others than the sender."""
    parts = [getattr(result, name).filter(run=run) for name in ("motion", "ends", "observations")]
    moves = None if result.moves is None else result.moves.filter(run=run)
    timeline = timeline_of(result.scenario, Motion(samples=parts[0], ends=parts[1], moves=moves))
    assert result.seed is not None
    replayer = replayer_of(result.scenario, result.seed, timeline, lists_arrivals=True)
    advance(replayer, result.scenario, result.seed, timeline, *classes_and_values(parts[2]))
    sent = int(replayer.buffer.filled[0])
    sender, tick, arrival = (getattr(replayer.buffer, name)[:sent] for name in ("sender", "tick", "arrivals"))
    to_others = sender[:, None] != np.arange(arrival.shape[1])
    return SimpleNamespace(sender=sender, tick=tick, arrival_tick=arrival, to_others=to_others)


def logs(scenario: Scenario, runs: int, seed: int = 5) -> list[SimpleNamespace]:
    result = simulate(scenario, seed, runs, energies=False)
    return [log_of(result, run) for run in range(runs)]


def share_lost_in(found: list[SimpleNamespace]) -> float:
    lost = [(log.arrival_tick < 0)[log.to_others] for log in found]
    return float(np.concatenate(lost).mean())


def test_who_is_in_range_hears() -> None:
    """Brute force: distances between the poses of another table, which differ by millimetres while robots turn."""
    result = simulate(over("range", range_m=0.4), 5, 1, poses=True)
    log = log_of(result, 0)
    assert result.poses is not None
    checked = 0
    for k in range(0, log.sender.size, 3):
        places = np.array([pose(result.poses, 0, i, 0.02 * int(log.tick[k]))[:2] for i in range(5)])
        distance = np.hypot(*(places - places[log.sender[k]]).T)
        clear = (np.abs(distance - 0.4) > 0.008) & log.to_others[k]
        assert ((log.arrival_tick[k] >= 0) == (distance < 0.4))[clear].all()
        checked += int(clear.sum())
    assert checked > 150


def test_delays_are_fixed_and_exponential() -> None:
    # At least one tick; 0.14 s / 0.02 s is above 7 by rounding.
    for fixed_s, ticks in ((2.0, 100), (0.14, 7), (0.0, 1)):
        (fixed,) = logs(over("delay", fixed_s=fixed_s, random_s=0.0), 1)
        assert np.unique((fixed.arrival_tick - fixed.tick[:, None])[fixed.to_others]).tolist() == [ticks]
    drawn = logs(over("delay", fixed_s=2.0, random_s=3.0), 8)
    found = [log.arrival_tick - log.tick[:, None] for log in drawn]
    apart = [row[row >= 0] for row in found[0]]  # each receiver has its own delay
    assert np.mean([np.ptp(row) > 0 for row in apart if row.size > 1]) > 0.95
    delay_s = 0.02 * np.concatenate([d[d > -1e6] for d in (np.where(f < 0, -1e9, f) for f in found)])
    assert delay_s.size > 2500
    assert delay_s.min() >= 2.0
    # Kolmogorov-Smirnov against 2 + Exp(3), rounded up to ticks; 1.95 / sqrt(n): p = 0.001.
    expected = 1.0 - np.exp(-(np.sort(delay_s) - 2.0) / 3.0)
    distance = np.abs(expected - (np.arange(delay_s.size) + 0.5) / delay_s.size).max()
    limit = 1.95 / math.sqrt(delay_s.size) + 0.02 / 3.0
    assert distance < limit
    # Negative control: a mean of 2.5 s is told apart.
    wrong = 1.0 - np.exp(-(np.sort(delay_s) - 2.0) / 2.5)
    assert np.abs(wrong - (np.arange(delay_s.size) + 0.5) / delay_s.size).max() > limit


def test_loss_by_size_is_the_fit_of_the_published_shares() -> None:
    from scipy.optimize import curve_fit

    from vibroswarm.networks.loss import LARGE, NO_LOSS, SCALE

    n = np.arange(5, 11)
    shares = np.array(published("experiments.packet_loss_percent")) / 100 * n / (n - 1)
    fitted, _ = curve_fit(lambda x, a, b, c: a * (1 - np.exp(-(x - b) / c)), n, shares, (0.09, 4.8, 2.0))
    assert pytest.approx(fitted, rel=2e-3) == (LARGE, NO_LOSS, SCALE)
    assert [share_lost(k) for k in n] == pytest.approx(shares, abs=0.004)


@pytest.mark.parametrize("robots", [5, 10])
def test_so_much_is_lost(robots: int) -> None:
    by_size, by_share = over("loss_by_size", robots=robots), over("loss", robots=robots, share=0.3)
    for scenario, share in ((by_size, share_lost(robots)), (by_share, 0.3)):
        found = logs(scenario, 10)
        count = sum(int(log.to_others.sum()) for log in found)
        assert abs(share_lost_in(found) - share) < 4.0 * math.sqrt(share * (1 - share) / count)


def lost_in_order(scenario: Scenario, runs: int) -> list[np.ndarray[Any, Any]]:
    """For each receiver of each run, which of the messages to it were lost."""
    return [
        log.arrival_tick[log.sender != i, i] < 0
        for log in logs(scenario, runs)
        for i in range(log.arrival_tick.shape[1])
    ]


def run_lengths(sequences: list[np.ndarray[Any, Any]]) -> np.ndarray[Any, Any]:
    """How many bursts have 1, 2, 3 and 4 or more messages."""
    lengths = [
        np.diff(np.flatnonzero(np.diff(np.concatenate([[0], lost, [0]])))[:None])[::2] for lost in sequences
    ]
    return np.bincount(np.minimum(np.concatenate(lengths), 4), minlength=5)[1:]


def test_bursts_of_length_one_are_independent_loss() -> None:
    """The same share and the same lengths of bursts as of `loss`; of length 10 s they differ."""
    p = {"bad_share": 0.3, "lost_in_bad": 0.8, "lost_in_good": 0.1}
    share = 0.3 * 0.8 + 0.7 * 0.1
    single = lost_in_order(over("bursts", bad_s=0.0, **p), 12)
    plain = lost_in_order(over("loss", share=share), 12)
    long = lost_in_order(over("bursts", bad_s=10.0, **p), 12)
    count = sum(lost.size for lost in single)
    assert count > 4000
    assert abs(sum(int(lost.sum()) for lost in single) - share * count) < 3.3 * math.sqrt(
        count * share * (1 - share)
    )

    def chi2(one: np.ndarray[Any, Any], other: np.ndarray[Any, Any]) -> float:
        expected = np.outer([one.sum(), other.sum()], one + other) / (one.sum() + other.sum())
        return float(((np.array([one, other]) - expected) ** 2 / expected).sum())

    assert chi2(run_lengths(single), run_lengths(plain)) < 16.3  # 3 degrees of freedom, p = 0.001
    assert chi2(run_lengths(long), run_lengths(plain)) > 50.0


def test_bursts_last_as_long_as_they_should() -> None:
    """Message by message to 400 receivers: how often two in a row are lost, by a Markov chain in time."""
    bursts, b, in_bad, in_good, bad_s = networks.known()["bursts"], 0.3, 0.2, 0.9, 0.2
    p = bursts.params(bad_share=b, bad_s=bad_s, lost_in_bad=in_bad, lost_in_good=in_good)
    a = SimpleNamespace(**bursts.arrays_of(p, {"robots": 400}))
    assert bursts.send is not None
    gaps, lost = np.tile([1, 1, 2, 6], 50), []
    for number, tick in enumerate(np.cumsum(gaps)):
        arrival, d = np.full(400, -1), Draws(1, 0, 0, NETWORK, number, ALONE, 0, -1.0)
        bursts.send(None, a, 0, tick, number, 2, None, None, arrival, d, p, SimpleNamespace(tick_s=0.02))
        assert np.isin(arrival, (-1, tick + 1)).all()
        lost.append(arrival < 0)
    share = b * in_bad + (1 - b) * in_good
    assert np.mean(lost[0]) == pytest.approx(share, abs=3.3 * 0.5 / 20)
    both = np.logical_and(lost[1:], lost[:-1])
    for gap in (1, 2, 6):
        stays = math.exp(-0.02 * gap / (bad_s * (1 - b)))
        expected = share**2 + (in_bad - in_good) ** 2 * b * (1 - b) * stays
        found = both[gaps[1:] == gap]
        assert found.mean() == pytest.approx(expected, abs=3.3 * 0.5 / math.sqrt(found.size))


def test_a_tree_is_filled_level_by_level() -> None:
    assert [tree.parent_of(i) for i in range(12)] == [-1] * 5 + [0, 1, 2, 3, 4, 0, 1]
    parents = [tree.parent_of(i) for i in range(780)]
    assert max(parents.count(i) for i in range(-1, 780)) == 5
    depth = [0] * 780
    for i, parent in enumerate(parents):
        depth[i] = 1 if parent < 0 else depth[parent] + 1
    assert [depth.count(k) for k in (1, 2, 3, 4)] == [5, 25, 125, 625]


def test_who_finds_a_node_busy_waits_or_loses_the_message() -> None:
    """By hand, in ms: a message of one frame takes 10 a hop, a log of two frames 20, each node to one at a time."""
    tree_ = networks.known()["tree"]
    p = tree_.params(message_bytes=24, log_bytes=30, frame_ms=10.0, retry_ms=20.0)
    a = SimpleNamespace(**tree_.arrays_of(p, {"robots": 3}))
    half_a_tick = Draws(1, 0, 0, NETWORK, 0, ALONE, 0, 0.5)

    def sent(sender: int, tick: int) -> list[int]:
        arrival, w = np.full(3, -1), SimpleNamespace(robots=3, tick_ms=20)
        assert tree_.send is not None
        tree_.send(None, a, sender, tick, 0, 24, None, None, arrival, half_a_tick, p, w)
        return arrival.tolist()

    # From 10 by the base to robot 1 at 30, to robot 2 at 50; its log keeps robot 0 and the base busy until 70.
    assert sent(0, 0) == [-1, 2, 3]
    assert (*a.free_ms, *a.base_free_ms) == (70.0, 30.0, 50.0, 70.0)
    # From 30; to robot 0 it is lost at 50, as the base is busy until 70; to robot 2 it waits, and is there at 90.
    assert sent(1, 1) == [-1, -1, 5]
    assert (*a.free_ms, *a.base_free_ms) == (70.0, 110.0, 90.0, 110.0)
    # From 210, while the base is busy: two copies and the log are each tried for 20.
    a.base_free_ms[0] = 500.0
    assert sent(1, 10) == [-1, -1, -1]
    assert a.free_ms[1] == 270.0


def test_load_is_what_loses_messages_in_a_tree() -> None:
    shares = []
    for frame_ms in (0.0, 1.0, 4.0):
        shares.append(share_lost_in(logs(over("tree", robots=10, frame_ms=frame_ms), 3)))
    assert shares[0] == 0.0 < shares[1] < shares[2]


def test_an_unlimited_range_is_written_and_read() -> None:
    scenario = over("range", range_m=math.inf)
    assert Scenario.from_toml(scenario.to_toml()) == scenario
    assert scenario.hash == Scenario.from_toml(scenario.to_toml()).hash != over("range", range_m=1e300).hash
