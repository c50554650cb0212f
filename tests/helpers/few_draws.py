"""Inspections that draw few surfaces."""

from __future__ import annotations

import pytest


@pytest.fixture
def few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth of the surfaces are drawn for what would have been missed: for tests that look at no such share.

    The weakest contrast that is found is sought on one area: each takes as long as all that is left of the surfaces.
    """
    from vibroswarm.inspection import missed, pod, stopping  # which take long to import

    for function, drawn in (
        (stopping.stopping, {"drawn": stopping.DRAWN // 10}),
        (missed.false_calls, {"intact": pod.INTACT // 10}),
        (missed.own_trials, {"each": missed.EACH // 10}),
    ):
        for name, number in drawn.items():
            assert name in function.__kwdefaults__
            monkeypatch.setitem(function.__kwdefaults__, name, number)
    monkeypatch.setattr(stopping, "AT_WORST", stopping.AT_WORST // 10)
    monkeypatch.setattr(stopping, "OF_ROBOTS", stopping.OF_ROBOTS // 10)
    monkeypatch.setattr(missed, "EACH", missed.EACH // 10)
    monkeypatch.setattr(missed, "WEAKEST_M", missed.WEAKEST_M[:1])
