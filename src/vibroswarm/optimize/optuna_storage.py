"""Copy a search into Optuna's storage, for Optuna's dashboard.

    optuna-dashboard out/search/optuna.journal

The copy is a journal of JSON lines, safe on shared file systems. Only the keys of its candidates are read back, so a
damaged copy is set aside and written again. The lock of a killed process is taken over.
"""

from __future__ import annotations

import math
import os
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from vibroswarm.errors import RunError, warn_once
from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.optuna_samplers import ignore_warnings, optuna
from vibroswarm.optimize.space import Dimension

FILE: Final = "optuna.journal"
DAMAGED: Final = "optuna.journal.damaged"
LOCK_S: Final = 5.0
"""A lock is held while a line is written; one that is older than this belongs to a killed process."""


class Lock:
    """The lock file of Optuna's journal, which is taken over if its process was killed.

    Optuna's own locks check the age of a link's target, so that they wait for ever on a dangling link.
    """

    def __init__(self, journal: Path) -> None:
        self.path = Path(f"{journal}.lock")

    def acquire(self) -> bool:
        """Wait for the lock and take it."""
        seen: int | None = None
        since_s = time.monotonic()
        while True:
            try:
                os.close(os.open(self.path, os.O_CREAT | os.O_EXCL | os.O_WRONLY))
                return True
            except FileExistsError:
                pass
            with suppress(FileNotFoundError):
                made = self.path.lstat().st_mtime_ns
                if made != seen:
                    seen, since_s = made, time.monotonic()
                elif time.monotonic() - since_s > LOCK_S:
                    self.path.unlink()
                    continue
            time.sleep(0.01)

    def release(self) -> None:
        """Release the lock."""
        self.path.unlink(missing_ok=True)


class Dashboard:
    """Optuna's journal in the folder of a search."""

    def __init__(self, folder: Path, archive: Archive, name: str) -> None:
        self.library, self.archive = optuna(), archive
        path = folder.absolute() / FILE
        try:
            _cut(path)
            self.study, self.shown = self._open(path, name)
        except OSError as error:
            raise RunError(f"could not write '{path}': {error.strerror or error}") from error
        except Exception as error:  # a library may raise anything for a damaged file
            path.replace(folder / DAMAGED)
            warn_once(
                f"{path} is damaged ({type(error).__name__}); it is renamed to {DAMAGED} and written again"
            )
            self.study, self.shown = self._open(path, name)
        self.distributions = {d.name: distribution_of(self.library, d) for d in archive.space}

    def _open(self, path: Path, name: str) -> tuple[Any, set[int]]:
        """Open Optuna's study in this file and list its candidates."""
        storages = self.library.storages
        with ignore_warnings():
            backend = storages.journal.JournalFileBackend(str(path), Lock(path))
            study = self.library.create_study(
                storage=storages.JournalStorage(backend),
                study_name=name or "vibroswarm",
                directions=["minimize"] * len(self.archive.objectives),
                load_if_exists=True,
            )
            return study, {int(t.user_attrs["key"]) for t in study.trials if "key" in t.user_attrs}

    def show(self) -> None:
        """Add the candidates with runs that the copy lacks."""
        for candidate in self.archive.candidates:
            if candidate.key in self.shown or not candidate.count:
                continue
            scores = self.archive.scores(candidate.key)
            there = all(math.isfinite(score) for score in scores)
            state = self.library.trial.TrialState
            with ignore_warnings():
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


def _cut(path: Path) -> None:
    """Drop an incomplete last line, whose writer was killed."""
    if not path.exists():
        return
    lock = Lock(path)
    lock.acquire()
    try:
        end = (data := path.read_bytes()).rfind(b"\n") + 1
        if end < len(data):
            os.truncate(path, end)
    finally:
        lock.release()


def distribution_of(library: Any, dimension: Dimension) -> Any:
    """Convert a field's bounds to an Optuna distribution."""
    of = library.distributions
    if dimension.choices:
        return of.CategoricalDistribution(dimension.choices)
    log = dimension.scale == "log"
    if dimension.whole:
        return of.IntDistribution(int(dimension.low), int(dimension.high), log=log)
    return of.FloatDistribution(dimension.low, dimension.high, log=log)
