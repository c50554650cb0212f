"""One sample of a robot's mind: observe, update, test, compose (Algorithm 1; the order within a sample).

| name | symbol | unit | equation |
|---|---|---|---|
| decision | d_f | - | 0 if p > p_c, 1 if 1 - p > p_c, and -1 while undecided (Eq. 10) |
| min_observations | O_c | - | a robot may decide only with strictly more than O_c counted observations |
"""

from __future__ import annotations

from typing import Final, NamedTuple

from vibroswarm.compiled import kernel
from vibroswarm.robot.believe import Posterior, observe_all, prior
from vibroswarm.strategies import none, positive, soft

NONE: Final = 0
POSITIVE: Final = 1
SOFT: Final = 2
STRATEGIES: Final = ("none", "positive", "soft")

GATE_TOTAL: Final = 0
GATE_RECEIVED: Final = 1
GATE_OWN: Final = 2
GATES: Final = ("total", "received", "own")


class MindProgram(NamedTuple):
    """The parameters of deciding and saying."""

    strategy: int
    eta: float
    kappa: float
    boundary: float
    credible_threshold: float
    min_observations: int
    gate: int
    gate_counts_current: bool
    revise: bool
    prior_alpha: int
    prior_beta: int


class Mind(NamedTuple):
    """What a robot knows and has decided."""

    posterior: Posterior
    decision: int
    own: int
    received: int
    message: int
    """The last bit it composed."""
    ones: int = 0
    zeros: int = 0
    """Received since the own sample of the posterior: a belief is needed only at own samples."""


@kernel
def begin_mind(program: MindProgram) -> Mind:
    """The prior, undecided."""
    return Mind(prior(program.prior_alpha, program.prior_beta, program.boundary), -1, 0, 0, 0, 0, 0)


@kernel
def receive(mind: Mind, ones: int, zeros: int) -> Mind:
    """Bits from other robots; they go into the posterior at the next own sample, like own ones (Eq. 8)."""
    received = mind.received + ones + zeros
    return Mind(
        mind.posterior, mind.decision, mind.own, received, mind.message, mind.ones + ones, mind.zeros + zeros
    )


@kernel
def counted(mind: Mind, program: MindProgram) -> int:
    """Observations counted against O_c, when the current own sample is already in ``mind``."""
    own = mind.own if program.gate_counts_current else mind.own - 1
    if program.gate == GATE_TOTAL:
        return own + mind.received
    return own if program.gate == GATE_OWN else mind.received


@kernel
def decide(belief: float, program: MindProgram) -> int:
    """d_f by Eq. 10, strictly."""
    if belief > program.credible_threshold:
        return 0
    if 1.0 - belief > program.credible_threshold:
        return 1
    return -1


@kernel
def sample(mind: Mind, observation: int, u: float, program: MindProgram) -> Mind:
    """Update with all that was heard and observed, test, compose from the posterior with the own sample in it."""
    ones, zeros = mind.ones + observation, mind.zeros + 1 - observation
    posterior = observe_all(mind.posterior, ones, zeros, program.boundary)
    mind = Mind(posterior, mind.decision, mind.own + 1, mind.received, mind.message, 0, 0)
    decision = mind.decision
    may_revise = program.revise and program.strategy == SOFT
    if (decision == -1 or may_revise) and counted(mind, program) > program.min_observations:
        new = decide(posterior.belief, program)
        decision = new if new != -1 else decision
    if program.strategy == SOFT:
        bit = soft.message(
            observation, posterior.alpha, posterior.beta, posterior.belief, program.eta, program.kappa, u
        )
    elif program.strategy == POSITIVE:
        bit = positive.message(observation, decision)
    else:
        bit = none.message(observation)
    return Mind(posterior, decision, mind.own, mind.received, bit, 0, 0)
