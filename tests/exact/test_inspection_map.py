"""The map of tiles against the enumeration of all 2^9 floors of 3 x 3 tiles, and Bayes' rule; files of people."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vibroswarm as v
from helpers.inspections import drawn_samples, enumerated
from vibroswarm.errors import InputError
from vibroswarm.inspection.inspection import Inspection, inspect
from vibroswarm.inspection.samples import Samples
from vibroswarm.inspection.tile_map import any_but_still, kind_map, tile_map
from vibroswarm.observation.energy_model import rates
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.statistics.map_figures import map_scores

FLOORS = range(30)
EXAMPLE = Path(__file__).parents[2] / "examples" / "inspection"
KINDS: dict[str, Any] = {
    "strategy.name": "dirichlet", "task.name": "majority", "floor.source": "random:0.4,0.36,0.24", "run.t_end_s": 300.0,
    "sensor.model": "confusion", "sensor.confusion.accuracy": 0.7,
}  # fmt: skip


def last_map(samples: Samples) -> np.ndarray:
    return tile_map(samples, [np.inf])[0]


def test_exact_places_give_the_exact_map() -> None:
    for seed in FLOORS:
        samples = drawn_samples(seed, count=60, spread_m=0.0)
        assert abs(last_map(samples) - enumerated(samples)).max() < 1e-9


@pytest.mark.parametrize(("tile_m", "count", "worst"), [(0.2, 60, 0.08), (0.2, 200, 0.002), (0.1, 200, 0.05)])
def test_the_map_is_close_to_the_enumeration_and_that_of_exact_places_is_not(
    tile_m: float, count: int, worst: float
) -> None:
    errors, errors_of_exact, scores = [], [], []
    for seed in FLOORS:
        samples = drawn_samples(seed, count=count, spread_m=0.03, tile_m=tile_m)
        exact, found = enumerated(samples), last_map(samples)
        sure = last_map(samples.with_columns(spread_x_m=np.zeros(count), spread_y_m=np.zeros(count)))
        errors.append(abs(found - exact).max())
        errors_of_exact.append(abs(sure - exact).max())
        scores.append([map_scores(p, samples.grid)["brier"] for p in (exact, found)])
    assert max(errors) < worst
    assert max(errors_of_exact) > max(0.1, worst)
    exact_brier, brier = np.mean(scores, axis=0)
    assert brier < 1.05 * exact_brier


def test_the_map_of_kinds_is_bayes_rule_and_no_robot_knows_as_much() -> None:
    result = v.simulate(Scenario().with_values(KINDS), 1, 1)
    found = inspect(result)
    shares, right = rates(result.scenario.sensor), np.zeros((25, 3))
    for tile, reading in result.observations.select("tile", "observation").iter_rows():
        right[tile] += np.log(shares[:, reading])
    right = np.exp(right - right.max(axis=1, keepdims=True))
    right /= right.sum(axis=1, keepdims=True)
    assert found.by_kind is not None
    assert found.pooled is not None
    assert found.by_kind[-1] == pytest.approx(right, abs=1e-9)
    assert np.abs(found.own[0] - found.pooled[-1]).max() > 0.01


def test_damage_is_any_kind_but_0() -> None:
    unequal = {"sensor.confusion.rates": [[0.8, 0.1, 0.1], [0.3, 0.6, 0.1], [0.1, 0.1, 0.8]]}
    samples = inspect(v.simulate(Scenario().with_values(KINDS | unequal), 1, 1)).samples
    assert rates(any_but_still(samples).law.sensor) == pytest.approx(np.array([[0.8, 0.2], [0.2, 0.8]]))
    assert kind_map(samples, [np.inf]).sum(axis=-1) == pytest.approx(1.0)


def plate(folder: Path, text: str, **settings: Any) -> Inspection:
    (folder / "plate.csv").write_bytes(text.encode("utf-8-sig"))
    known = {"laws": EXAMPLE / "reference.csv", "size_m": (1.0, 1.0), "floor": (5, 5)}
    return inspect(folder / "plate.csv", **(known | settings))


def as_people_write(form: str) -> tuple[str, dict[str, Any]]:
    """The plate of the examples in another form, and the settings that this needs."""
    head, *lines = (EXAMPLE / "plate.csv").read_text().splitlines()
    rows = [line.split(",") for line in lines]
    settings: dict[str, Any] = {}
    if form == "centred":
        rows = [[r, t, f"{int(x) - 500}", f"{int(y) - 500}", value] for r, t, x, y, value in rows]
        settings = {"origin": "centre"}
    elif form == "downward":
        rows = [[r, t, x, f"{1000 - int(y)}", value] for r, t, x, y, value in rows]
        settings = {"origin": "top-left"}
    elif form == "no time":
        head, rows = "robot,x_mm,y_mm,value", [[r, x, y, value] for r, _, x, y, value in rows]
    elif form == "missing":
        rows = [*rows, ["0", "999", "10", "10", ""]]
    elif form == "names":
        rows = [[f"bot{r}", *rest] for r, *rest in rows]
    mark = ";" if form == "semicolons" else ","
    if form == "semicolons":
        head, rows = (
            "Robot;Time (ms);X (mm);Y [mm];Value",
            [[r, f"{1000 * float(t):.0f}", x, y, value.replace(".", ",")] for r, t, x, y, value in rows],
        )
    return "\n".join([head, *map(mark.join, rows)]), settings


@pytest.mark.parametrize(
    "form", ["plain", "centred", "downward", "no time", "missing", "names", "semicolons"]
)
def test_a_file_as_people_write_it_gives_the_same_map(form: str, tmp_path: Path) -> None:
    text, settings = as_people_write(form)
    found = plate(tmp_path, text, **settings)
    assert found.pooled is not None
    assert np.flatnonzero(found.pooled[-1] > 0.95).tolist() == [8, 16]
    assert (found.pooled[-1] < 0.05).sum() == 23
    assert found.samples.frame.height == 948
    assert len(found.samples.robots) == 5


def test_of_values_in_another_unit_nothing_is_said_but_that(tmp_path: Path) -> None:
    head, *lines = (EXAMPLE / "plate.csv").read_text().splitlines()
    in_g = [f"{place},{float(value) / 9.81:.4f}" for place, value in (line.rsplit(",", 1) for line in lines)]
    with pytest.raises(InputError, match="of 948 values are outside those of the law"):
        plate(tmp_path, "\n".join([head, *in_g]))
