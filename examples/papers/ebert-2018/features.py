"""Three binary features of each tile, one of which a robot reads at a time: Ebert, Gauci and Nagpal (AAMAS 2018).

Bit f of a tile's kind says whether it has feature f. A robot counts readings of each feature, own and heard, and locks
the decision on a feature once it is sure of it; then it may go on to another.
"""

from typing import Annotated

from pydantic import Field

from vibroswarm.strategies import array, belief_below, strategy_in
from vibroswarm.tasks import Task

FEATURES = 3


def truth(floor, asked, p):
    answer = 0
    for feature in range(FEATURES):
        having = [kind for kind in range(2**FEATURES) if kind >> feature & 1]
        share = sum(floor.share_within(kind, asked.width_m, asked.height_m) for kind in having)
        if abs(share - 0.5) < 1e-12:
            return None
        answer += (share > 0.5) << feature
    return answer


def words(answer):
    return ", ".join("more" if answer >> feature & 1 else "less" for feature in range(FEATURES))


features = Task(name="features", truth=truth, answers=tuple(words(answer) for answer in range(2**FEATURES)))


class Params:
    all_on_first: bool = False  # else robots are spread over the features
    switches: bool = True  # whether a robot that has locked its feature takes another
    least: Annotated[int, Field(ge=1, le=10**6)] = 100  # readings of a feature, own and heard, to lock it


class State:
    feature: int
    locked: int
    decision: int


class Arrays:
    ones = array("int64", "3")
    zeros = array("int64", "3")
    answer = array("int64", "3")


class Message:
    feature: int
    bit: int


def begin(s, a, d, p, w):
    s.feature = 0 if p.all_on_first else w.robot % FEATURES
    s.decision = -1
    for feature in range(FEATURES):
        a.ones[feature] = a.zeros[feature] = 1
        a.answer[feature] = -1


def on_message(s, a, m, sender, t_s, d, p, w):
    a.ones[m.feature] += m.bit
    a.zeros[m.feature] += 1 - m.bit


def on_sample(s, a, x, out, d, p, w):
    out.feature, out.bit = s.feature, (x.reading >> s.feature) & 1
    a.ones[s.feature] += out.bit
    a.zeros[s.feature] += 1 - out.bit
    lock(s, a, p, w)
    if p.switches and a.answer[s.feature] >= 0:
        s.feature = next_feature(s, a)
    return True


def lock(s, a, p, w):
    for feature in range(FEATURES):
        enough = a.ones[feature] + a.zeros[feature] - 2 >= p.least
        if a.answer[feature] < 0 and enough:
            below = belief_below(a.ones[feature], a.zeros[feature], w)
            if max(below, 1.0 - below) > w.credible_threshold:
                a.answer[feature] = 0 if below > 0.5 else 1
                s.locked += 1
    if s.decision < 0 and s.locked == FEATURES:
        s.decision = a.answer[0] + 2 * a.answer[1] + 4 * a.answer[2]


def next_feature(s, a):
    best = s.feature
    for feature in range(FEATURES):
        if a.answer[feature] < 0 and (
            a.answer[best] >= 0 or a.ones[feature] + a.zeros[feature] < a.ones[best] + a.zeros[best]
        ):
            best = feature
    return best


def decision(s, a, p, w):
    return s.decision


allocated = strategy_in(
    __name__,
    "allocated",
    answers_kinds=True,
    reports=("feature", "locked"),
    about="decides on three features, one after the other",
)
