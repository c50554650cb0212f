"""Choose the sensor's threshold theta_E by equal error from a recording on a known floor; is the floor decidable?

The label of a sample is the kind of the tile under the robot's centre. False positives a(theta) are the share of still
samples with E > theta, false negatives b(theta) that of vibrating ones with E <= theta; at equal error a = b. The
bootstrap resamples robots (of each session) and tiles, so that limits hold for other such robots and tiles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Bools, Floats, Ints
from vibroswarm.core.rng import Purpose, uniforms
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor, refuse_changes, refuse_kinds
from vibroswarm.recordings.recording import Recording
from vibroswarm.statistics.decidability import Decidability, decidability_of_share, observed_share
from vibroswarm.statistics.intervals import Interval, bounded_mean, student_factor
from vibroswarm.statistics.sampling import effective_samples, effective_with_sensor


def resample(seed: int, draw: int, stream: int, count: int) -> Ints:
    """Draw ``count`` indices from 0 to ``count`` - 1 with replacement."""
    return (uniforms(seed, draw, stream, Purpose.BOOTSTRAP, count) * count).astype(np.int64)


def cluster_weights(seed: int, draw: int, stream: int, cluster: Ints) -> Floats:
    """Resample clusters (indices from 0); return how often the cluster of each row was drawn, (rows,)."""
    clusters = int(cluster.max()) + 1
    return np.bincount(resample(seed, draw, stream, clusters), minlength=clusters)[cluster].astype(float)


def robot_clusters(samples: pl.DataFrame) -> Ints:
    """Return the index of each sample's robot in its run, from 0, (samples,), from the columns run and robot."""
    pairs = samples.select(pl.col("run", "robot").cast(pl.Int64)).to_numpy()
    # The index of each row's pair among the distinct pairs. NumPy 2.0 returns it as (samples, 1), hence ``ravel``.
    return np.unique(pairs, axis=0, return_inverse=True)[1].ravel()


RESAMPLES: Final = 400
_SEED: Final = 7
"""Seed of the bootstrap; it is fixed, so that a recording always has the same limits."""


class Rates(NamedTuple):
    """Shares of the samples that are read wrong; nan for a kind of tile without samples."""

    false_positive: float
    false_negative: float


@dataclass(frozen=True)
class Threshold:
    """A threshold with its interval, its error rates, and whether the floor can be decided with it."""

    rule: str
    value: float
    low: float
    high: float
    """95 % limits; nan for a given threshold."""
    all_samples: Rates
    share_by_session: Interval
    """Share of ones with equal weight for each tile: mean over sessions, whose limits are infinite for one session."""
    decidable: Decidability
    """From the samples of all sessions, with their effective number, for other such robots on this floor."""

    @property
    def decimals(self) -> int:
        """Decimals with which it is written: three, as robots log energies; more if it has not four digits then."""
        return max(3, 3 - math.floor(math.log10(self.value))) if self.value > 0 else 3

    @property
    def tells_kinds_apart(self) -> bool:
        """Whether samples on vibrating tiles read as vibrating more often than those on still tiles."""
        return self.all_samples.false_positive + self.all_samples.false_negative < 1.0


@dataclass(frozen=True, eq=False)
class Labelled:
    """The samples on tiles, with the kind of their tile; (samples,) each."""

    energy: Floats
    vibrating: Bools
    tile: Ints
    session: Ints
    robot: Ints
    """Index of the robot, from 0; it is another one in each session."""
    fill_ratio: float


def labelled(recording: Recording) -> Labelled:
    """Return the samples of a recording that lie on tiles, which must be of two kinds."""
    key = ["run", "robot", "sample"]
    tiles = recording.observations.select(*key, "tile")
    frame = recording.rows.join(tiles, on=key, maintain_order="left").filter(pl.col("tile") >= 0)
    if frame["energy"].null_count():
        raise InputError("holds bits, of which there is no threshold", field="the recording")
    floor = recording.floor(int(recording.runs["run"][0]))  # all sessions have the same floor
    tile = frame["tile"].cast(pl.Int64).to_numpy()
    refuse_changes(floor)
    refuse_kinds(floor)
    vibrating = floor.tiles.ravel()[tile] == 1
    if vibrating.all() or not vibrating.any():
        raise InputError("has samples on one kind of tile only; both are needed", field="the recording")
    return Labelled(
        energy=frame["energy"].to_numpy(),
        vibrating=vibrating,
        tile=tile,
        session=frame["run"].cast(pl.Int64).to_numpy(),
        robot=robot_clusters(frame),
        fill_ratio=floor.fill_ratio_within(*recording.scenario.arena.size_m),
    )


def edge_distance(floor: Floor, x_m: Floats, y_m: Floats, vibrating: Bools) -> tuple[Floats, Ints]:
    """Find the nearest tile of the other kind to each place: its distance, m, and index, (places,) each.

    Without tiles of the other kind they are inf and -1.
    """
    rows, columns, width, height, left, bottom = floor.geometry
    # Lower left corners of the tiles, which are numbered row by row from the top.
    row, column = np.divmod(np.arange(rows * columns), columns)
    left_m, bottom_m = left + column * width, bottom + (rows - 1 - row) * height
    dx, dy = _outside(x_m, left_m, width), _outside(y_m, bottom_m, height)
    is_other = vibrating[:, None] != (floor.tiles.ravel() != 0)
    away_m = np.where(is_other, np.hypot(dx, dy), np.inf)  # (places, tiles)
    distance_m = away_m.min(axis=1)
    return distance_m, np.where(np.isfinite(distance_m), away_m.argmin(axis=1), -1)


def _outside(places_m: Floats, begins_m: Floats, size_m: float) -> Floats:
    """Return how far each place is from each interval of a size, along one axis, (places, intervals)."""
    before = begins_m - places_m[:, None]
    return np.maximum(np.maximum(before, -before - size_m), 0.0)


def equal_error(energy: Floats, vibrating: Bools, weight: Floats) -> float:
    """Compute the threshold at which both error rates are equal, by linear interpolation between thresholds.

    Thresholds lie half-way between neighbouring energies. Both kinds of tile must have weight.
    """
    order = np.argsort(energy, kind="stable")
    sorted_energy, kind, w = energy[order], vibrating[order], weight[order]
    # The next larger energy; any larger number serves for the last, whose threshold only has to lie above it.
    following = np.append(sorted_energy[1:], sorted_energy[-1] + 1.0)
    is_last = following > sorted_energy  # only the last of equal energies is followed by a threshold
    thresholds = ((sorted_energy + following) / 2)[is_last]
    on_still, on_vibrating = np.where(kind, 0.0, w), np.where(kind, w, 0.0)
    false_positive = (1.0 - np.cumsum(on_still) / on_still.sum())[is_last]
    false_negative = (np.cumsum(on_vibrating) / on_vibrating.sum())[is_last]
    # The first threshold at which b, which never falls, is not below a, which never rises. There is one, since at the
    # last threshold b is 1 and a is 0, but for rounding.
    k = int(np.argmax(false_negative >= false_positive))
    if k == 0:
        return float(thresholds[0])
    # a lies above b at threshold k - 1, and b above a, or at it, at threshold k.
    before = false_positive[k - 1] - false_negative[k - 1]
    after = false_negative[k] - false_positive[k]
    return float(thresholds[k - 1] + before / (before + after) * (thresholds[k] - thresholds[k - 1]))


def find_threshold(recording: Recording, data: Labelled | None = None) -> Threshold:
    """Find theta_E by equal error, with limits from a bootstrap over robots and tiles."""
    data = data or labelled(recording)
    value = equal_error(data.energy, data.vibrating, np.ones(data.energy.size))
    resampled = [equal_error(data.energy, data.vibrating, weight) for weight in _weights(data)]
    # Without a draw (one kind of tile never got weight), the limits are the threshold itself.
    low, high = np.quantile(resampled or [value], (0.025, 0.975)).tolist()
    return at_threshold(recording, value, data, name="equal error", low=low, high=high)


def at_threshold(
    recording: Recording,
    value: float,
    data: Labelled | None = None,
    *,
    name: str = "given",
    low: float = float("nan"),
    high: float = float("nan"),
) -> Threshold:
    """Compute the error rates at a threshold, and whether the floor can be decided with it."""
    data = data or labelled(recording)
    bits = data.energy > value
    by_session = [
        observed_share(data.tile[data.session == session], bits[data.session == session])
        for session in np.unique(data.session)
    ]
    errors, share = rates(data, value), bounded_mean(by_session)
    return Threshold(name, value, low, high, errors, share, _decidable(data, bits, errors, recording))


def rates(data: Labelled, threshold: float, chosen: Bools | None = None) -> Rates:
    """Compute the error rates of samples, of all or of the chosen ones, at a threshold."""
    bits, counts = data.energy > threshold, np.ones(data.energy.size, np.bool_) if chosen is None else chosen
    still, vibrating = counts & ~data.vibrating, counts & data.vibrating
    return Rates(share_of(bits, still), share_of(~bits, vibrating))


def share_of(is_wrong: Bools, samples: Bools) -> float:
    """Return the share of wrong ones among some samples; nan if there are none."""
    return float(is_wrong[samples].mean()) if samples.any() else float("nan")


def unseen_errors(recording: Recording, data: Labelled | None = None) -> pl.DataFrame:
    """Return session (from 1), threshold of the others, and its error rates; without sessions of one kind of tile."""
    data, rows = data or labelled(recording), []
    for session in np.unique(data.session):
        own = data.session == session
        if all(len(np.unique(data.vibrating[some])) == 2 for some in (own, ~own)):
            value = equal_error(data.energy[~own], data.vibrating[~own], np.ones(int((~own).sum())))
            rows.append((int(session) + 1, value, *rates(data, value, own)))
    names = ("session", "threshold", "false_positive", "false_negative")
    return pl.DataFrame(rows, schema=names, orient="row")


@dataclass(frozen=True)
class Recommendation:
    """A threshold of a recording, and how it does beside others."""

    thresholds: tuple[Threshold, ...]
    """By equal error, and the given one if there is one."""
    in_use: Threshold
    """At the threshold of the recording, or of the scenario that it was read with if neither user nor logs told it."""
    unseen: pl.DataFrame
    """How each session is judged by the threshold of the others (``unseen_errors``)."""
    law: pl.DataFrame | None = None
    """Table of the law of the sensor (``laws.law_table``); None: it was not fitted."""

    @property
    def chosen(self) -> Threshold:
        """The given one, else that of equal error."""
        return self.thresholds[-1]


def recommend(recording: Recording, at: float | None = None) -> Recommendation:
    """Recommend a threshold: that of equal error, or ``at``."""
    data = labelled(recording)
    given = () if at is None else (at_threshold(recording, at, data),)
    field = "sensor.rms_threshold"
    name = "in use" if recording.knows(field) else "of the scenario"
    return Recommendation(
        thresholds=(find_threshold(recording, data), *given),
        in_use=at_threshold(recording, recording.scenario[field], data, name=name),
        unseen=unseen_errors(recording, data),
    )


def _decidable(data: Labelled, bits: Bools, errors: Rates, recording: Recording) -> Decidability:
    """The share of ones is the mean over visited tiles of each tile's share.

    Its interval is that of n_eff independent samples (``effective_with_sensor``): tiles are visited unequally often,
    and bits are wrong. Robots differ, so that n_eff is at most the number that gives the share the error that it has
    by how far robots, on the same tiles, are apart.
    """
    observed = observed_share(data.tile, bits)
    count = np.bincount(data.tile)
    visits = count[count > 0] / data.tile.size  # w_t: share of the samples on each visited tile
    effective = float(
        effective_with_sensor(
            samples=data.tile.size,
            effective_visits=effective_samples(float(visits @ visits), visits.size),
            fill_ratio=data.fill_ratio,
            false_positive=errors.false_positive,
            false_negative=errors.false_negative,
        )
    )
    tile = np.unique(data.tile, return_inverse=True)[1]
    visited = np.bincount(tile)
    apart = (bits - (np.bincount(tile, bits) / visited)[tile]) / (visited[tile] * visited.size)
    by_robot = np.bincount(
        data.robot, apart
    )  # what each adds to the share of ones, beyond the share of its tiles
    n = by_robot.size
    error = student_factor(n, 0.95) * math.sqrt(n / (n - 1) * float(by_robot @ by_robot)) if n > 1 else 0.0
    if error > 0.0:
        effective = min(effective, observed * (1.0 - observed) / error**2)
    truth = recording.runs["truth"][0]  # all sessions have the same floor
    boundary = recording.scenario.decision.decision_boundary
    return decidability_of_share(observed, boundary, truth, effective_samples=effective)


def _weights(data: Labelled) -> list[Floats]:
    """Return weights of the samples in each bootstrap draw; draws without weight on a kind of tile are left out."""
    tile = np.unique(data.tile, return_inverse=True)[1]
    drawn = (
        cluster_weights(_SEED, draw, stream=0, cluster=data.robot)
        * cluster_weights(_SEED, draw, stream=1, cluster=tile)
        for draw in range(RESAMPLES)
    )
    return [
        weights
        for weights in drawn
        if weights[data.vibrating].sum() > 0 and weights[~data.vibrating].sum() > 0
    ]
