"""What tests of several kinds share."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from hypothesis import settings

from vibroswarm.page.record import RunRecord

# In CI the same examples every time, so that a red run can be made again; elsewhere new ones.
settings.register_profile("ci", derandomize=True, print_blob=True)
if os.environ.get("CI") == "true":
    settings.load_profile("ci")


@cache
def _beside(name: str) -> ModuleType:
    """A module beside this one; tests are not a package that could be imported by name."""
    path = Path(__file__).with_name(f"{name}.py")
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def make_record() -> Callable[..., RunRecord]:
    """Makes a made-up run for the page (``page_records.make_record``)."""
    made: Callable[..., RunRecord] = _beside("page_records").make_record
    return made


@pytest.fixture(scope="session")
def dask_cluster() -> Callable[..., AbstractContextManager[Any]]:
    """Starts a Dask cluster (``dask_cluster.Cluster``): folder, number of workers."""
    made: Callable[..., AbstractContextManager[Any]] = _beside("dask_cluster").Cluster
    return made


@pytest.fixture(scope="session")
def record(make_record: Callable[..., RunRecord]) -> RunRecord:
    """Five robots, 240 s, half of the bits lost: three decide, two do not."""
    made = make_record(seed=13, heard=0.5, min_observations=30)
    assert made.robots["decision"].to_list() == [-1, 0, 0, -1, 0]
    return made


@pytest.fixture(scope="session")
def long_record(make_record: Callable[..., RunRecord]) -> RunRecord:
    """Ten robots, 1200 s: the largest run that the page's limits are given for."""
    return make_record(robots=10, t_end_s=1200.0, title="Ten robots, twenty minutes", min_observations=1500)


@pytest.fixture(scope="session")
def functions() -> ModuleType:
    """Functions with a known optimum for methods of optimisation (``search_functions``)."""
    return _beside("search_functions")


@pytest.fixture(autouse=True)
def nothing_of_others_stays() -> Iterator[None]:
    """What a test makes known, of strategies, networks, tasks and sources of motion, is unknown again after it."""
    from vibroswarm.motion import contract
    from vibroswarm.networks import base as networks
    from vibroswarm.strategies import base as strategies
    from vibroswarm.tasks import base as tasks

    before = {room: set(room.known()) for room in (strategies, networks, tasks, contract)}
    yield
    for room, names in before.items():
        for name in set(room.known()) - names:
            room.forget(name)
