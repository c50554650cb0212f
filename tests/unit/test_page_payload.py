"""The page is given exactly the numbers of the tables."""

from __future__ import annotations

import json
from base64 import b64decode
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl
import pytest

from vibroswarm.errors import InputError
from vibroswarm.floors.changes import changes_between
from vibroswarm.run_page.payload import RunRecord, payload


def columns(packed: dict[str, dict[str, str]]) -> dict[str, np.ndarray[Any, Any]]:
    return {
        name: np.frombuffer(b64decode(column["bytes"]), dtype=np.dtype(column["type"]).newbyteorder("<"))
        for name, column in packed.items()
    }


def test_samples_are_those_of_the_tables(record: RunRecord) -> None:
    got = columns(payload(record)["samples"])
    for table in (record.motion, record.observations, record.inference):
        rows = table.sort("robot", "sample")
        for name in set(got) & set(rows.columns):
            np.testing.assert_array_equal(got[name], rows[name].to_numpy(), err_msg=name)
    assert len(got["time_s"]) == len(record.motion)


def test_order_of_rows_does_not_matter(record: RunRecord) -> None:
    mixed = replace(
        record, motion=record.motion.reverse(), inference=record.inference.sample(fraction=1, shuffle=True)
    )
    assert payload(mixed)["samples"] == payload(record)["samples"]


def test_robots_and_outcome_are_those_of_the_tables(record: RunRecord) -> None:
    made = json.loads(json.dumps(payload(record), allow_nan=False))
    rows = record.robots.sort("robot")
    for name in (
        "robot",
        "decision",
        "decision_time_s",
        "belief_at_decision",
        "alpha",
        "beta",
        "sent",
        "messages_received",
    ):
        assert [robot[name] for robot in made["robots"]] == rows[name].to_list()
    assert made["outcome"] == {"consensus": record.consensus, "time_s": record.consensus_time_s}
    assert made["truth"]["fill_ratio"] == record.fill_ratio
    assert made["rule"]["prior_belief"] == pytest.approx(0.5, abs=1e-15)


def test_floor_is_the_floor(record: RunRecord) -> None:
    floor = payload(record)["floor"]
    tiles = np.array(list(floor["tiles"]), dtype=int).reshape(floor["rows"], floor["columns"])
    np.testing.assert_array_equal(tiles, record.floor.tiles)


def test_changes_of_the_floor_are_given_in_the_order_of_time(record: RunRecord) -> None:
    assert "changes" not in payload(record)["floor"]
    changes = changes_between(record.floor.tiles, [(7.0, 1 - record.floor.tiles), (9.0, record.floor.tiles)])
    given = payload(replace(record, floor=replace(record.floor, changes=changes)))["floor"]["changes"]
    before = record.floor.tiles.ravel().tolist()
    assert given == [
        *((7.0, tile, 1 - kind) for tile, kind in enumerate(before)),
        *((9.0, tile, kind) for tile, kind in enumerate(before)),
    ]


def test_energies_that_are_not_known_are_not_numbers(record: RunRecord) -> None:
    unknown = record.observations.with_columns(energy=pl.lit(None, dtype=pl.Float32))
    assert np.isnan(columns(payload(replace(record, observations=unknown))["samples"])["energy"]).all()


# 0.4999999999999998: half of 22 columns of 5 cm, of which the arena cuts the last.
@pytest.mark.parametrize(("fill", "truth"), [(0.4, 0), (0.5, None), (0.4999999999999998, None), (0.6, 1)])
def test_truth(record: RunRecord, fill: float, truth: int | None) -> None:
    told = payload(replace(record, fill_ratio=fill, expected_ones=0.3))["truth"]
    assert (told["decision"], told["ones"], told["fill_ratio"]) == (truth, 0.3, fill)


def test_an_outcome_that_is_not_known_is_refused(record: RunRecord) -> None:
    with pytest.raises(InputError, match="consensus: there is no 'perhaps'"):
        replace(record, consensus="perhaps")
