"""Items that need no cells are computed beside them: to the same numbers, and neither side outlives the other."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest

from vibroswarm.errors import InputError
from vibroswarm.paper.item import Item, Settings, Tables, Work
from vibroswarm.paper.items import items_named
from vibroswarm.paper.reproduce import ITEMS, Bar, Cancelled, Check, background, reproduce

LONG_S = 20.0


def until(check: Check) -> None:
    """Go on until a check ends it; fail where none does."""
    end_s = time.monotonic() + LONG_S
    while time.monotonic() < end_s:
        check()
        time.sleep(0.001)
    raise AssertionError("nobody ended it")


def test_leaving_waits_for_what_goes_on_beside() -> None:
    done = []

    def work(check: Check) -> None:
        time.sleep(0.05)
        check()
        done.append(threading.current_thread())

    with background(work):
        assert done == []
    assert done != [threading.main_thread()]
    with background(None) as check:
        check()


def test_what_is_raised_beside_ends_the_main_thread() -> None:
    def work(check: Check) -> None:
        raise InputError("is wrong", field="x")

    with pytest.raises(InputError, match="is wrong"), background(work) as check:
        until(check)
    with pytest.raises(InputError, match="is wrong"), background(work):
        pass


def test_what_is_raised_in_the_main_thread_ends_the_other() -> None:
    ended = []

    def work(check: Check) -> None:
        try:
            until(check)
        except Cancelled:
            ended.append(True)
            raise

    with pytest.raises(KeyboardInterrupt), background(work):
        raise KeyboardInterrupt
    assert ended == [True]


def test_the_bar_never_goes_back() -> None:
    told: list[tuple[str, float]] = []
    bar = Bar(lambda what, share: told.append((what, share)), {"a": 3.0, "b": 1.0})
    bar.update("a", 0.5)
    bar.shown = "a"
    bar.update("b", 1.0)
    bar.update("a", 0.25)
    bar.update("a", 1.0)
    assert told == [("a", 0.375), ("a", 0.625), ("a", 0.625), ("a", 1.0)]


NAMES = ["difficulty", "fill-ratios", "example-run"]


def test_tables_do_not_depend_on_what_runs_beside(tmp_path: Path) -> None:
    threads: dict[int, set[str]] = {1: set(), 2: set()}
    made = {}

    def watched(item: Item, seen: set[str]) -> Item:
        def compute(work: Work) -> Tables:
            seen.add(threading.current_thread().name)
            return item.compute(work)

        return replace(item, compute=compute)

    for workers, seen in threads.items():
        settings = Settings(runs=4, columns=("paper",), workers=workers)
        items = [watched(item, seen) for item in items_named(NAMES)]
        made[workers] = reproduce(settings, tmp_path / str(workers), items)
    assert threads[1] == {threading.main_thread().name}
    assert threads[2] == {threading.main_thread().name, "vibroswarm-background"}
    for one, two in zip(made[1].made, made[2].made, strict=True):
        assert list(one.tables) == list(two.tables)
        for name, table in one.tables.items():
            assert table.equals(two.tables[name]), (one.item.name, name)


def test_an_item_that_fails_beside_the_cells_ends_all(tmp_path: Path) -> None:
    def broken(work: Work) -> Tables:
        raise InputError("no such file", field="recordings")

    difficulty, ratios = items_named(["difficulty", "fill-ratios"])
    settings = Settings(runs=4, columns=("paper",), workers=2)
    with pytest.raises(InputError, match="no such file"):
        reproduce(settings, tmp_path, [replace(difficulty, compute=broken), ratios])
    assert not (tmp_path / ITEMS / "difficulty").exists()
    made = reproduce(settings, tmp_path, [difficulty, ratios])
    assert all(one.tables for one in made.made)
