"""The table of what each fit estimates is that of the documentation, and its fields are those of scenarios."""

from __future__ import annotations

import runpy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from vibroswarm.calibrate.fit import FITS, Fitted, Source, _Part, _part_of
from vibroswarm.scenario.scenario import field_names

DOCS = Path(__file__).parents[2] / "docs"


def test_the_documentation_has_the_table_of_the_code() -> None:
    made = runpy.run_path(str(DOCS / "make_calibration.py"))
    page = (DOCS / "calibration.md").read_text(encoding="utf-8")
    assert f"<!-- made: fits -->\n\n{made['fits_table']()}\n\n<!-- end -->" in page


def test_every_field_is_one_of_a_scenario_and_is_fitted_once() -> None:
    known = set(field_names())
    named = [name for source in FITS for name in source.fields]
    # Rays are fitted with avoidance where robots turned away from walls too seldom.
    assert [name for name in set(named) if named.count(name) > 1] == ["rays.angle_deg"]
    for name in named:
        assert name in known or (name.endswith(".") and any(own.startswith(name) for own in known)), name


@pytest.mark.parametrize(
    ("fields", "error", "figures", "words"),
    [
        (("network.name",), "none: counted", (), "the fit of stop gives sample.stop_ms"),
        (
            ("sample.stop_ms",),
            "none: counted",
            (Fitted("stop_ms", 1.0, 0.1, 0.8, 1.2),),
            "the fit of stop has errors",
        ),
    ],
)
def test_a_fit_that_does_not_follow_its_row_of_the_table_fails(
    fields: tuple[str, ...], error: str, figures: tuple[Fitted, ...], words: str
) -> None:
    def estimate(_: Any) -> _Part:
        return _Part({"sample.stop_ms": 1000.0}, figures)

    given = Source("stop", fields, "all", error, estimate)
    with pytest.raises(AssertionError, match=words):
        _part_of(given, SimpleNamespace(fields={}))  # type: ignore[arg-type]
