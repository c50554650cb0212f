"""What came of a study: selecting, grouping, pandas and xarray."""

from __future__ import annotations

import gc
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

import vibroswarm
from helpers.commands import printed_by
from vibroswarm import InputError, Scenario, Study, StudyResult, preset
from vibroswarm.analysis import cell_summary
from vibroswarm.analysis.cell_summary import CellSummary, summary
from vibroswarm.analysis.forced_error import Reached
from vibroswarm.analysis.intervals import wilson
from vibroswarm.documents import study as study_documents
from vibroswarm.documents import study_figures
from vibroswarm.documents.study_words import warnings_of
from vibroswarm.plots import draw_outcomes
from vibroswarm.show.document import Figure, Section, walk
from vibroswarm.study import batch
from vibroswarm.study.cell_comparison import comparisons
from vibroswarm.study.equal_error import at_equal_error, pairs_at_equal_error, reached, why_not_at_equal_error
from vibroswarm.study.plan import samples_of_run
from vibroswarm.study.precision import Precision
from vibroswarm.study.store import Store
from vibroswarm.study.summary import outcome_of

pytestmark = pytest.mark.usefixtures("without_layout")

SHORT = preset("paper").with_values({"run.t_end_s": 60.0, "swarm.robots": 2})


@pytest.fixture(scope="module")
def result() -> StudyResult:
    return Study.of(
        SHORT, 12, 3, floor__source=["random:0.44", "diagonal:0.46"], strategy__name=["none", "soft"]
    ).run()


def test_a_relative_folder_stays_readable_from_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tables are read when they are asked for, which failed once a notebook worked in another folder."""
    monkeypatch.chdir(tmp_path)
    Study.of(SHORT, 2, 3).run("study")
    opened = StudyResult.open("study")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert opened.runs().height == 2
    assert "in 'study'" in repr(opened)
    shard = next((tmp_path / "study" / "shards").glob("*.json"))
    shard.write_text("{")
    opened.store.refresh()
    assert opened.store.damaged == [
        f"{shard.name}: study/shards/{shard.name}: is damaged: not JSON in line 1"
    ]


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


def test_files_of_other_runs_are_not_opened(tmp_path: Path) -> None:
    """A page of a study looked at all files three times more, whatever runs it needed."""
    for runs in (2, 5):
        found = Study.of(SHORT, runs, 3).run(tmp_path / "study")
    for shard in found.store.shards:
        if shard.first > 0:
            shard.files["robots"].unlink()
    assert found.unsorted_rows(0, start=0, end=2).collect()["run"].unique().to_list() == [0, 1]
    with pytest.raises(FileNotFoundError):
        found.unsorted_rows(0).collect()


def test_figures_of_many_runs_are_held_in_few_bytes(
    result: StudyResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A summary of 100,000 runs took 31 MB per cell for them, and copies."""
    held: list[pl.DataFrame] = []

    def summaries_of(table: pl.DataFrame, *others: Any) -> list[CellSummary]:
        held.append(table)
        return cell_summary.summaries_of(table, *others)

    monkeypatch.setattr("vibroswarm.study.summary.summaries_of", summaries_of)
    outcome_of(result, compare=False)
    table = pl.concat(held)
    figures = pl.concat([result.figures(cell) for cell in result.selected])
    assert table.estimated_size() < 0.5 * figures.estimated_size()
    own = table.sort("cell", "run").select(figures.columns).cast(dict(figures.schema))
    assert_frame_equal(own, figures, check_exact=True)


def test_a_study_of_many_small_cells_is_read_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each cell was read and grouped by itself: 2,000 of them took 20 s."""
    counts: list[int] = []
    scan = Store.scan

    def counted(store: Store, group: int, runs: int, table: str = "robots", start: int = 0) -> Any:
        counts.append(group)
        return scan(store, group, runs, table, start)

    many = Study.of(SHORT, 2, 3, decision__min_observations=list(range(1, 41))).run()
    monkeypatch.setattr(Store, "scan", counted)
    found = many.summary()
    assert len(counts) < 10
    assert found["cell"].to_list() == list(range(40))
    few = many.where(min_observations=[7, 30])
    assert_frame_equal(few.summary(), found.filter(pl.col("cell").is_in([6, 29])), check_exact=True)


@pytest.mark.parametrize("number", [4, -1, "x", 1.0, None])
def test_a_cell_that_is_not_there_is_refused(result: StudyResult, number: Any) -> None:
    tables = (result.runs, result.maps, result.reported, result.failed_runs)
    for ask in (result.cell, result.runs_of, result.settled, *tables):
        with pytest.raises(InputError, match="there is no cell"):
            ask(number)


@pytest.mark.parametrize("name", ["nonsense", "estimate", "map_brier"])
def test_figures_that_need_other_columns_are_refused(result: StudyResult, name: str) -> None:
    """Those of maps were nan, the others ended in a KeyError."""
    with pytest.raises(InputError, match=f"figures: there is no '{name}'"):
        result.by_run(["sent", name])
    with pytest.raises(InputError, match=r"columns: there is no 'decison', did you mean 'decision'"):
        list(result.arrays(["decison"]))
    assert all(np.isfinite(values).all() for values in result.by_run(["sent", "decision_time_s"]).values())


QUICK = preset("paper").with_values({"run.t_end_s": 30.0, "decision.min_observations": 0})


def until(half_width: float, most: int, **varied: Sequence[float]) -> StudyResult:
    fields = {name.replace("__", "."): values for name, values in varied.items()}
    precision = Precision(half_width, "robots_undecided", max_runs=most)
    return Study(QUICK, {"grid": fields}, None, precision).run()


def test_figures_by_run_of_cells_with_different_numbers_of_runs_are_refused() -> None:
    """It was a ValueError of NumPy."""
    found = until(0.08, 200, swarm__robots=[1, 3])
    assert found.cells["wanted"].to_list() == [200, 100]
    with pytest.raises(InputError, match="cells: have different numbers of runs"):
        found.by_run(["decision_time_s"])
    assert found.where(robots=3).by_run(["decision_time_s"])["decision_time_s"].shape == (1, 100)


def test_only_cells_that_are_not_precise_enough_are_said_to_be_so() -> None:
    """Cells that share motion are settled together: the other one was counted as well."""
    found = outcome_of(until(0.06, 100, decision__credible_threshold=[0.6, 0.8]))
    widths = [(one.high - one.low) / 2 for one in (cell.summary.robots_undecided for cell in found.cells)]
    assert widths[0] < 0.06 < widths[1]
    (words,) = warnings_of(found)
    assert words.startswith("in 1 of 2 cells robots_undecided is not known to 6 % after 100 runs")


def test_bars_of_all_runs_have_no_limits_of_some(result: StudyResult) -> None:
    """The limits of swarms right are of the runs with a right answer; the bar beside them is of all runs."""
    found = outcome_of(result, compare=False)
    one, *others = found.cells
    figures = {**one.summary.figures, "swarm_right": wilson(2, 4)}
    some = replace(one, summary=replace(one.summary, figures=figures))
    picture = (
        study_documents.study_document(replace(found, cells=(some, *others))).figures["outcomes"].draw("page")
    )
    assert [low is None for low in picture.numbers["right_low"]] == [True, False, False, False]


def test_a_comparison_that_is_not_repeated_is_not_called_unconfirmed(result: StudyResult) -> None:
    once = study_documents.study_document(outcome_of(result))
    titles = [part.title for part in walk(once.parts) if isinstance(part, Section)]
    assert "How they compare" in titles, "nothing was repeated on other seeds"
    second = replace(result.study, seed=4).run()
    again = study_documents.study_document(outcome_of(result, replace(second, selected=(0, 1))))
    titles = [part.title for part in walk(again.parts) if isinstance(part, Section)]
    assert "How they compare, and on other seeds" in titles
    repeated, not_repeated = again.tables["compared-decision_time_s"].frame["confirmed"]
    assert repeated in ("confirmed", "not confirmed")
    assert not_repeated is None


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


def test_summaries_of_several_studies_can_be_joined(result: StudyResult) -> None:
    """A figure that no cell has was a column of another type than elsewhere, as in the Parquet file."""
    assert result.summary()["agreement_lasted"].null_count() == 4
    assert pl.Null not in result.summary().dtypes


def test_figures_from_some_runs_at_a_time_are_those_of_the_whole_table(
    result: StudyResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    part = result.where(source="diagonal:0.46")
    for rows in (1, 17):  # fewer than a run has robots; a part that does not divide the runs
        monkeypatch.setattr("vibroswarm.study.study_result.ROWS_IN_A_PART", rows)
        for one in outcome_of(part, compare=False).cells:
            robots, runs = result.tables(one.cell.number)
            whole = summary(robots, runs, one.cell.scenario.run.t_end_s)
            assert one.summary.as_row() == whole.as_row()


def test_some_columns_of_the_tables_are_read_alone(result: StudyResult) -> None:
    robots, runs = result.tables(1)
    for one, whole in zip(result.tables(1, ["decision", "truth"]), (robots, runs), strict=True):
        assert_frame_equal(one, whole.select(one.columns), check_exact=True)
    assert [table.columns for table in result.tables(1, ["decision", "truth"])] == [
        ["run", "robot", "decision"],
        ["run", "truth"],
    ]
    with pytest.raises(InputError, match=r"columns: there is no 'decison', did you mean 'decision'"):
        result.tables(1, ["decison"])


def test_few_runs_are_in_memory_at_a_time_where_their_robots_have_large_arrays(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Maps of each sender grow with the square of the number of robots. Values do not depend on it."""
    simulated = batch.simulate_batch
    places = SHORT.with_values({"strategy.name": "places"})
    sizes: list[int] = []

    def counted(work: batch.Batch, *more: Any) -> Any:
        sizes.append(work.runs)
        return simulated(work, *more)

    monkeypatch.setattr(batch, "simulate_batch", counted)
    found = []
    for arrays_fit in (batch.arrays_fit, lambda _: 2):
        monkeypatch.setattr(batch, "arrays_fit", arrays_fit)
        found.append(Study(places, runs=5).run(workers=1).robots())
    assert sizes == [5, 2, 2, 1]
    assert_frame_equal(*found, check_exact=True)


def test_a_run_is_made_again_with_all_its_samples(result: StudyResult) -> None:
    again = result.result(3, [5, 7], segments=True)
    assert again.runs["run"].to_list() == [5, 7]
    kept = result.tables(3)[0].filter(pl.col("run").is_in([5, 7]))
    assert_frame_equal(again.robots, kept, check_exact=True)
    assert again.segments is not None
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


def test_xarray_in_one_call(result: StudyResult) -> None:
    runs = result.to_xarray()
    assert dict(runs.sizes) == {"floor.source": 2, "strategy.name": 2, "run": 12}
    one = runs["right"].sel({"floor.source": "diagonal:0.46", "strategy.name": "soft", "run": 5}).item()
    assert one == result.runs(3).filter(pl.col("run") == 5)["right"].item()
    robots = result.to_xarray("robots")
    assert dict(robots.sizes) == {"floor.source": 2, "strategy.name": 2, "run": 12, "robot": 2}
    assert dict(result.to_xarray("cells").sizes) == {"floor.source": 2, "strategy.name": 2}
    with pytest.raises(InputError, match="did you mean 'runs'"):
        result.to_xarray("rums")


def test_xarray_of_samples() -> None:
    for grid in ({}, {"grid": {"strategy.name": ["none", "soft"]}}):
        result = Study(SHORT, grid, 3, keep=("samples",)).run()
        samples, table = result.to_xarray("samples"), result.samples()
        assert set(samples.sizes) == {*result.study.varied, "run", "robot", "sample"}
        assert samples.sizes["sample"] == table["sample"].n_unique()
        last = table.row(-1, named=True)
        chosen = {name: last[name] for name in samples.sizes}
        assert samples["time_s"].sel(chosen).item() == last["time_s"]
        assert int(samples["time_s"].notnull().sum()) == table.height


def test_xarray_of_one_cell_and_of_cells_that_are_no_grid() -> None:
    assert dict(Study.of(SHORT, 3).run().to_xarray().sizes) == {"run": 3}
    twice = Study(SHORT, {"list": [{"strategy.name": "none"}, {"strategy.name": "none"}]}, 3).run()
    with pytest.raises(InputError, match="several cells have the same"):
        twice.to_xarray()


def test_xarray_of_cells_that_leave_a_field_out() -> None:
    """They took the place of the last value: three cells came to one place, with the rows of one of them."""
    points = [{"swarm.robots": 3}, {"strategy.name": "soft"}, {"swarm.robots": 3, "strategy.name": "soft"}]
    result = Study(SHORT, {"list": points}, 2).run()
    for table, sizes in {"cells": {}, "runs": {"run": 2}, "robots": {"run": 2, "robot": 3}}.items():
        assert dict(result.to_xarray(table).sizes) == {"cell": 3, **sizes}
    assert result.to_xarray()["distance_m"].values.ravel().tolist() == result.runs()["distance_m"].to_list()
    selected = result.where(name="soft", robots=3).to_xarray()
    assert dict(selected.sizes) == {"swarm.robots": 1, "strategy.name": 1, "run": 2}


def test_without_a_folder_it_lasts_as_long_as_the_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    result = Study.of(SHORT, 3).run()
    part = result.where()
    del result
    gc.collect()
    assert part.runs().height == 3
    del part
    gc.collect()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("empty_pictures")
def test_a_study_without_samples_has_a_report_without_their_pictures(tmp_path: Path) -> None:
    """Its runs end before any robot samples."""
    result = Study.of(SHORT.with_values({"run.t_end_s": 0.5}), 3).run()
    assert result.robots()["samples"].sum() == 0
    text = result.report(tmp_path / "r").path.read_text(encoding="utf-8")
    assert "Decisions over time" in text
    assert "Where robots sampled" not in text
    assert "Belief over time" not in text


def test_pictures_of_samples_are_of_the_cells_with_samples() -> None:
    """Cells that share their motion may end at different times. Robots without samples hold the belief of the prior."""
    result = Study.of(SHORT, 3, run__t_end_s=[0.5, 60.0]).run()
    assert result.robots(0)["samples"].sum() == 0 < result.robots(1)["samples"].sum()
    assert len(result.plan.groups) == 1
    assert result.plot("density").numbers["count"].sum() == result.robots(1)["samples"].sum()
    belief = result.plot("belief").numbers.filter(pl.col("series").str.contains("0.5", literal=True))
    assert belief.select(pl.col("q05", "q95").n_unique()).row(0) == (1, 1)


def test_where_numbers_are_asked_for_nothing_is_drawn_of_right_and_wrong() -> None:
    """Its page had empty pictures of robots right and wrong, and of time against error."""
    varied = {"strategy__name": ["dirichlet", "none"]}
    outcome = outcome_of(Study.of(SHORT.with_values({"task.name": "share"}), 3, **varied).run())
    figures = [*study_figures.outcome_figures(outcome), *study_figures.front_figures(outcome)]
    assert [figure.name for figure in figures] == ["estimate_error"]
    assert not [*study_figures.time_figures(outcome)]
    document = study_documents.study_document(outcome)
    assert "decidability" not in document.tables
    captions = " ".join(table.caption for table in document.tables.values())
    assert "Undecided" not in captions
    assert "points" not in captions
    decided = outcome_of(Study.of(SHORT, 3).run())
    assert "estimate_error" not in {figure.name for figure in study_figures.outcome_figures(decided)}


def test_an_axis_of_values_far_apart_is_logarithmic() -> None:
    """1e-9 and 1 fell on one place beside 1e9."""
    picture = (
        Study.of(SHORT, 2, strategy__name=["soft"], strategy__soft__eta=[1e-9, 1.0, 1e9])
        .run()
        .plot("decision_time_s")
    )
    assert picture.figure.axes[0].get_xscale() == "log"


def test_pictures_of_beliefs_have_only_what_holds_for_each_cell() -> None:
    """Strategies without beliefs were drawn with the prior's, and all panels had the threshold of the first cell."""
    varied = {"strategy__name": ["soft", "averaging"], "decision__credible_threshold": [0.8, 0.9]}
    picture = Study.of(SHORT, 3, **varied).run().plot("belief")
    assert picture.numbers["series"].str.contains("soft").all()
    assert "dashed" not in picture.caption


def test_a_study_that_has_no_runs_yet(tmp_path: Path) -> None:
    from vibroswarm.study.store import Store

    study = Study.of(SHORT, 3)
    Store.open_or_create(tmp_path / "s", study)
    result = StudyResult.open(tmp_path / "s")
    assert result.cells["there"].to_list() == [0]
    with pytest.raises(InputError, match="holds no runs"):
        result.runs()


def test_the_package_stays_cheap_to_import() -> None:
    heavy = ("numba", "polars", "scipy", "pydantic", "numpy", "pandas", "xarray", "distributed")
    code = (
        f"import sys, vibroswarm; dir(vibroswarm); print([m for m in {heavy} if m in sys.modules]); "
        f"vibroswarm.Study; print([m for m in {heavy[-3:]} if m in sys.modules])"
    )
    assert printed_by(code).split() == ["[]", "[]"]


@pytest.mark.parametrize(
    ("package", "convert"), [("pandas", "to_pandas"), ("pyarrow", "to_pandas"), ("xarray", "to_xarray")]
)
def test_a_missing_package_is_named_with_its_extra(
    package: str, convert: str, result: StudyResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError, match=rf"^{convert}: needs {package}: pip install 'vibroswarm\[frames\]'"):
        getattr(result, convert)()


def test_runs_of_a_slow_source_are_simulated_again_once_and_for_a_short_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Pictures and references would take longer than the study. Those of the engines are as they were."""
    slow = Study(SHORT, runs=10, seed=3, motion="mujoco-planar").run()
    chosen = slow.runs_again(0, 10)
    assert chosen == slow.runs_there(0, 10)
    again = slow.result(0, chosen)
    assert slow.result(0, chosen) is again
    assert slow.result(0, np.int64(3)).runs.height == 3
    assert slow.result(0, [3]).runs["run"].to_list() == [3]  # it was the first three
    assert_frame_equal(again.motion, vibroswarm.simulate(SHORT, 3, chosen, motion="mujoco-planar").motion)
    monkeypatch.setattr("vibroswarm.study.study_result.AGAIN_S", 5 * slow.plan.groups[0].run_s)
    assert slow.runs_again(0, 10) == [0, 1, 2, 3, 4]
    quick = Study(SHORT, runs=10, seed=3).run()
    assert quick.runs_again(0, 10) == list(range(10))


def test_fewer_of_long_runs_are_simulated_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A report of 200 runs of a day took several times as long as the study, and gigabytes of memory."""
    study = Study(SHORT, runs=10, seed=3).run()
    monkeypatch.setattr("vibroswarm.study.study_result.AGAIN_SAMPLES", 3.5 * samples_of_run(SHORT))
    assert study.runs_again(0, 10) == [0, 1, 2]
    monkeypatch.setattr("vibroswarm.study.study_result.AGAIN_SAMPLES", 1)
    assert study.runs_again(0, 10) == [0]
    assert study.runs_again(0, 0) == []
    with pytest.raises(InputError, match="most: -3"):
        study.runs_again(0, -3)
    stopping = Study(SHORT.with_values({"run.stop": "all_decided"}), runs=10, seed=3).run()
    assert stopping.runs_again(0, 10) == list(range(10))


def test_strategies_are_not_compared_at_equal_error_on_the_motion_of_another_source(
    result: StudyResult,
) -> None:
    """Settings are replayed on the engines' motion, which a study of another source did not have."""
    grid = {"grid": {"strategy.name": ["none", "soft"]}}
    other = Study(SHORT, grid, 3, seed=3, motion="mujoco-planar").run()
    assert comparisons(other)
    assert pairs_at_equal_error(other, comparisons(other)) == {} == at_equal_error(other, comparisons(other))
    assert "motion of 'mujoco-planar'" in why_not_at_equal_error(other, comparisons(other), {})
    assert "12 runs can be used" in why_not_at_equal_error(result, comparisons(result), {})


def test_strategies_are_compared_at_equal_error_only_on_request(monkeypatch: pytest.MonkeyPatch) -> None:
    """It may take longer than the study. On request, cells with the same motion are replayed on one motion."""
    scenario = SHORT.with_values({"run.t_end_s": 150.0, "decision.min_observations": 5})
    result = Study(scenario, {"grid": {"strategy.name": ["none", "positive", "soft"]}}, 20, seed=3).run()
    together = []

    def noted(scenarios: Sequence[Scenario], *arguments: Any, **named: Any) -> list[Reached]:
        together.append([one.strategy.name for one in scenarios])
        return reached(scenarios, *arguments, **named)

    monkeypatch.setattr("vibroswarm.study.equal_error.reached", noted)
    assert {answer.matched for answer in outcome_of(result).answers} == {None}
    assert {tuple(answer.as_row()) for answer in outcome_of(result).answers} == {
        ("name", "cell", "reference")
    }
    assert together == []
    requested = outcome_of(result, equal_error=True)
    assert all(answer.matched is not None for answer in requested.answers)
    assert [sorted(names) for names in together] == [["none", "positive", "soft"]]
    assert result.compare("none", equal_error=True).sentences[1].startswith("At equal error")
    compared = requested.comparisons
    some = {
        (one.cell.number, one.reference.number): one.matched for one in requested.answers[1:] if one.matched
    }
    assert why_not_at_equal_error(result, compared, some).startswith("1 pair not compared at equal error: ")


def test_scenarios_replayed_together_reach_what_each_reaches_alone() -> None:
    scenarios = [SHORT.with_values({"strategy.name": name}) for name in ("none", "soft")]
    for one, scenario in zip(reached(scenarios, 3, 4), scenarios, strict=True):
        (alone,) = reached([scenario], 3, 4)
        assert np.array_equal(one.time_s, alone.time_s)
        assert np.array_equal(one.error, alone.error)


@pytest.mark.usefixtures("one_picture", "empty_pictures")
def test_a_report_never_replaces_runs(tmp_path: Path) -> None:
    """Neither of its own study, into whose folder it is written, nor of another."""
    study = Study.of(preset("paper").with_values({"run.t_end_s": 20.0}), 3)
    result, other = study.run(tmp_path / "own"), replace(study, seed=2).run(tmp_path / "other")
    report = result.report(tmp_path / "own", replace=True)
    assert report.path == tmp_path / "own" / "report.html"
    assert StudyResult.open(tmp_path / "own").runs().height == 3
    with pytest.raises(
        InputError, match=r"holds results \('vibroswarm\.json'\), which a report does not replace"
    ):
        result.report(other.store.folder, replace=True)
    assert StudyResult.open(tmp_path / "other").runs().height == 3
    result.report(tmp_path / "third")
    assert result.report(tmp_path / "third", replace=True).path.is_file()


def test_a_figure_that_is_declared_is_on_the_page_in_the_files_and_in_python(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Nothing lists the names of figures: what a group yields is shown."""
    counts = pl.DataFrame({"cell": ["a"], "right": [1], "wrong": [0]})
    new = Figure("brand-new", lambda style: draw_outcomes(counts, style=style), "Brand new")
    groups = ("outcome_figures", "time_figures", "comparison_figures", "front_figures", "sampling_figures")
    for name in groups:
        monkeypatch.setattr(study_documents, name, lambda outcome: ())
    result = Study.of(SHORT, 3, strategy__name=["none", "soft"]).run()
    with pytest.raises(InputError, match="there is no 'brand-new'"):
        result.plot("brand-new")  # the control: no group declares it
    monkeypatch.setattr(study_documents, "time_figures", lambda outcome: (new,))
    assert result.plot("brand-new").numbers.height == 1
    page = result.report(tmp_path / "r").path.read_text(encoding="utf-8")
    assert page.count('aria-label="brand-new"') == 1
    assert (tmp_path / "r" / "pictures" / "brand-new.svg").is_file()


def test_answers_beyond_the_second_kind_are_read_back(tmp_path: Path) -> None:
    three = preset("paper").with_values({
        "sensor.model": "confusion", "floor.source": "random:0.2,0.2,0.6", "task.name": "majority",
        "strategy.name": "dirichlet", "run.t_end_s": 200.0, "decision.min_observations": 20,
    })  # fmt: skip
    Study.of(three, runs=2, seed=2).run(tmp_path / "study")
    read = StudyResult.open(tmp_path / "study")
    assert read.tables(0)[0]["decision"].to_list() == [2] * 10


def test_a_figure_of_many_comparisons_says_how_many_it_leaves_out(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ("difference", "difference_low", "difference_high", "pairs", "wins", "ties", "losses")
    rows = [{"figure": "decision_time_s", "name": f"a{k}", **dict.fromkeys(names, 1.0)} for k in range(50)]
    for number, words in ((50, "run by run (the first 48 of 50 comparisons)"), (48, "run by run")):
        table = pl.DataFrame(rows[:number])
        monkeypatch.setattr(study_figures, "comparison_table", lambda compared, table=table: table)
        (figure,) = study_figures.comparison_figures(())
        assert figure.title.endswith(words)
