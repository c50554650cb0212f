"""What several threads ask for at once is made once, and is whole when any of them gets it."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Barrier
from types import SimpleNamespace
from typing import TypeVar

import pytest

from vibroswarm.cli.terminal import say
from vibroswarm.errors import warn_once
from vibroswarm.inference.generated_kernels import kernels
from vibroswarm.networks import network
from vibroswarm.scenario.plugins import install
from vibroswarm.scenario.scenario import preset
from vibroswarm.strategies import strategy
from vibroswarm.strategies.base import forget

T = TypeVar("T")
THREADS = 4
TIMES = 40
"""How often each is tried, since a race is a matter of luck: without the locks, a tenth of the tries or more failed."""


@pytest.fixture(autouse=True)
def _switch_often() -> Iterator[None]:
    interval_s = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(interval_s)


def at_once(ask: Callable[[], T]) -> list[T]:
    """Call a function in several threads at the same time; return what each got."""
    ready = Barrier(THREADS)

    def one() -> T:
        ready.wait(60.0)
        return ask()

    with ThreadPoolExecutor(THREADS) as threads:
        return [each.result(60.0) for each in [threads.submit(one) for _ in range(THREADS)]]


def test_a_warning_is_given_once(caplog: pytest.LogCaptureFixture) -> None:
    for number in range(TIMES):
        at_once(lambda number=number: warn_once(f"warning {number} of several threads"))
    assert len(caplog.messages) == TIMES


def test_a_line_on_stderr_is_written_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its end, written by itself, came after the line of another thread that began to compile a kernel."""
    written: list[str] = []
    monkeypatch.setattr(sys, "stderr", SimpleNamespace(write=written.append, flush=lambda: None))
    say("one line")
    assert [text for text in written if text] == ["one line\n"]


FILE = """
from dataclasses import replace
from vibroswarm.strategies import strategy
fresh_{0} = replace(strategy("none"), name="fresh_{0}")
"""


def test_a_users_file_is_executed_once() -> None:
    """A worker of Dask with several threads: one found the file's module empty, and the study ended."""
    for number in range(TIMES):
        text = FILE.format(number)
        code = f"fresh.py:fresh_{number} sha256:{hashlib.sha256(text.encode()).hexdigest()}"
        found = at_once(lambda code=code, text=text: install("strategy", code, text))
        forget(f"fresh_{number}")
        assert len({id(each) for each in found}) == 1


def test_there_is_one_variant_of_a_strategy() -> None:
    places = strategy("places")
    options = preset("paper").with_values({"strategy.name": "places", "strategy.places.share_map": True})
    for tiles in range(100, 100 + TIMES):
        sizes = {"tiles": tiles, "longest_mm": 1000}
        found = at_once(lambda sizes=sizes: places.variant(options.strategy.params, sizes))
        assert len({id(each) for each in found}) == 1


def test_kernels_of_a_strategy_are_generated_once() -> None:
    """Without a lock one thread imported the module that another had registered, and not filled yet."""
    for number in range(5):
        own = replace(strategy("none"), name=f"own_{number}")
        found = at_once(lambda own=own: kernels(own, network("ideal"), "replay_counts"))
        assert len({id(each) for each in found}) == 1
