"""One sample of a robot's mind: observe, update, test, compose (Algorithm 1; the order within a sample).

| name | symbol | unit | equation |
|---|---|---|---|
| decision | d_f | - | 0 if p > p_c, 1 if 1 - p > p_c, and -1 while undecided (Eq. 10) |
| min_observations | O_c | - | a robot may decide only with strictly more than O_c counted observations |
"""

from __future__ import annotations

from typing import Final, NamedTuple

from vibroswarm.compiled import inner, kernel
from vibroswarm.robot.believe import belief_below
from vibroswarm.strategies import soft

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

    alpha: int
    beta: int
    decision: int
    own: int
    received: int
    message: int
    """The last bit it composed."""


@kernel
def begin_mind(program: MindProgram) -> Mind:
    """The prior, undecided."""
    return Mind(program.prior_alpha, program.prior_beta, -1, 0, 0, 0)


@inner
def receive(mind: Mind, ones: int, zeros: int) -> Mind:
    """Bits from other robots: into the posterior like own ones (Eq. 8)."""
    alpha, beta, decision, own, received, message = mind
    return Mind(alpha + ones, beta + zeros, decision, own, received + ones + zeros, message)


@inner
def observe(mind: Mind, observation: int) -> Mind:
    """An own reading: into the posterior (Eq. 7)."""
    alpha, beta, decision, own, received, message = mind
    return Mind(alpha + observation, beta + 1 - observation, decision, own + 1, received, message)


@inner
def counted(mind: Mind, program: MindProgram) -> int:
    """Observations counted against O_c, when the current own sample is already in ``mind``."""
    own = mind.own if program.gate_counts_current else mind.own - 1
    if program.gate == GATE_TOTAL:
        return own + mind.received
    return own if program.gate == GATE_OWN else mind.received


@inner
def may_decide(mind: Mind, program: MindProgram) -> bool:
    """Whether the belief is tested, when the current own sample is already in ``mind``."""
    open_to_test = mind.decision == -1 or (program.revise and program.strategy == SOFT)
    return open_to_test and counted(mind, program) > program.min_observations


@inner
def needs_belief(mind: Mind, program: MindProgram) -> bool:
    """Whether what the robot decides or says depends on its belief at all."""
    return program.strategy == SOFT or may_decide(mind, program)


@inner
def decide(belief: float, program: MindProgram) -> int:
    """d_f by Eq. 10, strictly."""
    if belief > program.credible_threshold:
        return 0
    if 1.0 - belief > program.credible_threshold:
        return 1
    return -1


@inner
def conclude(mind: Mind, belief: float, observation: int, u: float, program: MindProgram) -> Mind:
    """Test, and compose from the posterior with the own sample in it; ``belief`` is that of ``mind``."""
    alpha, beta, decision, own, received, _ = mind
    if may_decide(mind, program):
        new = decide(belief, program)
        decision = new if new != -1 else decision
    if program.strategy == SOFT:
        bit = soft.message(observation, alpha, beta, belief, program.eta, program.kappa, u)
    elif program.strategy == POSITIVE:
        bit = decision if decision != -1 else observation
    else:
        bit = observation
    return Mind(alpha, beta, decision, own, received, bit)


@kernel
def sample(mind: Mind, observation: int, u: float, program: MindProgram) -> Mind:
    """One sample, whole: observe, update, test, compose."""
    seen = observe(mind, observation)
    belief = belief_below(seen.alpha, seen.beta, program.boundary)
    return conclude(seen, belief, observation, u, program)
