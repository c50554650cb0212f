"""Notebook views (HTML) of the results of calibrations.

Their packages take long to import. So a view is registered under the name of a class, and imports the package only
when it is called with an object of that class.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from vibroswarm.notebook.elements import card, details, paragraph, rows, table

if TYPE_CHECKING:
    from vibroswarm.calibrate.fit import Fit
    from vibroswarm.calibrate.real_vs_simulated import Comparison

View = Callable[[Any], str]
"""A function that takes an object and returns its view as HTML."""

VIEWS: Final[dict[str, View]] = {}
"""Views by the module and name of the class, such as ``vibroswarm.calibrate.fit.Fit``."""


def shows(name: str) -> Callable[[View], View]:
    """Return a decorator that registers a function as the view of a class.

    Args:
        name: module and name of the class without "vibroswarm.", such as ``calibrate.fit.Fit``.
    """

    def register(view: View) -> View:
        """Register a function, which takes an object of the class and returns HTML, and return it unchanged."""
        VIEWS[f"vibroswarm.{name}"] = view
        return view

    return register


def lazy_view_of(value: object) -> View | None:
    """Return the view of an object's class, or else of its nearest base class with a view; None if there is none."""
    names = (f"{kind.__module__}.{kind.__qualname__}" for kind in type(value).__mro__)
    return next((VIEWS[name] for name in names if name in VIEWS), None)


@shows("calibrate.fit.Fit")
def _fit(value: Fit) -> str:
    """Show the fitted fields, the estimates, the predictive check, and what the model is known to lack.

    The predictive check compares statistics of the recorded avoidances with those of simulated sessions.
    """
    from vibroswarm.calibrate.fit import LACKS

    estimates = [
        [one.name, f"{one.value:.5g}", f"[{one.low:.4g}, {one.high:.4g}]", f"{one.error:.2g}"]
        for one in value.figures
    ]
    checks = [
        [name, f"{recorded:.4g}", f"[{low:.4g}, {high:.4g}]", "" if low <= recorded <= high else "outside"]
        for name, (recorded, low, high) in value.predicted.items()
    ]
    return card(
        "Fitted scenario",
        paragraph(f"{value.sessions} sessions, {value.motion_runs} runs of motion. Scenario: fit.scenario"),
        rows(value.changed),
        table(["estimate", "value", "95 % interval", "s.e."], estimates),
        table(["avoidance", "recorded", "95 % of simulated sessions", ""], checks) if checks else "",
        details("What the model lacks", "\n".join(LACKS)),
    )


@shows("calibrate.real_vs_simulated.Comparison")
def _comparison(value: Comparison) -> str:
    """Show how similar recordings and simulation are.

    For each feature the view has the similarity and the energy distance of the two sources. A sentence says how well a
    classifier recognises whether samples are recorded or simulated. Among others, the results for an exact camera and
    for undisturbed intervals are not shown.
    """
    from vibroswarm.calibrate.features import WORDS

    # Null and ceiling are computed from equal numbers of values of both sources; so the similarity is, too.
    body = [
        [
            WORDS[similarity.feature],
            *(f"{part:.3f}" for part in (similarity.null, similarity.at_equal_counts, similarity.ceiling)),
            f"{distance.effect.estimate:.3f} [{distance.effect.low:.3f}, {distance.effect.high:.3f}]",
        ]
        for similarity, distance in zip(value.similarities, value.distances, strict=True)
    ]
    # Balanced accuracy with which the classifier tells recordings from simulation; a stretch is a number of
    # consecutive samples of one robot (``classifier.STRETCH``).
    share = value.classifier.simulated
    return card(
        "Recordings and simulation",
        table(["feature", "null", "similarity", "ceiling", "energy distance"], body),
        paragraph(
            "Similarity lies between null and ceiling; an energy distance of 0 means the same distribution. A "
            f"classifier recognises {share.estimate:.3f} [{share.low:.3f}, {share.high:.3f}] of the stretches as real "
            "or simulated (0.5: chance)."
        ),
        paragraph(f"Too few values to compare: {', '.join(WORDS[feature] for feature in value.missing)}.")
        if value.missing
        else "",
    )
