"""What came of a study: selecting, grouping, pandas and xarray."""

from __future__ import annotations

import polars as pl
import pytest
from polars.testing import assert_frame_equal

from vibroswarm import InputError, Study, StudyResult, preset

pytestmark = pytest.mark.usefixtures("without_layout")

SHORT = preset("paper").with_values({"run.t_end_s": 60.0, "swarm.robots": 2})


@pytest.fixture(scope="module")
def result() -> StudyResult:
    return Study.of(
        SHORT, 12, 3, floor__source=["random:0.44", "diagonal:0.46"], strategy__name=["none", "soft"]
    ).run()


def test_where_selects_by_what_is_varied(result: StudyResult) -> None:
    assert result.where(floor__source="random:0.44").selected == (0, 1)
    assert result.where(name="soft").selected == (1, 3)
    assert result.where(name=["none", "soft"]).selected == (0, 1, 2, 3)
    one = result.where(source="diagonal:0.46", name="soft")
    assert one.selected == (3,)
    assert one.runs().height == 12
    assert_frame_equal(one.robots(), result.robots().filter(pl.col("cell") == 3))
    with pytest.raises(InputError, match="name: no cell has 'positive'; there is 'none' and 'soft'"):
        result.where(name="positive")
    with pytest.raises(InputError, match=r"robots: is not varied .*varied are floor\.source, strategy\.name"):
        result.where(robots=5)
    with pytest.raises(InputError, match="there is no cell 0 here"):
        one.cell(0)
    tiles = [[[0, 1], [1, 0]], [[1, 1], [0, 0]]]
    assert Study.of(SHORT, 1, 3, floor__tiles=tiles).run().where(floor__tiles=tiles[1:]).selected == (1,)


def test_tables_group_by_what_is_varied(result: StudyResult) -> None:
    counts = result.runs().group_by("floor.source", "strategy.name", maintain_order=True).len()
    assert counts.rows() == [
        ("random:0.44", "none", 12),
        ("random:0.44", "soft", 12),
        ("diagonal:0.46", "none", 12),
        ("diagonal:0.46", "soft", 12),
    ]
    assert result.robots().columns[:5] == ["cell", "floor.source", "strategy.name", "run", "robot"]
    assert result.cells["name"].to_list()[3] == "diagonal:0.46, soft"
    assert result.cells["there"].to_list() == [12] * 4


def test_a_run_is_made_again_with_all_its_samples(result: StudyResult) -> None:
    again = result.result(3, [5, 7], poses=True)
    assert again.runs["run"].to_list() == [5, 7]
    kept = result.tables(3)[0].filter(pl.col("run").is_in([5, 7]))
    assert_frame_equal(again.robots, kept, check_exact=True)
    assert again.poses is not None
    with pytest.raises(InputError, match="saves no samples"):
        result.samples()


def test_samples_are_kept_on_request(result: StudyResult) -> None:
    study = Study(SHORT, {"grid": {"strategy.name": ["none", "soft"]}}, 4, keep=("samples",))
    kept = study.run()
    samples = kept.samples(1).drop("cell", "strategy.name")
    made = kept.result(1, 4)
    for name in ("motion", "observations", "inference"):
        table = getattr(made, name)
        assert_frame_equal(samples.select(table.columns), table, check_exact=True)
    assert kept.samples().height == 2 * samples.height


def test_pandas_in_one_call(result: StudyResult) -> None:
    for table in ("robots", "runs", "cells"):
        frame = result.to_pandas(table)
        mine = result.cells if table == "cells" else getattr(result, table)()
        assert list(frame.columns) == mine.columns
        assert len(frame) == mine.height
    mean = result.to_pandas().groupby(["floor.source", "strategy.name"])["distance_m"].mean()
    assert mean["random:0.44", "none"] == pytest.approx(result.runs(0)["distance_m"].mean())
    with pytest.raises(InputError, match="did you mean 'runs'"):
        result.to_pandas("rums")
