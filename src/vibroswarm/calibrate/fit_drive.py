"""Speed, battery and veer in closed form; which of the scenario's fields they give.

| field | equation |
|---|---|
| robot.speed_factor_location, _scale (shape 100: nearly normal), _min, _max | mean and spread between robots of v_0 / full speed; 3 spreads |
| robot.speed_redraw | "robot" where over half of the variance is between robots |
| robot.speed_wander | spread within robots / speed, where speed_redraw is "robot" |
| robot.battery_life_s | 1 / (share lost a second): v = v_0 (1 - t / life), least squares for each robot and session |
| robot.misalignment_min, _max | m = w track / (2 v); uniform of the same mean and spread: mean -+ sqrt(3) spread |

What is left within a robot is taken to be new at every sample (its lag-1 correlation is 0.18 in the study's recordings);
a veer that wanders within a robot the scenario lacks. Errors: robots in sessions drawn anew.
"""  # noqa: E501

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.calibrate.measured import Measured
from vibroswarm.draws import Purpose, uniforms
from vibroswarm.errors import InputError
from vibroswarm.scenario import Scenario

Floats = NDArray[np.float64]
SHAPE: Final = 100.0
DRAWS: Final = 200
_SEED: Final = 32
_LEAST: Final = 10
"""Drives of a robot in a session from which on it counts."""


@dataclass(frozen=True)
class DriveFit:
    """Figures by name and their draws, (draws,)."""

    values: dict[str, float]
    draws: dict[str, Floats]

    def fields(self, base: Scenario) -> dict[str, object]:
        """The scenario's fields that these figures give."""
        robot, found = base.robot, self.values
        mean = found["start_speed_m_s"] / robot.full_speed_m_s
        kept = found["share_between"] > 0.5
        spread = (found["between_m_s"] if kept else found["within_m_s"]) / robot.full_speed_m_s
        spread = max(spread, 1e-3)
        fields: dict[str, object] = {
            "robot.speed_factor_shape": SHAPE,
            "robot.speed_factor_scale": _round(spread / np.sqrt(SHAPE)),
            "robot.speed_factor_location": _round(mean - spread * np.sqrt(SHAPE)),
            "robot.speed_factor_min": _round(max(mean - 3 * spread, 0.2 * mean)),
            "robot.speed_factor_max": _round(mean + 3 * spread),
            "robot.speed_redraw": "robot" if kept else "sample",
            "robot.speed_wander": _round(min(found["within_m_s"] / found["speed_m_s"], 0.4))
            if kept
            else None,
            "robot.battery_life_s": _round(max(found["battery_life_s"], 1.01 * base.run.t_end_s), 0),
        }
        if "veer_rad_s" in found:
            per = robot.drive_track_m / (2.0 * found["start_speed_m_s"])
            middle, half = found["veer_rad_s"] * per, np.sqrt(3.0) * found["veer_between_rad_s"] * per
            fields["robot.misalignment_min"] = _round(max(middle - half, -0.5))
            fields["robot.misalignment_max"] = _round(min(middle + half, 0.5))
        return fields


def _round(value: float, digits: int = 5) -> float:
    return round(float(value), digits)


def fit_drive(found: Measured, draws: int = DRAWS) -> DriveFit:
    """Fit.

    Raises:
        InputError: fewer than two robots with ten drives.
    """
    table = _by_robot(found.drives)
    if len(table) < 2:
        raise InputError("at least two robots with ten drives each are needed to fit speeds", field="REAL")
    values = _figures(table)
    kept: dict[str, list[float]] = {name: [] for name in values}
    for draw in range(draws):
        picked = (uniforms(_SEED, draw, 0, Purpose.BOOTSTRAP, len(table)) * len(table)).astype(int)
        for name, value in _figures(table[picked]).items():
            kept[name].append(value)
    return DriveFit(values, {name: np.array(one) for name, one in kept.items()})


def _by_robot(drives: pl.DataFrame) -> Floats:
    """(robots in sessions, 5): mean speed, speed at the start, share lost a second, spread within, veer (nan: none)."""
    rows = []
    for _, own in drives.group_by("run", "robot", maintain_order=True):
        if own.height < _LEAST:
            continue
        time, speed = own["time_s"].to_numpy(), own["speed_m_s"].to_numpy()
        slope, start = np.polyfit(time, speed, 1)
        within = float(np.sqrt(((speed - start - slope * time) ** 2).mean()))
        veer = own["veer_rad_s"].drop_nulls().to_numpy()
        turns = float(veer.mean()) if veer.size >= _LEAST else np.nan
        rows.append((float(speed.mean()), start, -slope / start, within, turns))
    return np.array(rows).reshape(-1, 5)


def _figures(table: Floats) -> dict[str, float]:
    mean, start, lost, within, veer = table.T
    between = float(start.std(ddof=1))
    inside = float(np.sqrt((within**2).mean()))
    found = {
        "speed_m_s": float(mean.mean()),
        "start_speed_m_s": float(start.mean()),
        "between_m_s": between,
        "within_m_s": inside,
        "share_between": between**2 / (between**2 + inside**2) if between + inside > 0 else 0.0,
        "battery_life_s": 1.0 / max(float(lost.mean()), 1e-9),
    }
    known = veer[np.isfinite(veer)]
    if known.size > 1:
        found |= {"veer_rad_s": float(known.mean()), "veer_between_rad_s": float(known.std(ddof=1))}
    return found
