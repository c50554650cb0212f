"""theta_E from labelled recordings: equal error, least error, given costs; and whether the floor can then be decided.

| name | symbol | equation |
|---|---|---|
| false positive, false negative | a(theta), b(theta) | share of still samples with E > theta, of vibrating ones with E <= theta |
| equal error | - | a(theta) = b(theta) |
| expected cost | - | c_a (1 - f) a(theta) + c_b f b(theta), f the fill ratio; least error: c_a = c_b = 1 |
| edge distance | - | from a sample to the nearest tile of the other kind |

A sample's label is that of the tile under the robot's centre. Samples are neither independent nor alike: robots and
tiles differ. So the interval resamples both, robots (of a session) and tiles, and a sample counts the product of how
often its robot and its tile were drawn; it speaks for other such robots and other such tiles.
"""  # noqa: E501

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.decidability import Decidability, decidability_of_share, observed_share
from vibroswarm.analysis.intervals import Interval, mean_interval
from vibroswarm.analysis.sampling import effective_samples, effective_with_sensor
from vibroswarm.draws import Purpose, uniforms
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.lab.recording import Recording, inside

Floats = NDArray[np.float64]

RESAMPLES: Final = 400
EDGES_M: Final = (0.0, 0.01, 0.02, 0.04, 0.06, np.inf)


@dataclass(frozen=True)
class Rates:
    """Error rates of samples at a threshold."""

    false_positive: float
    false_negative: float
    still: int
    vibrating: int


@dataclass(frozen=True)
class Threshold:
    """A threshold, how sure it is, what it does, and whether the floor can be decided with it."""

    rule: str
    value: float
    low: float
    high: float
    """95 %, over robots and tiles."""
    all_samples: Rates
    inner_samples: Rates
    """Those farther from a tile of the other kind than the margin."""
    share_by_session: Interval
    """Of ones, each tile counting alike; the session is the unit."""
    decidable: Decidability
    """From the pooled samples, as many independent ones as they are worth."""

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        share = self.share_by_session
        return {
            "rule": self.rule,
            "value": self.value,
            "low": self.low,
            "high": self.high,
            "all_samples": dict(self.all_samples.__dict__),
            "inner_samples": dict(self.inner_samples.__dict__),
            "share_by_session": {
                "estimate": share.estimate,
                "low": share.low if np.isfinite(share.low) else None,
                "high": share.high if np.isfinite(share.high) else None,
            },
            "decidable": self.decidable.as_dict(),
        }


@dataclass(frozen=True, eq=False)
class Labelled:
    """Samples on tiles, (samples,) each."""

    energy: Floats
    vibrating: NDArray[np.bool_]
    edge_m: Floats
    """To the nearest tile of the other kind; inf where there is none."""
    tile: NDArray[np.int64]
    session: NDArray[np.int64]
    robot: NDArray[np.int64]
    fill_ratio: float


def labelled(recording: Recording) -> Labelled:
    """The samples of a recording with the kind of the tile below.

    Raises:
        InputError: samples of one kind only.
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
        raise InputError("holds samples of one kind of tile only; both are needed", field="the recording")
    x, y = inside(frame["x_m"].to_numpy(), frame["y_m"].to_numpy(), recording.scenario)
    return Labelled(
        energy=frame["energy"].to_numpy(),
        vibrating=vibrating,
        edge_m=edge_distance(floor, x, y, vibrating),
        tile=tile,
        session=frame["run"].cast(pl.Int64).to_numpy(),
        robot=frame["robot"].cast(pl.Int64).to_numpy(),
        fill_ratio=float(recording.runs["fill_ratio"][0]),
    )


def edge_distance(floor: Floor, x_m: Floats, y_m: Floats, vibrating: NDArray[np.bool_]) -> Floats:
    """From each place to the nearest tile of the other kind than its own, m; inf where there is none."""
    rows, columns, width, height, left, bottom = floor.geometry
    nearest = np.full(x_m.size, np.inf)
    for row in range(rows):
        for column in range(columns):
            from_x, from_y = left + column * width, bottom + (rows - 1 - row) * height
            across = np.maximum(np.maximum(from_x - x_m, x_m - from_x - width), 0.0)
            up = np.maximum(np.maximum(from_y - y_m, y_m - from_y - height), 0.0)
            other = vibrating != bool(floor.tiles[row, column])
            nearest = np.where(other, np.minimum(nearest, np.hypot(across, up)), nearest)
    return nearest


def error_curves(
    energy: Floats, vibrating: NDArray[np.bool_], weight: Floats
) -> tuple[Floats, Floats, Floats]:
    """Thresholds (half-way between energies), a(theta) and b(theta) at them, weighted."""
    order = np.argsort(energy, kind="stable")
    sorted_energy, kind, w = energy[order], vibrating[order], weight[order]
    still, shaking = np.where(kind, 0.0, w), np.where(kind, w, 0.0)
    false_positive = 1.0 - np.cumsum(still) / still.sum()
    false_negative = np.cumsum(shaking) / shaking.sum()
    between = np.append(sorted_energy[1:], sorted_energy[-1] + 1.0)
    last = between > sorted_energy  # of equal energies only the last has a threshold after it
    thresholds = (sorted_energy + between) / 2
    return thresholds[last], false_positive[last], false_negative[last]


def equal_error(energy: Floats, vibrating: NDArray[np.bool_], weight: Floats) -> float:
    """The threshold at which both error rates cross."""
    thresholds, false_positive, false_negative = error_curves(energy, vibrating, weight)
    k = int(np.argmax(false_negative >= false_positive))
    if k == 0:
        return float(thresholds[0])
    before = false_positive[k - 1] - false_negative[k - 1]
    after = false_negative[k] - false_positive[k]
    share = before / (before + after) if before + after > 0 else 0.5
    return float(thresholds[k - 1] + share * (thresholds[k] - thresholds[k - 1]))


def least_cost(cost_false_positive: float, cost_false_negative: float) -> Callable[..., float]:
    """The rule that takes the threshold with the least expected cost; costs have to be above 0."""

    def rule(energy: Floats, vibrating: NDArray[np.bool_], weight: Floats, fill_ratio: float) -> float:
        thresholds, false_positive, false_negative = error_curves(energy, vibrating, weight)
        cost = (
            cost_false_positive * (1 - fill_ratio) * false_positive
            + cost_false_negative * fill_ratio * false_negative
        )
        # Costs of neighbouring thresholds are noisy: the middle of those that are as good as the best.
        good = np.flatnonzero(cost <= cost.min() + 1e-12)
        return float(thresholds[good].mean())

    return rule


def find_thresholds(
    recording: Recording,
    cost_false_positive: float = 1.0,
    cost_false_negative: float = 1.0,
    margin_m: float = 0.02,
) -> list[Threshold]:
    """theta_E by equal error, by least error, and by the costs where they differ from one another.

    Args:
        margin_m: samples nearer to a tile of the other kind are left out of ``inner_samples``.
    Raises:
        InputError: costs that are not above 0, samples of one kind only.
    """
    for cost in (cost_false_positive, cost_false_negative):
        if not (np.isfinite(cost) and cost > 0):
            raise InputError(f"{cost!r} is no cost; give a number above 0", field="cost")
    data = labelled(recording)
    rules: dict[str, Callable[[Floats, NDArray[np.bool_], Floats], float]] = {
        "equal error": equal_error,
        "least error": _with_fill(least_cost(1.0, 1.0), data.fill_ratio),
    }
    if cost_false_positive != cost_false_negative:
        name = f"costs {cost_false_positive:g} to {cost_false_negative:g}"
        rules[name] = _with_fill(least_cost(cost_false_positive, cost_false_negative), data.fill_ratio)
    return [_found(name, rule, data, recording, margin_m) for name, rule in rules.items()]


def _with_fill(rule: Callable[..., float], fill_ratio: float) -> Callable[..., float]:
    def fitted(energy: Floats, vibrating: NDArray[np.bool_], weight: Floats) -> float:
        return rule(energy, vibrating, weight, fill_ratio)

    return fitted


def _found(
    name: str, rule: Callable[..., float], data: Labelled, recording: Recording, margin_m: float
) -> Threshold:
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
    """What a threshold does, and whether the floor can be decided with it."""
    data = data or labelled(recording)
    inner = data.edge_m > margin_m
    bits = data.energy > value
    sessions = np.unique(data.session)
    by_session = [
        observed_share(data.tile[data.session == one], bits[data.session == one]).share for one in sessions
    ]
    return Threshold(
        rule=name,
        value=value,
        low=low,
        high=high,
        all_samples=rates(data, value, np.ones(bits.size, dtype=np.bool_)),
        inner_samples=rates(data, value, inner),
        share_by_session=mean_interval(by_session),
        decidable=_decidable(data, bits, value, recording),
    )


def rates(data: Labelled, threshold: float, chosen: NDArray[np.bool_]) -> Rates:
    """Error rates of the chosen samples; nan where there is none of a kind."""
    bits = data.energy > threshold
    still, shaking = chosen & ~data.vibrating, chosen & data.vibrating

    def share(of: NDArray[np.bool_], amiss: NDArray[np.bool_]) -> float:
        return float(amiss[of].mean()) if of.any() else float("nan")

    return Rates(share(still, bits), share(shaking, ~bits), int(still.sum()), int(shaking.sum()))


def edge_profile(data: Labelled, threshold: float) -> pl.DataFrame:
    """Error rates by the distance to the nearest tile of the other kind: from_m, to_m, and those of ``Rates``."""
    rows = []
    for from_m, to_m in pairwise(EDGES_M):
        found = rates(data, threshold, (data.edge_m >= from_m) & (data.edge_m < to_m))
        rows.append({"from_m": from_m, "to_m": to_m, **found.__dict__})
    return pl.DataFrame(rows)


def _decidable(
    data: Labelled, bits: NDArray[np.bool_], threshold: float, recording: Recording
) -> Decidability:
    seen = observed_share(data.tile, bits)
    count = np.bincount(data.tile)
    visits = count[count > 0] / data.tile.size
    found = rates(data, threshold, np.ones(bits.size, dtype=np.bool_))
    worth = float(
        effective_with_sensor(
            data.tile.size,
            effective_samples(float(visits @ visits), visits.size),
            data.fill_ratio,
            found.false_positive,
            found.false_negative,
        )
    )
    truth = recording.runs["truth"][0]
    return decidability_of_share(seen.share, recording.scenario.decision.decision_boundary, truth, worth)


def _weights(data: Labelled) -> list[Floats]:
    """Weights of the samples: robots (of a session) and tiles drawn with replacement, each for itself."""
    blocks = data.session * (int(data.robot.max()) + 1) + data.robot
    _, block = np.unique(blocks, return_inverse=True)
    _, tile = np.unique(data.tile, return_inverse=True)
    found = []
    for draw in range(RESAMPLES):
        weight = (
            _times_drawn(int(block.max()) + 1, draw, 0)[block]
            * _times_drawn(int(tile.max()) + 1, draw, 1)[tile]
        )
        if weight[data.vibrating].sum() > 0 and weight[~data.vibrating].sum() > 0:
            found.append(weight)
    return found


def _times_drawn(count: int, draw: int, which: int) -> Floats:
    u = uniforms(7, draw, which, Purpose.BOOTSTRAP, count)
    return np.bincount((u * count).astype(np.int64), minlength=count).astype(float)
