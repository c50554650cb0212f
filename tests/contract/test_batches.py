"""No result depends on threads, batches, order or interruption."""

from __future__ import annotations

import threading

import polars as pl
import pytest
from polars.testing import assert_frame_equal

from vibroswarm.batches import in_batches
from vibroswarm.errors import InputError
from vibroswarm.presets import preset
from vibroswarm.result import TABLES, Result
from vibroswarm.simulation import simulate

SCENARIO = preset("paper").with_values(
    {"run.t_end_s": 90.0, "decision.min_observations": 30, "strategy.name": "soft", "network.loss": 0.1}
)
RUNS = [0, 1, 2, 5, 8, 13, 21, 34, 55, 89, 144]


def joined(results: list[Result]) -> dict[str, pl.DataFrame]:
    names = [name for name in TABLES if name != "segments"]
    return {name: pl.concat([getattr(result, name) for result in results]) for name in names}


@pytest.fixture(scope="module")
def at_once() -> Result:
    return simulate(SCENARIO, 3, RUNS)


@pytest.mark.parametrize("motion", ["event", "fixed-step"])
@pytest.mark.parametrize(("batch", "workers"), [(1, 1), (3, 1), (1, 2), (4, 2), (100, 3)])
def test_threads_and_batches_do_not_matter(motion: str, batch: int, workers: int) -> None:
    whole = simulate(SCENARIO, 3, RUNS, motion=motion)
    stream = in_batches(SCENARIO, 3, RUNS, batch=batch, workers=workers, motion=motion, energies=True)
    for name, frame in joined(list(stream)).items():
        assert_frame_equal(frame, getattr(whole, name), check_exact=True)


def test_order_and_company_do_not_matter(at_once: Result) -> None:
    backwards = simulate(SCENARIO, 3, RUNS[::-1])
    assert backwards.same_tables(at_once)
    for run in RUNS[::4]:
        alone = simulate(SCENARIO, 3, [run])
        for name in ("motion", "inference", "robots", "runs", "ends", "floors"):
            assert_frame_equal(getattr(alone, name), getattr(at_once, name).filter(pl.col("run") == run))


def test_another_seed_or_run_is_another_result(at_once: Result) -> None:
    """Negative control."""
    assert not simulate(SCENARIO, 4, RUNS).same_tables(at_once)
    other = simulate(SCENARIO, 3, [3]).motion
    assert not any(
        other.select("x_m").equals(at_once.motion.filter(pl.col("run") == run).select("x_m")) for run in RUNS
    )


def test_results_come_in_order_and_an_end_leaves_no_thread() -> None:
    stream = in_batches(SCENARIO, 3, 40, batch=2, workers=2)
    first, second = next(stream), next(stream)
    assert first.runs["run"].to_list() == [0, 1]
    assert second.runs["run"].to_list() == [2, 3]
    stream.close()  # type: ignore[attr-defined]
    assert not [t for t in threading.enumerate() if t.name.startswith("vibroswarm")]


@pytest.mark.parametrize(
    "values", [{"batch": 0}, {"workers": 0}, {"runs": 0}, {"runs": [1, 1]}, {"motion": "evnt"}]
)
def test_bad_numbers_are_named(values: dict[str, object]) -> None:
    arguments = {"runs": 2, **values}
    with pytest.raises(InputError, match=next(iter(values))):
        list(in_batches(SCENARIO, 3, **arguments))  # type: ignore[arg-type]
