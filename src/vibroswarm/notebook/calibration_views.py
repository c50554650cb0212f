"""What a notebook shows of a calibration: a fit, and how alike recordings and simulation are."""

from __future__ import annotations

from vibroswarm.calibrate.features import WORDS
from vibroswarm.calibrate.fit import LACKS, Fit
from vibroswarm.calibrate.real_vs_simulated import Comparison
from vibroswarm.notebook.elements import card, details, paragraph, rows, table
from vibroswarm.notebook.views import view_of


@view_of.register
def _fit(value: Fit) -> str:
    """Show the fitted fields, the estimates, the predictive check, and what the model lacks."""
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


@view_of.register
def _comparison(value: Comparison) -> str:
    """Show how alike each feature is, and how well stretches are recognised as real or simulated."""
    alike = [
        [
            WORDS[one.feature],
            *(f"{part:.3f}" for part in (one.null, one.at_equal_counts, one.ceiling)),
            f"{apart.effect.estimate:.3f} [{apart.effect.low:.3f}, {apart.effect.high:.3f}]",
        ]
        for one, apart in zip(value.similarities, value.distances, strict=True)
    ]
    share = value.classifier.simulated
    return card(
        "Recordings and simulation",
        table(["feature", "null", "similarity", "ceiling", "energy distance"], alike),
        paragraph(
            "Similarity lies between null and ceiling; an energy distance of 0 means the same distribution. A "
            f"classifier recognises {share.estimate:.3f} [{share.low:.3f}, {share.high:.3f}] of the stretches as real "
            "or simulated (0.5: chance)."
        ),
        paragraph(f"Missing in one of the two: {', '.join(value.missing)}.") if value.missing else "",
    )
