"""Negative controls: claims that are reproduced as the simulations ran are not with what the paper prints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from vibroswarm.paper import cells, reproduce
from vibroswarm.paper.item import Settings, items_named
from vibroswarm.scenario.scenario import preset
from vibroswarm.study.cells import Cell

SENSOR = preset("paper").sensor
LABELS = {
    f"sensor.{kind}_{name}": getattr(SENSOR, f"{other}_{name}")
    for kind, other in (("vibrating", "still"), ("still", "vibrating"))
    for name in ("shape", "scale", "location")
}
"""The energy distributions as printed, those of vibrating and still tiles swapped."""


def verdicts(folder: Path, item: str, runs: int, values: dict[str, Any]) -> dict[str, str]:
    """Verdicts on the claims of an item whose scenarios have other values; all can be asked."""

    def changed(study: str, column: str) -> tuple[Cell, ...]:
        own = cells.cells_of(study, column)
        return tuple(replace(cell, scenario=cell.scenario.with_values(values)) for cell in own)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reproduce, "cells_of", changed)
        patch.setattr(cells, "cannot_ask", lambda scenario: "")
        settings = Settings(runs=runs, columns=("paper",))
        decided = reproduce.reproduce(settings, folder, items_named([item])).decided
    return {one.claim.id: one.verdict for one in decided}


@pytest.mark.long
@pytest.mark.parametrize(
    ("item", "runs", "values", "turned", "staying"),
    [
        # Swapped, the sensor is its own mirror image: beliefs turn, times do not.
        ("fill-ratios", 400, LABELS, ["fill-belief"], ["fill-time"]),
        ("fill-ratios", 400, {"sensor.rms_threshold": 1.55}, ["fill-time", "fill-belief"], []),
        (
            "swarm-sizes",
            200,
            {"network.name": "loss", "network.loss.share": 1.0},
            ["size-time", "size-soft"],
            ["size-distance", "size-avoidance"],
        ),
    ],
    ids=["labels", "threshold", "no messages"],
)
def test_a_control_turns_what_hangs_on_it_and_nothing_else(
    tmp_path: Path, item: str, runs: int, values: dict[str, Any], turned: list[str], staying: list[str]
) -> None:
    plain, controlled = verdicts(tmp_path, item, runs, {}), verdicts(tmp_path, item, runs, values)
    assert {plain[claim] for claim in turned + staying} == {"reproduced"}
    assert "reproduced" not in {controlled[claim] for claim in turned}
    assert {controlled[claim] for claim in staying} <= {"reproduced"}
