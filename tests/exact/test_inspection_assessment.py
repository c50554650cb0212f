"""All answers of one inspection of a third of a surface, and what its certificate says of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from helpers.inspections import drawn_samples
from vibroswarm import preset
from vibroswarm.documents.damage import MOST_LISTED, damage_answer
from vibroswarm.documents.inspection import certificate_document
from vibroswarm.inspection import missed
from vibroswarm.inspection.assessment import assess
from vibroswarm.inspection.damage import ratios_at, values_at
from vibroswarm.inspection.inspection import Inspection
from vibroswarm.inspection.patches import Form
from vibroswarm.inspection.samples import Law
from vibroswarm.inspection.scan import MOST_CALLED, near
from vibroswarm.inspection.stopping import Question
from vibroswarm.show.document import Section, Table, Text


@pytest.fixture(scope="module")
def found() -> Inspection:
    """The left third is visited, most of it is damaged, and robot 1 took five samples."""
    law = Law(preset("paper").sensor, "preset paper")
    every = replace(drawn_samples(3, count=240, spread_m=0.0), law=law, floor=None)
    value = values_at(law, np.random.default_rng(4).random(240), every.column("y_m") > 0.1)
    robot = (np.arange(240) < 5).astype(np.uint16)
    wide = replace(every, size_m=(1.8, 0.6))
    samples = wide.with_columns(value=value, log_ratio=ratios_at(law, value), robot=robot)
    question = Question(least_m=0.2, contrasts=(1.0,))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(missed, "WEAKEST_M", ())  # takes half of the time
        assessment = assess(samples, question, sides_m=(0.1,), replicates=19)
    return Inspection(samples, np.array([240.0]), None, {}, assessment=assessment)


def test_probability_of_detection_ends_below_one_where_little_is_visited(found: Inspection) -> None:
    assert found.assessment is not None
    pod = found.assessment.pods[1.0]
    assert found.assessment.visited == pytest.approx(1 / 3, abs=0.02)
    assert pod.top < 0.95
    assert np.isnan(pod.a90_m)


def test_a_certificate_says_how_many_patches_it_leaves_out(found: Inspection) -> None:
    """It listed four, as if there were no others."""
    assert found.assessment is not None
    called = found.assessment.scan.called_m
    assert len(called) > MOST_LISTED
    where = next(
        part
        for part in certificate_document(found).parts
        if isinstance(part, Section) and part.title == "Where"
    )
    tables = [part.frame.height for part in where.parts if isinstance(part, Table)]
    texts = [part.words for part in where.parts if isinstance(part, Text)]
    assert tables == [MOST_LISTED]
    assert f"{len(called) - MOST_LISTED} more patch" in texts[-1]


def test_as_many_patches_as_are_called_at_most_are_a_lower_limit(found: Inspection) -> None:
    assessment = found.assessment
    assert assessment is not None
    many = replace(assessment.scan, called_m=assessment.scan.called_m[:1] * MOST_CALLED)
    assert damage_answer(replace(assessment, scan=many))[0].startswith(
        f"DAMAGE: at least {MOST_CALLED} patches"
    )
    assert damage_answer(assessment)[0].startswith(f"DAMAGE: {len(assessment.scan.called_m)} patches")


def test_a_surface_is_clear_by_the_risk_at_the_end(found: Inspection) -> None:
    """Damage that was believed to be absent for some time may be suspected later."""
    assert found.assessment is not None
    told = found.assessment.stopping.told
    verdicts = []
    for last in (0.01, 0.5):
        stopping = replace(found.assessment.stopping, told=np.append(np.full(told.size - 1, 0.01), last))
        intact = replace(found.assessment.scan, p_value=0.5)
        verdicts.append(replace(found.assessment, scan=intact, stopping=stopping).verdict)
    assert verdicts == ["clear", "open"]


def test_a_check_that_could_not_be_made_is_told_with_its_reason(found: Inspection) -> None:
    """It read "only 240 samples", where one robot took nearly all of them."""
    assert found.assessment is not None
    words = " ".join(found.assessment.refusals)
    assert "robots against each other could not be checked: at most one robot has 10 samples" in words


@pytest.mark.parametrize("robots", [1, 2])
@pytest.mark.usefixtures("few_draws")
def test_all_that_is_drawn_is_looked_at_as_often_and_false_calls_are_drawn_anew(
    robots: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of two damaged squares, seen by one of the robots. 9 of the 199 surfaces that give the threshold reach it."""
    monkeypatch.setattr(missed, "WEAKEST_M", ())
    monkeypatch.setitem(missed.false_calls.__kwdefaults__, "intact", 199)
    law = Law(preset("paper").sensor, "preset paper")
    samples = replace(drawn_samples(3, count=300, spread_m=0.0), law=law, floor=None)
    x_m, y_m = (samples.column(name) for name in ("x_m", "y_m"))
    damaged = (np.maximum(x_m, y_m) < 0.2) | (np.minimum(x_m, y_m) > 0.4)
    value = values_at(law, np.random.default_rng(4).random(300), damaged)
    robot = np.where(damaged, 0.0, robots - 1.0)
    samples = samples.with_columns(value=value, log_ratio=ratios_at(law, value), robot=robot)
    question = Question(least_m=0.2, contrasts=(1.0, 0.4))
    found = assess(samples, question, sides_m=(0.2,), replicates=199, looks=6, shapes=("square", "disc"))
    false = round(199 * found.pods[1.0].false_calls)
    assert false != 9
    assert 5 <= false <= 20
    assert found.shaped["disc"].at(0.2) > found.pods[0.4].at(0.2) + 0.3
    assert len(found.scan.called_m) == 2
    sure = [cells.max() > 0.9 for cells in found.own_rasters.values()]
    assert sure == ([] if robots == 1 else [True, False])
    for box, region in zip(found.scan.called_m, found.scan.regions, strict=True):
        assert region.holds(Form(box.width_m, box.height_m), *box.centre_m)
    away = np.all([~near(samples, box) for box in found.scan.called_m], axis=0)
    assert 20 < found.checks["samples"][0] <= away.sum()
    assert any(why.startswith("one robot took all samples") for why in found.refusals) == (robots == 1)
