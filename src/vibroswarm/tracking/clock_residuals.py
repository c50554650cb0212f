"""How the samples of a robots' log and the stops that a camera saw fit together, one by one."""

from __future__ import annotations

from typing import Final

import numpy as np
import polars as pl

from vibroswarm.tracking.stops import MATCH_S, ClockOffset

FAR_S: Final = 3.0
SAMPLES_MATCHED: Final = {
    "robot": pl.Int64, "time_s": pl.Float64, "stop_end_s": pl.Float64, "residual_s": pl.Float64,
}  # fmt: skip
"""A row a sample: when it was taken on the video's clock; the end of its stop, null without one; and by how much the
sample is later than a control period before that, null too if the end was not seen."""


def match_samples(
    stops: pl.DataFrame, samples: pl.DataFrame, offset: ClockOffset
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Match each sample with the nearest end of a stop of its robot, within ``MATCH_S``; each stop at most once.

    A sample during a stop whose end was hidden, or ``FAR_S`` after it was seen last, belongs to that stop.

    Args:
        stops: ``stops.STOPS``. samples: robot and time_s (by the robots' clock).
    Returns: ``SAMPLES_MATCHED``, in the order of time, and the stops that no sample matches.
    """
    rows: list[tuple[int, float, float | None, float | None]] = []
    unmatched = []
    for robot in sorted({*stops["robot"].unique().to_list(), *samples["robot"].unique().to_list()}):
        of_robot = stops.filter(pl.col("robot") == robot)
        own = of_robot.filter(pl.col("end_seen"))
        hidden = of_robot.filter(~pl.col("end_seen")).select("start_s", "end_s").rows()
        ends = own["end_s"].to_numpy() - offset.control_period_s  # when it has sampled
        taken = np.sort(samples.filter(pl.col("robot") == robot)["time_s"].to_numpy() - offset.offset_s)
        apart = np.abs(taken[:, None] - ends[None, :])
        partner: dict[int, int] = {}
        for flat in np.argsort(apart, axis=None, kind="stable").tolist():
            sample, stop = divmod(flat, max(ends.size, 1))
            if apart[sample, stop] > MATCH_S:
                break
            if sample not in partner and stop not in partner.values():
                partner[sample] = stop
        for k, time_s in enumerate(taken.tolist()):
            during = [end for start, end in hidden if start <= time_s <= end + FAR_S]
            if k in partner:
                rows.append(
                    (robot, time_s, float(own["end_s"][partner[k]]), time_s - float(ends[partner[k]]))
                )
            else:
                rows.append((robot, time_s, during[0] if during else None, None))
        free = [k not in set(partner.values()) for k in range(ends.size)]
        unmatched.append(own.filter(pl.Series(free, dtype=pl.Boolean)))
    matched = pl.DataFrame(rows, schema=SAMPLES_MATCHED, orient="row").sort("time_s", "robot")
    return matched, pl.concat(unmatched).sort("end_s", "robot") if unmatched else stops.clear()
