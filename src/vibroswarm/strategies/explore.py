"""Explore: the strategy ``places``, with robots that drive to where their map is least certain.

After each own sample a robot that is sure of its place compares points on a circle around it. The circle's radius is
the distance that it drives between two samples. The robot turns to the point of the greatest worth by its own map. Each
message names the tile that its sender drives to, and this tile is then worth less to the others. Map, messages, trust
and decision are those of ``places``.

A robot that is unsure of its place drives straight on, until walls tell it where it is. Otherwise it would stay far
from walls around one spot, where the errors of its places are large and alike, and take the readings of a vibrating
tile for those of several tiles around it.

| name | symbol | unit | equation |
|---|---|---|---|
| map | p_t | - | as of ``places`` |
| uncertainty of tile t | U_t | - | p_t (1 - p_t), halved for ``recent_s`` after an own sample or a message's target |
| step | d | m | moving average of the distance between two samples, with a memory of 8 samples; it begins at 15 cm |
| unsure of its place | - | - | standard deviation above ``sure_within`` times the shorter side of a tile |
| points | - | - | (x, y) + d (cos, sin) of the heading + 2 pi k / 16, 7 cm from walls or farther |
| worth of a point | - | - | sum over tiles of U_t exp(-distance of the tile's middle / ``range_m``), \
less the share 0.3 of it for a half turn, and proportionally less for smaller turns |

- Message: as of ``places``, and the tile (1 byte): 9 bytes.
- What a robot is told about its task: as in ``places``, and the size of the arena.
"""

from __future__ import annotations

import math
from typing import Annotated, Final

from pydantic import Field

from vibroswarm.strategies import places
from vibroswarm.strategies.base import array, register, strategy_in
from vibroswarm.strategies.bayes import Row, decision
from vibroswarm.strategies.place_map import logistic, total_odds
from vibroswarm.strategies.places import begin as begin_map
from vibroswarm.strategies.places import belief
from vibroswarm.strategies.places import on_message as add_heard
from vibroswarm.strategies.places import on_sample as add_own
from vibroswarm.strategies.world import Draws, Reading, World

DIRECTIONS: Final = 16
"""Number of directions compared."""
MARGIN_M: Final = 0.07
"""Least distance of the points compared from walls."""
TURN_COST: Final = 0.3
"""Share of a point's worth that a half turn costs."""
FIRST_STEP_M: Final = 0.15
"""Distance between two samples, before the robot knows it."""
STEP_MEMORY: Final = 0.125
"""Weight of the latest distance in the moving average of the step: 1 / 8."""
UNTIL_SAMPLE_MS: Final = 1e6
"""A drive longer than any time between samples: the next sample ends it."""


# Fields of this module come first in the rows: Numba would take a row that begins like one of places for one of places.
class Choice:
    """How to choose a direction."""

    range_m: Annotated[
        float,
        Field(
            gt=0,
            le=1000,
            description="Distance over which a tile's worth falls by a factor e: longer for larger tiles.",
        ),
    ] = 0.1
    recent_s: Annotated[
        float,
        Field(
            ge=0,
            le=1e6,
            description="Time for which a tile is worth half after the robot sampled or another drove there, s: longer "
            "for slower robots.",
        ),
    ] = 25.0
    sure_within: Annotated[
        float,
        Field(
            gt=0,
            le=1000,
            description="Standard deviation of its place above which a robot drives straight on, until walls tell it "
            "where it is, in sides of a tile.",
        ),
    ] = 0.25


class Params(places.Params, Choice):
    """Those of ``places``, and how to choose a direction."""


class Course:
    """The turn to make, the tile that the robot drives to (-1: none), the last place, the step."""

    turn_rad: float
    target: int
    last_x_m: float
    last_y_m: float
    step_m: float


class State(places.State, Course):
    """That of ``places``, and where the robot drives."""


class Arrays(places.Arrays):
    """Those of ``places``; for each tile, when this robot last sampled there or a message last named it as its sender's
    target; and scratch: how unsure each tile is.
    """

    visited_s = array("float64", "tiles")
    uncertainty = array("float64", "tiles")


class Target:
    """The tile that the robot drives to; -1: none."""

    target: int


class Message(places.Message, Target):
    """That of ``places``, and where the robot drives to."""


def begin(s: Row, a: Row, d: Draws, p: Row, w: World) -> None:
    """Begin with an empty map, undecided, without a target, and with all tiles not visited recently."""
    begin_map(s, a, d, p, w)
    s.target, s.step_m = -1, FIRST_STEP_M
    # A visit at -recent_s is no longer recent at time 0.
    for t in range(w.rows * w.columns):
        a.visited_s[t] = -p.recent_s


def on_message(s: Row, a: Row, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """Add another robot's sample to the map, and treat its target, ``m.target`` (-1: none), as visited now."""
    if m.target >= 0:
        a.visited_s[m.target] = t_s
    add_heard(s, a, m, sender, t_s, d, p, w)


def on_sample(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Add the sample of ``localisation.lag`` samples ago to the map and send it, decide, and choose where to drive."""
    sends: bool = add_own(s, a, x, out, d, p, w)
    if x.number > 0:
        # Update the moving average of the step by the distance from the place of the sample before.
        along_m, aside_m = x.x_m - s.last_x_m, x.y_m - s.last_y_m
        s.step_m += STEP_MEMORY * (math.sqrt(along_m * along_m + aside_m * aside_m) - s.step_m)
    s.last_x_m, s.last_y_m = x.x_m, x.y_m
    a.visited_s[tile_at(x.x_m, x.y_m, w)] = x.t_s
    choose_direction(s, a, x, p, w)
    out.target = s.target
    return sends


def steer(s: Row, a: Row, x: Reading, d: Draws, p: Row, w: World) -> tuple[float, float]:
    """Return the turn to the best point in degrees, and how long to drive in ms.

    The turn is nan if that point is straight ahead, or if none was chosen. The robot then resumes what its stop
    interrupted (``robot.walk.steered``): it drives straight on or, if it was turning or avoiding an obstacle, finishes
    that turn before it drives, and so may miss the point.
    """
    return math.nan if s.turn_rad == 0.0 else math.degrees(s.turn_rad), UNTIL_SAMPLE_MS


def choose_direction(s: Row, a: Row, x: Reading, p: Row, w: World) -> None:
    """Set ``s.turn_rad`` and ``s.target`` for the point of the greatest worth; 0 and -1 if there is none."""
    s.target, s.turn_rad = -1, 0.0
    if x.spread_m > p.sure_within * min(w.tile_width_m, w.tile_height_m):
        return
    for t in range(w.rows * w.columns):
        probability = logistic(total_odds(a, t, w) + a.prior_odds[0])
        a.uncertainty[t] = probability * (1.0 - probability)
        if x.t_s - a.visited_s[t] < p.recent_s:
            a.uncertainty[t] *= 0.5
    most = -1.0  # greatest worth so far; no worth is negative
    for k in range(DIRECTIONS):
        # The turn to point k, between -pi and pi, so that its size says how far the robot has to turn.
        turn_rad = 2.0 * math.pi * k / DIRECTIONS
        if turn_rad > math.pi:
            turn_rad -= 2.0 * math.pi
        x_m = x.x_m + s.step_m * math.cos(x.heading_rad + turn_rad)
        y_m = x.y_m + s.step_m * math.sin(x.heading_rad + turn_rad)
        if min(x_m, y_m, w.width_m - x_m, w.height_m - y_m) < MARGIN_M:
            continue
        worth = 0.0
        for t in range(w.rows * w.columns):
            # from the point to the middle of the tile; row 0 is the top
            along_m = w.left_m + (t % w.columns + 0.5) * w.tile_width_m - x_m
            aside_m = w.bottom_m + (w.rows - 0.5 - t // w.columns) * w.tile_height_m - y_m
            away_m = math.sqrt(along_m * along_m + aside_m * aside_m)
            worth += a.uncertainty[t] * math.exp(-away_m / p.range_m)
        worth *= 1.0 - TURN_COST * abs(turn_rad) / math.pi
        if worth > most:
            most, s.turn_rad, s.target = worth, turn_rad, tile_at(x_m, y_m, w)


def tile_at(x_m: float, y_m: float, w: World) -> int:
    """Return the tile at a place, or the nearest one off the grid: row * columns + column, the top row first."""
    column = min(max(int((x_m - w.left_m) / w.tile_width_m), 0), w.columns - 1)
    row = min(max(int(w.rows - (y_m - w.bottom_m) / w.tile_height_m), 0), w.rows - 1)
    return row * w.columns + column


explore = register(
    strategy_in(
        __name__,
        "explore",
        belief=belief,
        decision=decision,
        bytes_on_air=9,
        knows_error_rates=True,
        reports=("p", "weight"),
        about="explore: places, whose robots drive to where their map is least sure",
    )
)
