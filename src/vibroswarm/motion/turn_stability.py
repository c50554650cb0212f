"""Stability of a scenario's turns in place: the closed loop of the turn controller.

| name | symbol | unit | equation |
|---|---|---|---|
| turn gain | G | deg a tick and % | degrees turned in a control period by a command of 1 %, of the fastest robot |
| gains | Kp, Ki | %/deg, %/(deg s) | `walk.turn_gain_percent_per_deg`, `walk.turn_integral_gain_percent_per_deg_s` |
| loop | e, I | deg, deg s | e' = e - G (Kp e + Ki I), I' = I + dt e' below full command, as in `robot.walk` |
| bound | - | - | its eigenvalues lie within the unit circle just when G (2 Kp + dt Ki) < 4 (Jury's criterion) |

Where they do not, each step makes the last bits of a turn larger: after some tens of steps two accounts of one run
part, though both are right. So the engines are the same in every event only where turns are stable. A turn that
cannot pass its tolerance within one step ends at its first pass, and nothing grows.
"""

from __future__ import annotations

import math

from vibroswarm.scenario.scenario import Scenario


def turn_gain_deg(scenario: Scenario) -> float:
    """Return G: degrees that the fastest robot turns in a control period at a command of 1 %."""
    robot = scenario.robot
    fastest = robot.full_speed_m_s * robot.speed_factor_max
    return math.degrees(2.0 * 0.01 * fastest / robot.turn_track_m * scenario.tick_s)


def spectral_radius(scenario: Scenario) -> float:
    """Return the largest absolute eigenvalue of a step of the turn controller below full command; stable below 1.

    Without an integral gain it is that of the error alone, as the integral then has no effect.
    """
    gain = turn_gain_deg(scenario)
    p = gain * scenario.walk.turn_gain_percent_per_deg
    q = gain * scenario.walk.turn_integral_gain_percent_per_deg_s * scenario.tick_s
    if q == 0.0:
        return abs(1.0 - p)
    trace, determinant = 2.0 - p - q, 1.0 - p
    beyond = 0.25 * trace * trace - determinant
    if beyond <= 0.0:
        return math.sqrt(determinant)
    return 0.5 * abs(trace) + math.sqrt(beyond)


def is_stable(scenario: Scenario) -> bool:
    """Return whether ``spectral_radius`` is below 1, by the bound, which is insensitive to rounding near 1."""
    walk = scenario.walk
    gains = 2.0 * walk.turn_gain_percent_per_deg
    gains += scenario.tick_s * walk.turn_integral_gain_percent_per_deg_s
    return turn_gain_deg(scenario) * gains < 4.0


def passes_tolerance(scenario: Scenario) -> bool:
    """Return whether the fastest robot at full command may cross the whole tolerance in one step."""
    return 100.0 * turn_gain_deg(scenario) > 2.0 * scenario.walk.turn_tolerance_deg


def scenario_warnings(scenario: Scenario) -> list[str]:
    """Return warnings about a valid scenario that is hardly what was meant; one sentence each."""
    if is_stable(scenario) or not passes_tolerance(scenario):
        return []
    walk = scenario.walk
    gain, integral = walk.turn_gain_percent_per_deg, walk.turn_integral_gain_percent_per_deg_s
    most, radius = 4.0 / turn_gain_deg(scenario), spectral_radius(scenario)
    return [
        f"turns are not stable: robots swing about the angle they turn to (spectral radius {radius:.3g}), and rounding "
        "grows in each swing, so that other machines or engines may give other runs; 2 "
        f"walk.turn_gain_percent_per_deg + run.control_period_ms / 1000 walk.turn_integral_gain_percent_per_deg_s is "
        f"{2.0 * gain + scenario.tick_s * integral:.4g}, and must be below {most:.4g}"
    ]
