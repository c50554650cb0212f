"""Items 10 and 15: the effect of each choice that the paper's text leaves open or states wrongly, and of the sample
timer.

A reading is one way to understand the paper's text at one point. The base is the scenario of preset ``paper``, which
simulates as the paper's own program did; each reading changes the base at one point. The measured values of the claims
are rows of ``claims.MEASURED``; ``Work.change`` makes a row from the difference of two cells (first - second), paired
by run.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import polars as pl

from vibroswarm.observation.energy_model import error_rates
from vibroswarm.paper.cell_tables import TIME, limits, two_forms
from vibroswarm.paper.cells import means_of
from vibroswarm.paper.claim_values import Row, exact, frame, mean
from vibroswarm.paper.columns import STRATEGIES, swapped_labels
from vibroswarm.paper.item import CLAIMS, Cells, Item, Picture, Settings, Tables, TableView, Work, picture
from vibroswarm.plots import draw_error_bars, draw_forest
from vibroswarm.show.document import Column, limits_of

READINGS: Final[dict[str, dict[str, Any]]] = {
    "theta_E 1.55, as in Algorithm 2": {"sensor.rms_threshold": 1.55},
    "theta_E 1.40, as in some recordings": {"sensor.rms_threshold": 1.40},
    "labels of the energies as printed": {},
    "timer always on, as printed": {"sample.timer": "always"},
    "timer held in a turn, not reset": {"sample.timer": "hold_in_turn"},
    "timer frozen in avoidance too": {"sample.timer": "frozen_in_avoidance"},
    "legs not clipped": {"walk.leg_min_ms": 0.0, "walk.leg_max_ms": 1e9},
    "speed drawn once a robot": {"robot.speed_redraw": "robot"},
    "avoidance finished before a sample": {"sample.interrupts_avoidance": False},
    "O_c counts received only": {"decision.gate": "received"},
    "O_c counts own only": {"decision.gate": "own"},
    "O_c counts the current sample": {"decision.gate_counts_current": True},
    "decisions may be revised": {"decision.revise": True},
    "O_c = 0": {"decision.min_observations": 0},
    "sensor without error": {
        "sensor.vibrating_location": 10.0, "sensor.still_location": -20.0, "sensor.rms_threshold": 0.0,
    },
    "2 % of packets lost": {"network.name": "loss", "network.loss.share": 0.02},
}  # fmt: skip
"""The fields that each reading sets; the fields of the reading ``LABELS`` are computed from the scenario."""
BASE: Final = "as the simulations ran"
"""Name of the base in tables."""
COLUMN: Final = "paper"
"""Preset in which the cells are simulated, also if it is not among the requested columns."""
LABELS: Final = "labels of the energies as printed"
"""Name of the reading in which the energies of vibrating and still tiles are swapped."""


def cells(settings: Settings) -> Cells:
    """Return the cells by (reading, strategy); the base counts as a reading."""
    return {
        (reading, strategy): settings.cell(COLUMN, _values(settings, reading, strategy))
        for reading in (BASE, *READINGS)
        for strategy in STRATEGIES
    }


def _values(settings: Settings, reading: str, strategy: str) -> dict[str, Any]:
    """Return the fields, by dotted name, of a cell of item 10; the base sets no fields of a reading."""
    values = {"floor.source": "random:0.48", "strategy.name": strategy}
    if reading == LABELS:
        return values | swapped_labels(settings.scenario(COLUMN))
    return values | READINGS.get(reading, {})


def compute(work: Work) -> Tables:
    """Return the table of cells, the differences of each reading from the base, and the claims' measured values.

    The base has rows too, with differences of 0.
    """
    pairs = [(reading, strategy) for reading in (BASE, *READINGS) for strategy in STRATEGIES]
    names = ("decision_time_s", "belief_in_truth", "wrong_share", "undecided_share")
    changes = {
        pair: {f"{name}_change": work.difference(name, pair, (BASE, pair[1])) for name in names}
        for pair in pairs
    }
    rows = [
        {"reading": reading, "strategy": strategy, **means_of(of_pair)}
        for (reading, strategy), of_pair in changes.items()
    ]
    return {
        "cells": work.rows(("reading", "strategy"), pairs),
        "changes": pl.DataFrame(rows, infer_schema_length=None),
        CLAIMS: frame(list(_measured(work))),
    }


def _measured(work: Work) -> Iterator[Row]:
    """Yield the measured values of the claims about the labels of the energies and the threshold, as printed.

    They are the belief in the truth with swapped labels minus 0.5, and, at the printed threshold 1.55, the false
    positive rate minus the false negative rate.
    """
    labels = "belief-with-printed-labels-less-half"
    cannot = (
        None if work.settings.scenario(COLUMN).sensor.model == "gamma" else "energies are drawn from no law"
    )
    for strategy in STRATEGIES:
        values = work.values((LABELS, strategy), "belief_in_truth")
        yield mean(labels, COLUMN, strategy, values, less=0.5, bounded=True, cannot=cannot)
    sensor = work.settings.scenario(COLUMN, {"sensor.rms_threshold": 1.55}).sensor
    false_positive, false_negative = error_rates(sensor)
    yield exact("false-positives-less-negatives", COLUMN, "1.55", false_positive - false_negative)


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield pictures of the differences in time and in belief of each reading from the base, without feedback."""
    part = tables["changes"].filter((pl.col("strategy") == "none") & (pl.col("reading") != BASE))
    for name, label in (
        ("decision_time_s", "change of decision time (s)"),
        ("belief_in_truth", "change of belief in the truth"),
    ):
        title = label.partition(" (")[0].capitalize()  # without the unit
        frame = part.select(
            comparison=pl.col("reading").str.replace("theta_E", "θ_E", literal=True),
            difference=f"{name}_change",
            low=f"{name}_change_low",
            high=f"{name}_change_high",
        )
        yield picture(
            f"readings-{name.replace('_', '-')}", title, draw_forest, frame, label=label,
            interval="95 % interval over runs, paired",
        )  # fmt: skip


_CHANGE: Final = {
    "reading": Column("reading"),
    "strategy": Column("strategy"),
    **{
        f"{name}_change": Column(
            title, unit, share=unit == "points", sign=True, limits=limits_of(f"{name}_change")
        )
        for name, title, unit in (
            ("decision_time_s", "change of time", "s"),
            ("belief_in_truth", "of belief in the truth", ""),
            ("wrong_share", "of robots wrong", "points"),
            ("undecided_share", "of robots undecided", "points"),
        )
    },
}
OPEN_READINGS: Final = Item(
    number=10,
    name="readings",
    title="What the text leaves open",
    about=(
        "The effect of each open or mistaken point of the text, read the other way, one at a time; preset `paper`, "
        "five robots, P*, fill ratio 0.48. Differences from the simulations as they ran are paired run by run.",
    ),
    cells=cells,
    compute=compute,
    pictures=pictures,
    shown=(TableView("changes", "Effect of each reading, with 95 % intervals over runs.", _CHANGE),),
)

ALWAYS, FROZEN, RAN = "always", "frozen_in_avoidance", "reset_after_turn"
TIMERS: Final = (ALWAYS, RAN, FROZEN)
"""Modes of the sample timer: as in the paper's text, as in the paper's program, and as in earlier work according to the
text."""
TIMER_KEYS: Final = ("timer", "strategy")


def cells_of_timers(settings: Settings) -> Cells:
    """Return the cells by (timer, strategy)."""
    return {
        (timer, strategy): settings.cell(
            COLUMN, {"floor.source": "random:0.48", "strategy.name": strategy, "sample.timer": timer}
        )
        for timer in TIMERS
        for strategy in STRATEGIES
    }


def compute_timers(work: Work) -> Tables:
    """Return the table of cells, and the claims' measured values."""
    return {"cells": work.rows(TIMER_KEYS), CLAIMS: frame(list(_measured_timers(work)))}


def _measured_timers(work: Work) -> Iterator[Row]:
    """Yield the measured values of the claims about the sample timer, paired by run.

    Each is a figure with the timer always on minus the same figure with the timer frozen in avoidance. Time and belief
    are compared even if decisions with the preset cannot answer the paper's question (``item.cannot_ask``), because the
    claim is only that the task gets harder.
    """
    # The distance between the samples of a robot, for one strategy: motion does not depend on the strategy.
    pair = (ALWAYS, "none"), (FROZEN, "none")
    yield work.change(
        "distance-timer-always-less-frozen", COLUMN, "always less frozen in avoidance", "distance_m", *pair
    )
    harder = {
        "time-timer-always-less-frozen": "decision_time_s",
        "belief-timer-always-less-frozen": "belief_in_truth",
    }
    for strategy in STRATEGIES:
        pair = (ALWAYS, strategy), (FROZEN, strategy)
        yield from work.changes(harder, COLUMN, strategy, *pair, check=False)


def pictures_of_timers(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield the picture of the decision time with each timer."""
    points = limits(tables["cells"], "decision_time_s").select(
        "estimate", "low", "high", "runs", x=pl.col("timer").str.replace_all("_", " "), series="strategy"
    )
    yield picture("timer-decision-time", "Decision time with each timer", draw_error_bars, points, label=TIME)


TIMER: Final = Item(
    number=15,
    name="timer",
    title="The sample timer",
    about=(
        "The paper keeps the timer on at all times, and says that this raises the correlation of samples and so the "
        "difficulty of the task, compared with a timer that stops during avoidance. Both are run here, and the timer "
        "as it really ran; preset `paper`, five robots, P*, fill ratio 0.48. A difficult task takes longer or is "
        "judged less accurately: both are tested.",
    ),
    cells=cells_of_timers,
    compute=compute_timers,
    pictures=pictures_of_timers,
    shown=two_forms(TIMER_KEYS, walk=True),
)
