"""Which fields told good candidates from the rest of a search: PED-ANOVA, from runs that were made anyway.

It compares where the best share of candidates lies with where all lie, field by field (Watanabe, Bansal and Hutter,
"PED-ANOVA", IJCAI 2023; through Optuna). It takes no further run and minds noise little, but speaks only for where the
search went; Sobol indices (``sensitivity``) speak for the whole space.
"""

from __future__ import annotations

import math
from typing import Final

from vibroswarm.errors import InputError
from vibroswarm.optimize.dashboard import distribution_of
from vibroswarm.optimize.libraries import no_warnings, optuna
from vibroswarm.optimize.loop import Found

FEWEST: Final = 20
"""Candidates."""


def ped_anova(found: Found, best_share: float = 0.1) -> dict[str, float]:
    """Share of importance of each field, the largest first; they add up to 1.

    Args:
        found: a search that has been run. best_share: of the candidates, taken for the good ones.
    Raises:
        InputError: Optuna is not there, too few candidates, or a share outside (0, 1).
    """
    if not 0 < best_share < 1:
        raise InputError(f"{best_share!r} is no share", field="best_share")
    library, archive = optuna(), found.archive
    distributions = {d.name: distribution_of(library, d) for d in archive.space}
    scored = [(c, archive.score(c.key)) for c in archive.candidates]
    there = [(c, score) for c, score in scored if math.isfinite(score)]
    if len(there) < FEWEST:
        raise InputError(f"{len(there)} candidates are too few; at least {FEWEST}", field="found")
    with no_warnings():
        study = library.create_study()
        for candidate, score in there:
            study.add_trial(
                library.trial.create_trial(
                    params=dict(candidate.values), distributions=distributions, value=score
                )
            )
        evaluator = library.importance.PedAnovaImportanceEvaluator(target_quantile=best_share)
        importances = library.importance.get_param_importances(study, evaluator=evaluator)
    return {str(name): float(share) for name, share in importances.items()}
