"""Item 18: predicting a session that no fit has seen.

Each recorded session is held out in turn. A scenario is fitted to the other two, simulated on the floor of the held-out
one, and seen through the fitted camera. Two things are predicted: how many samples the robots take, and the
distribution of six features, compared by the cosine similarity at equal counts, session with session. The second is
measured against the study's own simulator, which was tuned by hand.

A negative control is computed beside it: the same scenarios with a sample timer that these robots did not run
(``sample.timer = "held_at_avoidance"``), so that they sample less and at other places.

The units are simulated sessions: the limits say how well the mean prediction of these three fits is known. They do not
hold the chance of the fits themselves: with other seeds of their search the predicted numbers of samples differ by
0.8 to 0.9 % (standard deviation over nine seeds). All three sessions have the same five robots and one floor, so
nothing follows for other robots.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.calibrate.cross_validation import simulated_by
from vibroswarm.calibrate.dataset import Dataset, dataset_of
from vibroswarm.calibrate.features import FEATURES, WORDS, Sessions
from vibroswarm.calibrate.fit import Fit, fit
from vibroswarm.calibrate.similarity import at_equal_counts
from vibroswarm.paper.claim_values import Row, frame, mean
from vibroswarm.paper.columns import (
    AUTHORS,
    EMPIRICAL,
    REAL,
    hash_of,
    missing,
    read_recordings,
    real_floor,
    scenario_of,
)
from vibroswarm.paper.item import CLAIMS, Item, Tables, TableView, Work, needs_column
from vibroswarm.show.document import Column

COLUMN: Final = "calibrated"
"""The preset whose fit is tested."""
CANDIDATES: Final = 1000
"""Parameter vectors that each fit of avoidance simulates: fewer than by default, since there are three fits."""
SIMULATED: Final = 12
"""Simulated sessions for each held-out session."""
CONTROL: Final = {"sample.timer": "held_at_avoidance"}
"""Fields of the negative control."""
SAMPLES, SIMILARITY = "predicted-samples-over-recorded", "predicted-similarity-less-simulator"
"""Names of the measured values."""


Predicted = tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]
"""Predictions of one held-out session.

- number of samples of each simulated session, divided by the recorded number, minus 1
- by feature, the similarity of each simulated session to the held-out one, minus that of the study's simulator
"""


def predict(
    fitted: Fit, found: Dataset, theirs: Dataset, session: int, seed: int, values: dict[str, Any]
) -> Predicted:
    """Simulate a held-out session, and compare with it.

    Args:
        fitted: fit to the other sessions. found: all recorded sessions. theirs: sessions of the study's simulator.
        session: number of the held-out session. seed: of the simulations.
        values: fields of the fitted scenario that are changed, by dotted name.
    """
    simulated = simulated_by(fitted, found.floors[session], seed, SIMULATED, values).by_session
    held_out = found.only([session]).samples
    real, ours_by, theirs_by = (Sessions(tuple(one)) for one in ([held_out], simulated, theirs.by_session))
    similarity = {}
    for feature in FEATURES:
        (own,), ours, others = (one.values(feature) for one in (real, ours_by, theirs_by))
        count = min(len(values) for values in (own, *ours, *others))
        # The held-out session's own draws are those of all comparisons.
        drawn: dict[tuple[int, int, int, int], NDArray[np.float64]] = {}
        near, far = (
            [at_equal_counts(feature, own, one, count, drawn) for one in source] for source in (ours, others)
        )
        similarity[feature] = np.array(near) - float(np.mean(far))
    return np.array([one.height / held_out.height - 1.0 for one in simulated]), similarity


def rows_of(predicted: dict[int, Predicted]) -> Iterator[Row]:
    """Yield the measured values of both claims.

    Args:
        predicted: by number of the held-out session.
    """
    for session, (samples, similarity) in predicted.items():
        yield mean(SAMPLES, COLUMN, f"session {session + 1}", samples)
        for feature, values in similarity.items():
            yield mean(SIMILARITY, COLUMN, f"{WORDS[feature]}, session {session + 1}", values)


def compute(work: Work) -> Tables:
    """Hold out each session, and return the claims' measured values, and these beside those of the control."""
    settings = work.settings
    assert settings.recordings is not None  # otherwise the item is skipped
    real, authors = (read_recordings(settings.recordings, names) for names in (REAL, AUTHORS))
    found, theirs = dataset_of([real]), dataset_of([authors])
    # Without the negative controls of the reproduction: the fit replaces what they change.
    base = scenario_of("paper", real_floor(), parameter_set=EMPIRICAL)
    predicted: dict[int, Predicted] = {}
    control: dict[int, Predicted] = {}
    for done, (session, rest) in enumerate(found.held_out()):
        fitted = fit(rest, base, candidates=CANDIDATES, errors=False)
        predicted[session] = predict(fitted, found, theirs, session, settings.seed, {})
        control[session] = predict(fitted, found, theirs, session, settings.seed, CONTROL)
        work.progress((done + 1) / len(found.sessions))
    measured, turned = frame(list(rows_of(predicted))), frame(list(rows_of(control)))
    both = pl.DataFrame(
        {
            "value": measured["value"],
            "cell": measured["cell"],
            "predicted": measured["estimate"],
            "error": measured["standard_error"],
            "control": turned["estimate"],
            "control_error": turned["standard_error"],
        }
    )
    return {"predicted": both, "control": turned, CLAIMS: measured}


ITEM: Final = Item(
    number=18,
    name="unseen-session",
    title="A session that no fit has seen",
    about=(
        "Each of the three recorded sessions is predicted by a scenario that was fitted to the other two: the number "
        "of samples, relative to the recorded one, and six similarities, minus those of the study's own simulator. "
        "The control has a sample timer that these robots did not run. Limits are over simulated sessions. They do not "
        "hold the chance of the fit: with another seed of its search the numbers of samples differ by 0.8 to 0.9 % "
        "(standard deviation).",
    ),
    compute=compute,
    shown=(
        TableView(
            "predicted",
            f"Means and standard errors over {SIMULATED} simulated sessions for each recorded one; number of samples "
            "relative to the recorded one, or similarity minus that of the study's simulator.",
            {
                "cell": Column("what"), "predicted": Column("fitted", decimals=3), "error": Column("error", decimals=3),
                "control": Column("control", decimals=3), "control_error": Column("error", decimals=3),
            },
        ),
    ),
    skipped=lambda settings: needs_column(COLUMN)(settings) or missing(settings.recordings),
    also=lambda settings: "" if settings.recordings is None else hash_of(settings.recordings),
)  # fmt: skip
