"""Choose theta_E from labelled recordings by equal error, least error or costs.

Whether the floor can be decided with it is tested too.

| name | symbol | equation |
|---|---|---|
| false positive, false negative | a(theta), b(theta) | share of still samples with E > theta, of vibrating ones with E <= theta |
| equal error | - | a(theta) = b(theta) |
| expected cost | - | c_a (1 - f) a(theta) + c_b f b(theta), f the fill ratio; least error: c_a = c_b = 1 |
| edge distance | - | from a sample to the nearest tile of the other kind |

A sample's label is the kind of tile under the robot's centre. Samples are neither independent nor identically
distributed: robots and tiles differ. So the bootstrap resamples both, robots (of a session) and tiles, and weights a
sample by the product of their counts; the interval holds for other such robots and tiles. Resamples come from
addressed random numbers: the same for the same seed, draw and stream.
"""  # noqa: E501

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.decidability import Decidability, decidability_of_share, observed_share
from vibroswarm.analysis.intervals import Interval, mean_interval
from vibroswarm.analysis.sampling import effective_samples, effective_with_sensor
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.rng import Purpose, uniforms
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.recordings.recording import Recording, inside


def resample(seed: int, draw: int, stream: int, count: int) -> NDArray[np.int64]:
    """Draw ``count`` of the indices below ``count`` with replacement."""
    return (uniforms(seed, draw, stream, Purpose.BOOTSTRAP, count) * count).astype(np.int64)


def cluster_weights(seed: int, draw: int, stream: int, cluster: NDArray[np.int64]) -> NDArray[np.float64]:
    """Draw as many clusters as there are, with replacement; return how often each row's cluster was drawn, (rows,).

    Args:
        cluster: (rows,): number of each row's cluster, from 0.
    """
    clusters = int(cluster.max()) + 1
    return np.bincount(resample(seed, draw, stream, clusters), minlength=clusters)[cluster].astype(float)


def robot_clusters(samples: pl.DataFrame) -> NDArray[np.int64]:
    """Return the cluster of each sample, (samples,), from 0: the same robot in two sessions is two clusters."""
    pairs = samples.select(pl.col("run", "robot").cast(pl.Int64)).to_numpy()
    return np.unique(pairs, axis=0, return_inverse=True)[1].ravel()


Floats = NDArray[np.float64]
Rule = Callable[[Floats, NDArray[np.bool_], Floats], float]
"""A threshold from energies, labels and weights of samples, (samples,) each."""

RESAMPLES: Final = 400
_SEED: Final = 7
EDGES_M: Final = (0.0, 0.01, 0.02, 0.04, 0.06, np.inf)


@dataclass(frozen=True)
class Rates(NotebookView):
    """Error rates of samples at a threshold."""

    false_positive: float
    false_negative: float
    still: int
    vibrating: int


@dataclass(frozen=True)
class Threshold(NotebookView):
    """A threshold with its interval, its error rates, and whether the floor can be decided with it."""

    rule: str
    value: float
    low: float
    high: float
    """95 %, over robots and tiles."""
    all_samples: Rates
    inner_samples: Rates
    """Samples farther from a tile of the other kind than the margin."""
    share_by_session: Interval
    """Share of ones with equal weight of tiles; the session is the unit."""
    decidable: Decidability
    """From the pooled samples, with their effective number."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        share = self.share_by_session.as_dict()
        return {name: getattr(self, name) for name in ("rule", "value", "low", "high")} | {
            "all_samples": asdict(self.all_samples),
            "inner_samples": asdict(self.inner_samples),
            "share_by_session": {name: share[name] for name in ("estimate", "low", "high")},
            "decidable": self.decidable.as_dict(),
        }


@dataclass(frozen=True, eq=False)
class Labelled(NotebookView):
    """Samples on tiles, (samples,) each."""

    energy: Floats
    vibrating: NDArray[np.bool_]
    edge_m: Floats
    """Distance to the nearest tile of the other kind; inf if there is none."""
    tile: NDArray[np.int64]
    session: NDArray[np.int64]
    robot: NDArray[np.int64]
    fill_ratio: float


def labelled(recording: Recording) -> Labelled:
    """Return the samples of a recording with the kind of the tile below.

    Raises:
        InputError: all samples are on one kind of tile.
    """
    key = ["run", "robot", "sample"]
    frame = recording.motion.join(recording.rows.select(*key, "energy"), on=key, maintain_order="left").join(
        recording.observations.select(*key, "tile"), on=key, maintain_order="left"
    )
    frame = frame.filter(pl.col("tile") >= 0)
    floor = recording.floor(int(recording.runs["run"][0]))
    tile = frame["tile"].cast(pl.Int64).to_numpy()
    vibrating = floor.tiles.ravel()[tile] == 1
    if vibrating.all() or not vibrating.any():
        raise InputError("has samples on one kind of tile only; both are needed", field="the recording")
    x, y = inside(frame["x_m"].to_numpy(), frame["y_m"].to_numpy(), recording.scenario)
    return Labelled(
        energy=frame["energy"].to_numpy(),
        vibrating=vibrating,
        edge_m=edge_distance(floor, x, y, vibrating)[0],
        tile=tile,
        session=frame["run"].cast(pl.Int64).to_numpy(),
        robot=frame["robot"].cast(pl.Int64).to_numpy(),
        fill_ratio=float(recording.runs["fill_ratio"][0]),
    )


def edge_distance(
    floor: Floor, x_m: Floats, y_m: Floats, vibrating: NDArray[np.bool_]
) -> tuple[Floats, NDArray[np.int64]]:
    """Return the distance from each place to the nearest tile of the other kind, m (inf: none), and that tile's index
    (-1)."""
    rows, columns, width, height, left, bottom = floor.geometry
    distance_m, tile = np.full(x_m.shape, np.inf), np.full(x_m.shape, -1)
    for index, kind in enumerate(floor.tiles.ravel()):
        x0, y0 = left + (index % columns) * width, bottom + (rows - 1 - index // columns) * height
        dx = np.maximum(np.maximum(x0 - x_m, x_m - x0 - width), 0.0)
        dy = np.maximum(np.maximum(y0 - y_m, y_m - y0 - height), 0.0)
        distance = np.hypot(dx, dy)
        nearer = (vibrating != bool(kind)) & (distance < distance_m)
        distance_m[nearer], tile[nearer] = distance[nearer], index
    return distance_m, tile


def error_curves(
    energy: Floats, vibrating: NDArray[np.bool_], weight: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return the thresholds (half-way between energies), with weighted a(theta) and b(theta)."""
    order = np.argsort(energy, kind="stable")
    sorted_energy, kind, w = energy[order], vibrating[order], weight[order]
    still, shaking = np.where(kind, 0.0, w), np.where(kind, w, 0.0)
    false_positive = 1.0 - np.cumsum(still) / still.sum()
    false_negative = np.cumsum(shaking) / shaking.sum()
    between = np.append(sorted_energy[1:], sorted_energy[-1] + 1.0)
    last = between > sorted_energy  # only the last of equal energies is followed by a threshold
    thresholds = (sorted_energy + between) / 2
    return thresholds[last], false_positive[last], false_negative[last]


def equal_error(energy: Floats, vibrating: NDArray[np.bool_], weight: Floats) -> float:
    """Return the threshold at which both error rates cross."""
    thresholds, false_positive, false_negative = error_curves(energy, vibrating, weight)
    k = int(np.argmax(false_negative >= false_positive))
    if k == 0:
        return float(thresholds[0])
    before = false_positive[k - 1] - false_negative[k - 1]
    after = false_negative[k] - false_positive[k]
    share = before / (before + after) if before + after > 0 else 0.5
    return float(thresholds[k - 1] + share * (thresholds[k] - thresholds[k - 1]))


def least_cost(cost_false_positive: float, cost_false_negative: float, fill_ratio: float) -> Rule:
    """Make the rule that takes the threshold with the least expected cost; costs must be above 0."""

    def rule(energy: Floats, vibrating: NDArray[np.bool_], weight: Floats) -> float:
        thresholds, false_positive, false_negative = error_curves(energy, vibrating, weight)
        cost = (
            cost_false_positive * (1 - fill_ratio) * false_positive
            + cost_false_negative * fill_ratio * false_negative
        )
        # Several thresholds may have the lowest cost: take their mean.
        good = np.flatnonzero(cost <= cost.min() + 1e-12)
        return float(thresholds[good].mean())

    return rule


def find_thresholds(
    recording: Recording,
    cost_false_positive: float = 1.0,
    cost_false_negative: float = 1.0,
    margin_m: float = 0.02,
) -> list[Threshold]:
    """Find theta_E by equal error, by least error, and by the costs if they differ.

    Args:
        margin_m: samples nearer to a tile of the other kind are left out of ``inner_samples``.
    Raises:
        InputError: costs that are not positive, samples on one kind of tile only.
    """
    for cost in (cost_false_positive, cost_false_negative):
        if not (np.isfinite(cost) and cost > 0):
            raise InputError(f"{cost!r} is not a cost; give a number above 0", field="cost")
    data = labelled(recording)
    rules: dict[str, Rule] = {
        "equal error": equal_error,
        "least error": least_cost(1.0, 1.0, data.fill_ratio),
    }
    if cost_false_positive != cost_false_negative:
        name = f"costs {cost_false_positive:g} to {cost_false_negative:g}"
        rules[name] = least_cost(cost_false_positive, cost_false_negative, data.fill_ratio)
    return [_found(name, rule, data, recording, margin_m) for name, rule in rules.items()]


def _found(name: str, rule: Rule, data: Labelled, recording: Recording, margin_m: float) -> Threshold:
    value = rule(data.energy, data.vibrating, np.ones(data.energy.size))
    resampled = [rule(data.energy, data.vibrating, weight) for weight in _weights(data)]
    low, high = (float(np.quantile(resampled, q)) for q in (0.025, 0.975)) if resampled else (value, value)
    return at_threshold(recording, value, data, name=name, low=low, high=high, margin_m=margin_m)


def at_threshold(
    recording: Recording,
    value: float,
    data: Labelled | None = None,
    *,
    name: str = "given",
    low: float = float("nan"),
    high: float = float("nan"),
    margin_m: float = 0.02,
) -> Threshold:
    """Return the error rates at a threshold, and whether the floor can be decided with it."""
    data = data or labelled(recording)
    far_from_edges = data.edge_m > margin_m
    bits = data.energy > value
    sessions = np.unique(data.session)
    by_session = [
        observed_share(data.tile[data.session == session], bits[data.session == session]).share
        for session in sessions
    ]
    return Threshold(
        rule=name,
        value=value,
        low=low,
        high=high,
        all_samples=rates(data, value, np.ones(bits.size, dtype=np.bool_)),
        inner_samples=rates(data, value, far_from_edges),
        share_by_session=mean_interval(by_session),
        decidable=_decidable(data, bits, value, recording),
    )


def rates(data: Labelled, threshold: float, chosen: NDArray[np.bool_]) -> Rates:
    """Return the error rates of the chosen samples; the rate of a kind without samples is NaN."""
    bits = data.energy > threshold
    still, shaking = chosen & ~data.vibrating, chosen & data.vibrating

    def share(of: NDArray[np.bool_], amiss: NDArray[np.bool_]) -> float:
        return float(amiss[of].mean()) if of.any() else float("nan")

    return Rates(share(still, bits), share(shaking, ~bits), int(still.sum()), int(shaking.sum()))


def edge_profile(data: Labelled, threshold: float) -> pl.DataFrame:
    """Return the error rates by distance to the nearest tile of the other kind: from_m, to_m, and the fields of
    ``Rates``."""
    rows = []
    for from_m, to_m in pairwise(EDGES_M):
        errors = rates(data, threshold, (data.edge_m >= from_m) & (data.edge_m < to_m))
        rows.append({"from_m": from_m, "to_m": to_m, **asdict(errors)})
    return pl.DataFrame(rows)


def _decidable(
    data: Labelled, bits: NDArray[np.bool_], threshold: float, recording: Recording
) -> Decidability:
    """Return whether the floor can be decided from these bits, with their effective number."""
    seen = observed_share(data.tile, bits)
    count = np.bincount(data.tile)
    visits = count[count > 0] / data.tile.size
    errors = rates(data, threshold, np.ones(bits.size, dtype=np.bool_))
    worth = float(
        effective_with_sensor(
            data.tile.size,
            effective_samples(float(visits @ visits), visits.size),
            data.fill_ratio,
            errors.false_positive,
            errors.false_negative,
        )
    )
    truth = recording.runs["truth"][0]
    return decidability_of_share(seen.share, recording.scenario.decision.decision_boundary, truth, worth)


def _weights(data: Labelled) -> list[Floats]:
    """Return the weights of the samples in each bootstrap draw, robots (of a session) and tiles drawn separately.

    Draws without samples on one of the two kinds of tile are left out: they have no error rate.
    """
    robot = robot_clusters(pl.DataFrame({"run": data.session, "robot": data.robot}))
    tile = np.unique(data.tile, return_inverse=True)[1]
    drawn = (
        cluster_weights(_SEED, draw, 0, robot) * cluster_weights(_SEED, draw, 1, tile)
        for draw in range(RESAMPLES)
    )
    return [
        weights
        for weights in drawn
        if weights[data.vibrating].sum() > 0 and weights[~data.vibrating].sum() > 0
    ]
