"""A search in Optuna's own storage, to be looked at with its dashboard while it runs and after.

    optuna-dashboard out/search/optuna.journal

A copy for the eye: a journal of JSON lines, safe on shared file systems; nothing is read back from it but which
candidates it holds.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.libraries import no_warnings, optuna
from vibroswarm.optimize.space import Dimension

FILE: Final = "optuna.journal"


class Dashboard:
    """Optuna's journal in the folder of a search."""

    def __init__(self, folder: Path, archive: Archive, name: str) -> None:
        self.library, self.archive = optuna(), archive
        storages = self.library.storages
        with no_warnings():
            backend = storages.journal.JournalFileBackend(str(folder / FILE))
            self.study = self.library.create_study(
                storage=storages.JournalStorage(backend),
                study_name=name or "vibroswarm",
                directions=["minimize"] * len(archive.objectives),
                load_if_exists=True,
            )
            self.shown = {int(t.user_attrs["key"]) for t in self.study.trials if "key" in t.user_attrs}
        self.distributions = {d.name: distribution_of(self.library, d) for d in archive.space}

    def show(self) -> None:
        """Add the candidates that have runs and are not there yet."""
        for candidate in self.archive.candidates:
            if candidate.key in self.shown or not candidate.count:
                continue
            scores = self.archive.scores(candidate.key)
            there = all(math.isfinite(score) for score in scores)
            state = self.library.trial.TrialState
            with no_warnings():
                trial = self.library.trial.create_trial(
                    params=dict(candidate.values),
                    distributions=self.distributions,
                    values=scores if there else None,
                    state=state.COMPLETE if there else state.FAIL,
                    user_attrs={
                        "key": candidate.key,
                        "origin": candidate.origin,
                        "runs": candidate.count,
                        "failed": candidate.failed,
                    },
                )
                self.study.add_trial(trial)
            self.shown.add(candidate.key)


def distribution_of(library: Any, dimension: Dimension) -> Any:
    """A field's bounds as Optuna has them."""
    of = library.distributions
    if dimension.choices:
        return of.CategoricalDistribution(dimension.choices)
    log = dimension.scale == "log"
    if dimension.whole:
        return of.IntDistribution(int(dimension.low), int(dimension.high), log=log)
    return of.FloatDistribution(dimension.low, dimension.high, log=log)
