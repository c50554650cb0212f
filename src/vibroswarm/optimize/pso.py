"""Search with the paper's noise-resistant particle swarm.

| name | symbol | equation |
|---|---|---|
| velocity | v_i | v' = w v + w_p R_1 (p_b - p) + w_g R_2 (g_b - p) (Eq. 21a) |
| position | p_i | p' = p + v' (Eq. 21b), clipped to the bounds |
| inertia | w | from 1.0 to 0.4, linear over the iterations |
| weights | w_p, w_g | 0.75, 0.75 |
| random factors | R_1, R_2 | diagonal, uniform in (0, 1), for each particle, dimension and iteration |
| evaluations | N_e | 10, and 10 more for the best 20 % |

``noise`` determines who gets the extra evaluations, and how personal bests are scored:

* ``fixed``, the paper: the best 20 % of the particles get them; a personal best keeps the score with which it became
  one, so that the luckiest wins.
* ``as-ran``, the paper's program: ``fixed``, and besides velocities are 0 at first, the first move has the full inertia
  w = 1.0, all particles share the runs of an iteration (``shared_run``), and runs that crash are dropped.
* ``rescore`` (default): the best 20 % of particles and personal bests together get them, and every score uses all
  evaluations so far.
* ``ocba``: they are allocated where they best discriminate between candidates (see ``race``).

In the last two, scores are corrected for small-sample bias and compared with ``caution``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError, check_choice, number_of, whole_number_of
from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.methods import Ask, Iteration, chance, iteration_of
from vibroswarm.optimize.race import allocate_runs
from vibroswarm.optimize.space import Point

NOISE: Final = ("rescore", "ocba", "fixed", "as-ran")
KEEPS_SCORES: Final = ("fixed", "as-ran")
"""Kinds of ``noise`` in which a personal best keeps the score with which it became one."""
FIRST_REEVALUATION: Final = 2
"""Re-evaluations count from here: of ten numbers in a row only 2 to 11, times iterations 1 to 50, give 265 products."""


def shared_run(evaluation: int, iteration: int) -> int:
    """Return the number of the run of an evaluation, as the paper's program seeded it: re-evaluation x (iteration + 1).

    All particles of an iteration share the run, and it is often that of an earlier iteration: the first ten evaluations
    of 50 iterations are 500, but only 265 of their numbers are distinct.

    Args:
        evaluation, iteration: from 0. A candidate's extra evaluations go on counting.
    """
    return (evaluation + FIRST_REEVALUATION) * (iteration + 1)


@dataclass(frozen=True)
class PsoSettings(NotebookView):
    """The swarm's settings; defaults are the paper's except for ``noise``.

    Args:
        particles, iterations: how many. evaluations: runs of each particle in each iteration.
        extra, extra_share: number of extra runs, and the share of the best that get them.
        inertia_first, inertia_last: omega, falling linearly. weight_personal, weight_global: omega_p, omega_g.
        first_velocity, caution: see below.
        noise: ``rescore``, ``ocba``, ``fixed`` (the paper) or ``as-ran`` (its program), see docs/optimizing.md.
        crash_share: see below.
    Raises:
        InputError: no particles, no iterations, a weight that is no number.
    """

    particles: int = 25
    iterations: int = 50
    evaluations: int = 10
    extra: int = 10
    extra_share: float = 0.2
    inertia_first: float = 1.0
    inertia_last: float = 0.4
    weight_personal: float = 0.75
    weight_global: float = 0.75
    first_velocity: float = 0.1
    """Initial velocities are uniform between minus and plus this fraction of the bounds (``as-ran``: 0)."""
    noise: str = "rescore"
    caution: float = 1.0
    """With ``rescore`` and ``ocba``: candidates are compared by score plus this number of standard errors."""
    crash_share: float = 0.0
    """With ``as-ran``: share of runs that are taken to crash, at random; a tenth of those of the study did."""

    def __post_init__(self) -> None:
        for name, low in (("particles", 1), ("iterations", 1), ("evaluations", 1), ("extra", 0)):
            whole_number_of(getattr(self, name), f"pso.{name}", low, 10**9)
        for name in (
            "extra_share", "inertia_first", "inertia_last", "weight_personal", "weight_global",
            "first_velocity", "caution",
        ):  # fmt: skip
            number_of(getattr(self, name), f"pso.{name}", 0, 1 if name == "extra_share" else 1000)
        check_choice(self.noise, "pso.noise", NOISE)
        number_of(self.crash_share, "pso.crash_share", 0, 0.9)
        if self.crash_share and self.noise != "as-ran":
            raise InputError('needs noise = "as-ran"; elsewhere no run is dropped', field="pso.crash_share")

    @property
    def keeps_scores(self) -> bool:
        """Whether a personal best keeps the score with which it became one, as in the paper."""
        return self.noise in KEEPS_SCORES

    @property
    def best_of(self) -> int:
        """Number of particles with extra evaluations."""
        return math.ceil(self.extra_share * self.particles - 1e-9)

    @property
    def runs_an_iteration(self) -> int:
        """Runs in one iteration."""
        return self.particles * self.evaluations + self.extra_runs

    @property
    def extra_runs(self) -> int:
        """Extra runs in one iteration."""
        return self.best_of * self.extra


class Pso:
    """The swarm, with positions in the unit cube."""

    name = "pso"

    def __init__(
        self, archive: Archive, seed: int, settings: PsoSettings, starts: list[Point] | None = None
    ) -> None:
        self.archive, self.seed, self.settings = archive, seed, settings
        self.iterations, self.iteration, self.extras = settings.iterations, 0, False
        self.history: list[Iteration] = []
        shape = (settings.particles, archive.space.size)
        random = chance(seed, "pso begins")
        self.position = random.random(shape)
        span = 0.0 if settings.noise == "as-ran" else settings.first_velocity
        self.velocity = span * (2.0 * random.random(shape) - 1.0)
        if starts and len(starts) > settings.particles:
            raise InputError(f"{len(starts)} starts for {settings.particles} particles", field="start")
        for k, start in enumerate(starts or []):
            self.position[k] = start
        self.current: list[int] = []
        self.personal: list[int] = []
        self.kept = np.full(settings.particles, math.inf)
        """Scores of the personal bests when they became so, for ``KEEPS_SCORES``."""

    def ask(self) -> list[Ask]:
        """Request runs of all particles, then the extra evaluations; nothing after the last iteration."""
        if self.iteration == self.iterations:
            return []
        if not self.extras:
            origin = f"pso {self.iteration + 1}"
            self.current = [self.archive.new(point, origin, self.iteration) for point in self.position]
            return [Ask(key, self.settings.evaluations) for key in self.current]
        return self._extra_asks()

    def tell(self) -> None:
        """After the extra evaluations, update the personal bests and move the particles."""
        if not self.extras and self.settings.extra_runs:
            self.extras = True
            if self._extra_asks():
                return
        self.extras = False
        self._update_bests()
        self.iteration += 1
        personal, best = self._personal_scores(), self.best()
        lowest = (best, float(personal.min()))
        self.history.append(
            iteration_of(self.archive, self.iteration, self.current, lowest, self.position, personal)
        )
        if self.iteration < self.iterations:
            self._move()

    def best(self) -> int:
        """Return the global best."""
        return self.personal[int(np.argmin(self._personal_scores()))]

    def finalists(self, count: int) -> list[int]:
        """Return the best personal bests, each once."""
        order = np.argsort(self._personal_scores(), kind="stable")
        return list(dict.fromkeys(self.personal[k] for k in order))[:count]

    def _extra_asks(self) -> list[Ask]:
        """Request the extra evaluations, according to ``noise``."""
        settings, archive = self.settings, self.archive
        if settings.keeps_scores:
            order = sorted(self.current, key=lambda k: (archive.score(k), k))
            return [Ask(key, settings.extra) for key in order[: settings.best_of]]
        among = list(dict.fromkeys([*self.personal, *self.current]))
        if settings.noise == "rescore":
            among.sort(key=lambda k: (archive.estimate(k)[0], k))
            return [Ask(key, settings.extra) for key in among[: settings.best_of]]
        return allocate_runs(archive, among, settings.extra_runs)

    def _update_bests(self) -> None:
        """Update the personal bests with the current scores."""
        now = np.array([self._score(key) for key in self.current])
        if not self.personal:
            self.personal, self.kept = list(self.current), now
            return
        before = self.kept if self.settings.keeps_scores else self._personal_scores()
        for k in np.flatnonzero(now < before):
            self.personal[k], self.kept[k] = self.current[k], now[k]

    def _score(self, key: int) -> float:
        if self.settings.keeps_scores:
            return self.archive.score(key)
        return self.archive.cautious(key, self.settings.caution)

    def _personal_scores(self) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        if self.settings.keeps_scores:
            return self.kept
        return np.array([self._score(key) for key in self.personal])

    def _move(self) -> None:
        """Move all particles by the velocity update of the paper."""
        settings = self.settings
        moves_before = self.iteration - 1 if settings.noise == "as-ran" else self.iteration
        share = moves_before / max(self.iterations - 1, 1)
        inertia = settings.inertia_first + share * (settings.inertia_last - settings.inertia_first)
        random = chance(self.seed, f"pso {self.iteration + 1}")
        r_1, r_2 = random.random((2, *self.position.shape))
        to_personal = np.array([self.archive[key].point for key in self.personal]) - self.position
        to_global = self.archive[self.best()].point - self.position
        self.velocity = (  # Eq. 21a
            inertia * self.velocity
            + settings.weight_personal * r_1 * to_personal
            + settings.weight_global * r_2 * to_global
        )
        self.position = np.clip(self.position + self.velocity, 0.0, 1.0)  # Eq. 21b
