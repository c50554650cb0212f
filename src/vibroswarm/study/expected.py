"""How long a study will take: a few runs are tried, the rest is multiplication."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import Final, NamedTuple

from vibroswarm.errors import CodeError
from vibroswarm.study.plan import Group, Plan
from vibroswarm.study.precision import FIRST_LOOK
from vibroswarm.study.store import Store
from vibroswarm.study.work import do, work_of

TRIED_GROUPS: Final = 3
FEW: Final = 2
MORE: Final = 22
"""Trial batches of two sizes tell what a batch costs from what a run costs."""
LONG_S: Final = 1.0
"""Where a few runs take longer than this, nothing else matters, and no more are tried."""


class Expected(NamedTuple):
    """Work that is left: runs of motion, and seconds of one core, from so many trial runs."""

    runs: int
    core_s: float
    tried: int


def expected(store: Store, plan: Plan) -> Expected:
    """What is left to do of a study with a number of runs; of one with a precision, of its first look."""
    runs = plan.study.runs or FIRST_LOOK
    left = {group.number: store.missing(group, runs) for group in plan.groups}
    chosen = [group for group in plan.groups if left[group.number]]
    if not chosen:
        return Expected(0, 0.0, 0)
    count = {number: sum(last - first for _, first, last in blocks) for number, blocks in left.items()}
    tried = chosen[:: max(len(chosen) // TRIED_GROUPS, 1)][:TRIED_GROUPS]
    a_run, a_batch, count_tried = 0.0, 0.0, 0
    for group in tried:
        _time_s(plan, group, FEW)  # tables and kernels are loaded
        few_s = _time_s(plan, group, FEW)
        long = few_s > LONG_S
        count_tried += 2 * FEW + (0 if long else MORE)
        slope = few_s / FEW if long else max(_time_s(plan, group, MORE) - few_s, 0.0) / (MORE - FEW)
        a_run += slope / group.run_s / len(tried)
        a_batch += max(few_s - FEW * slope, 0.0) / group.inferences / len(tried)
    core_s = sum(
        a_run * count[group.number] * group.run_s + a_batch * len(left[group.number]) * group.inferences
        for group in chosen
    )
    return Expected(sum(count.values()), core_s, count_tried)


def _time_s(plan: Plan, group: Group, runs: int) -> float:
    before_s = time.process_time()  # not of the clock: others may be at work here
    with suppress(CodeError):  # the study will say so, and go on
        do(work_of(plan.study, group, 0, runs))
    return time.process_time() - before_s
