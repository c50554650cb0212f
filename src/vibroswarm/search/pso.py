"""Search with the paper's noise-resistant particle swarm.

| name | symbol | equation |
|---|---|---|
| velocity | v_i | v' = w v + w_p R_1 (p_b - p) + w_g R_2 (g_b - p) (Eq. 21a) |
| position | p_i | p' = p + v' (Eq. 21b), clipped to the bounds |
| inertia | w | from 1.0 to 0.4, linear over the iterations |
| weights | w_p, w_g | 0.75, 0.75 |
| random factors | R_1, R_2 | diagonal, uniform in (0, 1), for each particle, dimension and iteration |
| evaluations | N_e | 10, and 10 more for the best 20 % |

A personal best (p_b) is the best candidate of one particle so far, the global best (g_b) the best of all personal
bests. In each iteration every particle is a new candidate at its position. After the first evaluations of these
candidates, some candidates get extra evaluations. The setting ``noise`` determines which candidates get the extra
evaluations, and how personal bests are scored:

* ``fixed``, as in the paper: the best 20 % of the particles get them. A personal best keeps the score that it had when
  it became a personal best, so that the luckiest candidate wins.
* ``as-ran``, as in the paper's program: like ``fixed``, but velocities are 0 at first, the first move has the full
  inertia w = 1.0, all particles share the runs of an iteration (``shared_run``), and runs that crash are dropped.
* ``rescore`` (default): the best of the particles and the personal bests together get them, as many candidates as with
  ``fixed``. Every score uses all evaluations of its candidate so far.

With ``rescore``, scores are corrected for small-sample bias, and candidates are compared by the score plus
``caution`` standard errors.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Final, Literal

import numpy as np
from pydantic import Field

from vibroswarm.core.frozen_model import FrozenModel
from vibroswarm.search.methods import Archive, Ask, Iteration, Method, chance, iteration_of, register
from vibroswarm.search.space import Point

if TYPE_CHECKING:
    from vibroswarm.search.spec import Search

FIRST_REEVALUATION: Final = 2
"""Number from which ``shared_run`` counts the evaluations of a candidate. It follows from the 265 distinct run numbers
of the paper's study: of ten numbers in a row only 2 to 11, times iterations 1 to 50, give 265 distinct products."""

KEEPING: Final = ("fixed", "as-ran")
"""Values of ``noise`` with which a personal best keeps the score with which it became one, as in the paper."""


def shared_run(evaluation: int, iteration: int) -> int:
    """Return the run number of an evaluation as in the paper's program: (evaluation + 2) (iteration + 1), both from 0.

    The number does not depend on the particle, so that all particles of an iteration share their runs. Different pairs
    often have the same number.
    """
    return (evaluation + FIRST_REEVALUATION) * (iteration + 1)


Count = Annotated[int, Field(ge=1)]
Number = Annotated[float, Field(ge=0, le=1000)]


class PsoSettings(FrozenModel):
    """The swarm's settings; defaults are the paper's except for ``noise``."""

    particles: Count = 25
    iterations: Count = 50
    evaluations: Count = 10
    """Runs of each particle in each iteration."""
    extra: Annotated[int, Field(ge=0)] = 10
    """Extra runs of each candidate that gets any."""
    extra_share: Annotated[float, Field(ge=0, le=1)] = 0.2
    """Number of candidates that get extra runs, the best ones, as a share of the number of particles."""
    inertia_first: Number = 1.0
    """Inertia omega in the first iteration; it falls linearly."""
    inertia_last: Number = 0.4
    weight_personal: Number = 0.75
    """Weight omega_p of the attraction to the personal best."""
    weight_global: Number = 0.75
    """Weight omega_g of the attraction to the global best."""
    first_velocity: Number = 0.1
    """Initial velocities in the unit cube are uniform between minus and plus this number (``as-ran``: 0)."""
    noise: Literal["rescore", "fixed", "as-ran"] = "rescore"
    """``rescore``, ``fixed`` (the paper) or ``as-ran`` (its program), see the head of this module."""
    caution: Number = 1.0
    """With ``rescore``: candidates are compared by score plus this number of standard errors."""
    crash_share: Annotated[float, Field(ge=0, le=0.9)] = 0.0
    """With ``as-ran``: share of runs, chosen at random, that count as crashed; in the paper's study a tenth did."""

    @property
    def best_of(self) -> int:
        """Number of candidates with extra evaluations in one iteration."""
        # Less rounding: a product such as 0.2 x 25 may come out a little above 5.
        return math.ceil(self.extra_share * self.particles - 1e-9)

    @property
    def runs_an_iteration(self) -> int:
        """Runs in one iteration."""
        return self.particles * self.evaluations + self.best_of * self.extra


class Pso:
    """The swarm, with positions in the unit cube. An iteration requests evaluations, then extra ones if any."""

    name = "pso"

    def __init__(
        self,
        archive: Archive,
        seed: int,
        settings: PsoSettings,
        starts: Sequence[Point] = (),
    ) -> None:
        self.archive, self.seed, self.settings = archive, seed, settings
        self.iterations, self.iteration = settings.iterations, 0
        self.falls_over = settings.iterations
        """Number of iterations over which the inertia falls."""
        self.extras = False
        """Whether the first evaluations of this iteration are done, so that the extra ones are requested next."""
        self.history: list[Iteration] = []
        shape = (settings.particles, len(archive.space.names))
        random = chance(seed, "pso begins")
        self.position = random.random(shape)
        span = 0.0 if settings.noise == "as-ran" else settings.first_velocity
        self.velocity = span * (2.0 * random.random(shape) - 1.0)
        for k, start in enumerate(starts):
            self.position[k] = start
        self.current: list[int] = []
        """Keys of the candidates of this iteration, one per particle."""
        self.personal: list[int] = []
        """Keys of the personal bests, one per particle; empty before the end of the first iteration."""
        self.kept = np.full(settings.particles, math.inf)
        """Score of each personal best at the time at which it became one; read only with a ``noise`` of ``KEEPING``."""

    def ask(self) -> list[Ask]:
        """Request runs: of an iteration the first evaluations, then the extra ones; none after the last iteration."""
        if self.iteration == self.iterations:
            return []
        if not self.extras:
            origin = f"pso {self.iteration + 1}"
            self.current = [self.archive.new(point, origin, self.iteration) for point in self.position]
            return [Ask(key, self.settings.evaluations) for key in self.current]
        return self._extra_asks()

    def tell(self) -> None:
        """Finish an iteration, if no extra evaluations are due: update the personal bests, and move the particles."""
        if not self.extras and self.settings.best_of * self.settings.extra:
            self.extras = True
            return
        self.extras = False
        self._update_bests()
        self.iteration += 1
        personal = self._personal_scores()
        self.history.append(
            iteration_of(
                self.archive,
                self.iteration,
                self.current,
                best=(self.best(), float(personal.min())),
                points=self.position,
                personal=personal,
            )
        )
        if self.iteration < self.iterations:
            self._move()

    def best(self) -> int:
        """Return the key of the candidate that is the global best; of equals, that of the first particle."""
        return self.personal[int(np.argmin(self._personal_scores()))]

    def finalists(self, count: int) -> list[int]:
        """Return the keys of up to ``count`` distinct personal bests, the best first."""
        order = np.argsort(self._personal_scores(), kind="stable")
        return list(dict.fromkeys(self.personal[k] for k in order))[:count]

    def _extra_asks(self) -> list[Ask]:
        if self.settings.noise in KEEPING:
            ranked = sorted(self.current, key=lambda k: (self.archive.score(k), k))
        else:
            candidates = {*self.personal, *self.current}
            ranked = sorted(candidates, key=lambda k: (self.archive.estimate(k)[0], k))
        return [Ask(key, self.settings.extra) for key in ranked[: self.settings.best_of]]

    def _update_bests(self) -> None:
        """Replace the personal best of each particle whose current candidate has a lower score."""
        scores = np.array([self._score(key) for key in self.current])
        if not self.personal:  # the first iteration
            self.personal, self.kept = list(self.current), scores
            return
        for particle in np.flatnonzero(scores < self._personal_scores()):
            self.personal[particle], self.kept[particle] = self.current[particle], scores[particle]

    def _score(self, key: int) -> float:
        """Return the score by which candidates are compared."""
        if self.settings.noise in KEEPING:
            return self.archive.score(key)
        return self.archive.cautious(key, self.settings.caution)

    def _personal_scores(self) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """Return the scores of the personal bests, from all their runs so far unless kept."""
        if self.settings.noise in KEEPING:
            return self.kept
        return np.array([self._score(key) for key in self.personal])

    def _move(self) -> None:
        """Move all particles by the velocity update of the paper, with positions clipped to the unit cube."""
        settings = self.settings
        # The inertia falls linearly from iteration to iteration. The first move follows iteration 1: in the paper's
        # program this move has the full inertia, otherwise the inertia has fallen by one step by then.
        elapsed = self.iteration - 1 if settings.noise == "as-ran" else self.iteration
        fraction = min(elapsed / max(self.falls_over - 1, 1), 1.0)
        inertia = settings.inertia_first + fraction * (settings.inertia_last - settings.inertia_first)
        r_1, r_2 = chance(self.seed, f"pso {self.iteration + 1}").random(
            (2, *self.position.shape)
        )  # R_1, R_2
        to_personal = np.array([self.archive[key].point for key in self.personal]) - self.position
        to_global = self.archive[self.best()].point - self.position
        self.velocity = (  # Eq. 21a
            inertia * self.velocity
            + settings.weight_personal * r_1 * to_personal
            + settings.weight_global * r_2 * to_global
        )
        self.position = np.clip(self.position + self.velocity, 0.0, 1.0)  # Eq. 21b


def _begin(archive: Archive, search: Search) -> Pso:
    settings = search.pso.model_copy(update={"iterations": search.pso_iterations})
    return Pso(archive, search.study.seed, settings, search.starts)


PSO = register(Method("pso", _begin))
