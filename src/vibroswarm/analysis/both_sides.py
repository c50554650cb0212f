"""A result of which every second run is on a floor of the mirrored fill ratio: over the prior of ``mirror``.

A cell has floors on one side of the boundary. A test that does not know the side may be mistaken more often on one side
than on the other, and its nominal error is that over both. So every second run is observed again, on a floor drawn with
the number of vibrating tiles that lies as far across the boundary; motion is kept, since it does not depend on floors.
"""

from __future__ import annotations

import polars as pl

from vibroswarm.analysis.known import tiles_inside
from vibroswarm.analysis.tile_counts import mirrored
from vibroswarm.errors import InputError
from vibroswarm.result import Result
from vibroswarm.simulation import replay


def on_both_sides(result: Result) -> Result:
    """The runs of even number as they are, those of odd number on floors of the mirrored fill ratio.

    Args:
        result: runs to their end, with floors drawn at random for each run.
    Raises:
        InputError: floors are not drawn for each run, the arena cuts them, or they lie on the boundary.
    """
    scenario = result.scenario
    if not scenario.floor.drawn_by_run:
        raise InputError(
            "only floors that are drawn for each run have a mirrored fill ratio", field="floor.source"
        )
    if result.runs["truth"].null_count():
        raise InputError("the fill ratio lies on the boundary; it has no mirror", field="floor.source")
    floor = result.floor(int(result.runs["run"][0]))
    tiles = floor.tiles.size
    if tiles_inside(floor, scenario.arena.width_m, scenario.arena.height_m).size < tiles:
        raise InputError("the arena cuts the floor; give one that ends with the arena", field="floor")
    vibrating = int(floor.tiles.sum())
    weights = mirrored(vibrating, tiles, scenario.decision.decision_boundary)
    weights[vibrating] = 0.0
    fill = int(weights.argmax()) / tiles
    other = replay(result, scenario.with_values({"floor.source": f"random:{fill!r}"}))
    tables = {
        name: _alternating(getattr(result, name), getattr(other, name))
        for name in ("observations", "inference", "robots", "runs", "floors")
    }
    return Result(
        scenario=scenario, seed=result.seed, motion=result.motion, ends=result.ends, segments=result.segments,
        source=result.source, versions=result.versions, **tables,
    )  # fmt: skip


def _alternating(even: pl.DataFrame, odd: pl.DataFrame) -> pl.DataFrame:
    """Rows of the runs of even number of the one table, of odd number of the other; sorted by run."""
    is_even = pl.col("run") % 2 == 0
    return pl.concat([even.filter(is_even), odd.filter(~is_even)]).sort("run", maintain_order=True)
