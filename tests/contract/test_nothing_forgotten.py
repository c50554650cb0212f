"""No field can be forgotten: each changes the hash and keeps cells apart; motion is shared only where it may be."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

import pytest
from pydantic import Field

from helpers.scenario_fields import before, changed, chosen
from vibroswarm import networks, strategies, tasks
from vibroswarm.localisation.locate import estimates_key
from vibroswarm.scenario.disturbance_fields import MotionFaults
from vibroswarm.scenario.scenario import Scenario, field_types, value_of
from vibroswarm.search.evaluate import Piece
from vibroswarm.simulation import OF_MOTION
from vibroswarm.strategies import Strategy, none
from vibroswarm.study.runs import groups_of
from vibroswarm.study.spec import Study
from vibroswarm.study.store import key_of

NAMES = field_types()


class Params:
    """Of a strategy that is made known here and nowhere else."""

    first: Annotated[float, Field(ge=0, le=10)] = 1.0
    second: Annotated[int, Field(ge=0, le=10)] = 2


@pytest.fixture(scope="module", autouse=True)
def one_more() -> Iterator[None]:
    shown = none.none
    strategies.register(
        Strategy(
            "probe",
            state=shown.state,
            begin=shown.begin,
            on_counts=shown.on_counts,
            on_sample=shown.on_sample,
            decision=shown.decision,
            params=Params,
        )
    )
    tasks.register(tasks.Task("probe", truth=lambda floor, asked, p: 1, params=Params))
    tasks.register(tasks.Task("another_task", truth=lambda floor, asked, p: 1))
    yield
    strategies.base.forget("probe")
    tasks.base.forget("probe")
    tasks.base.forget("another_task")


def pair(name: str) -> tuple[Scenario, Scenario]:
    """Two scenarios that differ in a field alone."""
    if name in NAMES:
        return before(name), changed(name)
    kind, entry, _ = name.split(".")  # a parameter of what is registered here
    base = Scenario().with_values(chosen(kind, entry))
    value = value_of(base, name)
    return base, base.with_values({name: value + 1 if field_types()[name] is int else value * 0.5 + 0.25})


def shared(one: Scenario, other: Scenario, name: str) -> tuple[int, int]:
    """Motions and replays of a study of two cells."""
    values = [value_of(one, name), value_of(other, name)]
    study = Study(one.model_dump(exclude_none=True), {"grid": {name: values}}, runs=1)
    assert [cell.scenario.hash for cell in study.cells] == [one.hash, other.hash]
    return len(groups_of(study.cells)), len({key_of(cell.scenario) for cell in study.cells})


PROBED = [*NAMES, "strategy.probe.first", "strategy.probe.second", "task.probe.second"]


@pytest.mark.parametrize("section", {name.partition(".")[0]: None for name in PROBED})
def test_each_field_changes_hash_and_plan(section: str) -> None:
    for name in PROBED:
        if name.startswith(f"{section}."):
            check_hash_and_plan(name)


def check_hash_and_plan(name: str) -> None:
    one, other = pair(name)
    assert one.hash != other.hash, name
    assert one.to_toml() != other.to_toml(), f"{name}: what a worker is given, and what is kept by its text"
    pieces = {Piece("", "", (0,), 1, "event", (each.to_toml(),), ()) for each in (one, other)}
    assert len(pieces) == 2, name
    if value_of(one, name) is None:  # it cannot be said in a grid
        return
    motions, replays = shared(one, other, name)
    assert replays == 2, f"{name}: cells that differ were merged"
    section, _, field = name.partition(".")
    moves = section in OF_MOTION
    moves |= section == "rays" and field != "noise_m"
    moves |= section == "faults" and field in MotionFaults.model_fields
    moves |= name.startswith("strategy.explore.")  # which steers
    assert motions == (2 if moves else 1), name
    if not moves and section in ("odometry", "localisation", "rays"):
        assert estimates_key(one, 1) != estimates_key(other, 1), (
            f"{name}: estimates of places are shared on one motion"
        )


def test_all_parameters_of_all_that_is_known_are_among_the_fields() -> None:
    for kind, room in (("strategy", strategies), ("network", networks), ("task", tasks)):
        for name, one in room.known().items():
            for field in one.params.model_fields:
                assert f"{kind}.{name}.{field}" in field_types()


def test_a_table_that_is_not_chosen_changes_nothing() -> None:
    one, other = Scenario(), Scenario().with_values({"strategy.soft.eta": 3.0})
    assert one.hash == other.hash
    assert shared(one, other, "strategy.soft.eta") == (1, 1)
    assert other.with_values({"strategy.name": "soft"}).strategy.params.eta == 3.0, "it is kept"


def test_cells_that_end_when_all_have_decided_move_by_themselves() -> None:
    early = Scenario().with_values({"run.stop": "all_decided"})
    other = early.with_values({"decision.credible_threshold": 0.9})
    assert shared(early, other, "decision.credible_threshold") == (2, 2)


def test_a_key_that_leaves_a_field_out_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Negative control."""
    right = Scenario.hash.fget  # type: ignore[attr-defined]

    def forgetful(scenario: Scenario) -> str:
        return str(right(scenario.with_values({"strategy.probe.second": 2})))

    one, other = pair("strategy.probe.second")
    monkeypatch.setattr(Scenario, "hash", property(forgetful))
    assert one.hash == other.hash
    assert shared(one, other, "strategy.probe.second") == (1, 1)
