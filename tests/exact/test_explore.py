"""Where robots of ``explore`` turn: the step that they expect, and the best of sixteen points, by the formulas."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.special import expit

from vibroswarm.strategies import explore
from vibroswarm.strategies.explore import Arrays, Params, choose_direction, on_sample

ROWS, COLUMNS, ROBOTS, TILE_M = 4, 5, 2, 0.2
TILES = ROWS * COLUMNS
WORLD: Any = SimpleNamespace(
    robots=ROBOTS, rows=ROWS, columns=COLUMNS, left_m=0.0, bottom_m=0.0, tile_width_m=TILE_M, tile_height_m=TILE_M,
    width_m=COLUMNS * TILE_M, height_m=ROWS * TILE_M,
)  # fmt: skip
PARAMS: Any = SimpleNamespace(
    range_m=Params.range_m, recent_s=Params.recent_s, sure_within=Params.sure_within
)


def memory() -> Any:
    sizes = {"robots": ROBOTS, "rows": ROWS, "columns": COLUMNS, "tiles": TILES}
    kinds = {name: array for base in reversed(Arrays.__mro__) for name, array in vars(base).items()}
    return SimpleNamespace(
        **{name: np.zeros(one.size(sizes)) for name, one in kinds.items() if not name.startswith("__")}
    )


def reading(number: int, x_m: float, y_m: float, **more: float) -> Any:
    values = {"heading_rad": 0.0, "spread_m": 0.0, "t_s": 100.0} | more
    return SimpleNamespace(number=number, x_m=x_m, y_m=y_m, **values)


def test_the_step_is_the_moving_average_of_the_distances_between_samples(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """0.15 m at first; of each distance an eighth is taken in."""
    monkeypatch.setattr(explore, "add_own", lambda *_: True)
    s, a = SimpleNamespace(step_m=explore.FIRST_STEP_M), memory()
    places = [(0.5, 0.4), (0.5, 0.1), (0.8, 0.5), (0.8, 0.5)]
    found = []
    for number, place in enumerate(places):
        on_sample(s, a, reading(number, *place), SimpleNamespace(), None, PARAMS, WORLD)  # type: ignore[arg-type]
        found.append(s.step_m)
    expected = [0.15]
    for distance_m in (0.3, 0.5, 0.0):
        expected.append(7 / 8 * expected[-1] + distance_m / 8)
    assert found == pytest.approx(expected)


def best_turn(s: Any, a: Any, x: Any) -> tuple[float, int]:
    """The turn of the greatest worth and the tile there, by the table of ``explore``, for all points at once."""
    turn = 2 * np.pi * np.arange(16) / 16
    turn = np.where(turn > np.pi, turn - 2 * np.pi, turn)
    at_x, at_y = (
        x.x_m + s.step_m * np.cos(x.heading_rad + turn),
        x.y_m + s.step_m * np.sin(x.heading_rad + turn),
    )
    vibrates = expit((a.weight[:, None] * a.odds[: ROBOTS * TILES].reshape(ROBOTS, TILES)).sum(axis=0))
    unsure = vibrates * (1 - vibrates) * np.where(x.t_s - a.visited_s < PARAMS.recent_s, 0.5, 1.0)
    row, column = np.divmod(np.arange(TILES), COLUMNS)
    away_m = np.hypot((column + 0.5) * TILE_M - at_x[:, None], (ROWS - 0.5 - row) * TILE_M - at_y[:, None])
    worth = (unsure * np.exp(-away_m / PARAMS.range_m)).sum(axis=1) * (1 - 0.3 * np.abs(turn) / np.pi)
    room_m = np.minimum.reduce([at_x, at_y, WORLD.width_m - at_x, WORLD.height_m - at_y])
    best = int(np.where(room_m < 0.07, -1.0, worth).argmax())
    return turn[best], int((ROWS - 1 - at_y[best] // TILE_M) * COLUMNS + at_x[best] // TILE_M)


def test_robots_turn_to_the_point_of_the_greatest_worth() -> None:
    random = np.random.default_rng(3)
    turns = set()
    for _ in range(200):
        a, s = memory(), SimpleNamespace(step_m=random.uniform(0.05, 0.3))
        a.odds[: ROBOTS * TILES] = random.normal(0.0, 2.0, ROBOTS * TILES)
        a.weight[:] = random.random(ROBOTS)
        a.visited_s[:] = random.uniform(50.0, 100.0, TILES)
        x = reading(
            1, random.uniform(0.1, 0.9), random.uniform(0.1, 0.7), heading_rad=random.uniform(-3.0, 3.0)
        )
        choose_direction(s, a, x, PARAMS, WORLD)
        assert (s.turn_rad, s.target) == pytest.approx(best_turn(s, a, x))
        turns.add(round(s.turn_rad, 6))
    assert len(turns) == 16
