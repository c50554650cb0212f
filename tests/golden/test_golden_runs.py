"""The golden runs are as they were kept; ``helpers/golden_runs.py`` says how to renew them."""

from __future__ import annotations

import polars as pl
import pytest

from helpers.golden_runs import CASES, FOLDER, differences, events_of, result_of, stored


@pytest.mark.parametrize("case", CASES)
def test_golden_run(case: str) -> None:
    said = differences(events_of(result_of(case)), stored(case))
    assert not said, "; ".join(said) + " (if this is meant: python tests/helpers/golden_runs.py)"


def test_nothing_else_is_kept() -> None:
    assert {path.stem for path in FOLDER.glob("*.csv")} == set(CASES)


@pytest.mark.parametrize("case", CASES)
def test_the_runs_hold_events_of_every_kind(case: str) -> None:
    kept = stored(case)
    assert 30 < kept.height < 400
    assert set(kept["observation"]) == {0, 1}
    assert kept["decision"].max() > -1  # type: ignore[operator]


def test_the_comparison_sees_any_change() -> None:
    """Negative control: one number of each column, a position by two micrometres, a row."""
    kept = stored("paper")
    assert differences(kept, kept) == []
    for name in kept.columns:
        step = 2e-6 if kept[name].dtype == pl.Float64 else 1
        changed = kept.with_columns(
            pl.when(pl.int_range(pl.len()) == 17).then(pl.col(name) + step).otherwise(name)
        )
        changed = changed.select(kept.columns) if name in changed.columns else changed
        altered = kept.with_columns(changed[name])
        assert len(differences(altered, kept)) == 1
        assert differences(altered, kept)[0].startswith(f"{name}: 1 rows, first row 17")
    near = kept.with_columns(pl.col("x_m") + 4e-7)
    assert differences(near, kept) == []
    assert differences(kept[:-1], kept)
    assert differences(kept.drop("tile"), kept)
