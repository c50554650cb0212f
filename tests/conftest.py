"""What tests of several kinds share; ``helpers`` has the parts that they import by name."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest
from hypothesis import settings

from helpers.page_records import make_record
from vibroswarm.run_page.payload import RunRecord

pytest_plugins = ["helpers.recordings", "helpers.browser"]

# In CI the same examples every time, so that a red run can be made again; elsewhere new ones.
settings.register_profile("ci", derandomize=True, print_blob=True)
if os.environ.get("CI") == "true":
    settings.load_profile("ci")


@pytest.fixture(scope="session")
def record() -> RunRecord:
    """Five robots, 240 s, half of the bits lost: three decide, two do not."""
    made = make_record(seed=13, heard=0.5, min_observations=30)
    assert made.robots["decision"].to_list() == [-1, 0, 0, -1, 0]
    return made


@pytest.fixture(scope="session")
def long_record() -> RunRecord:
    """Ten robots, 1200 s: the largest run that the page's limits are given for."""
    return make_record(robots=10, t_end_s=1200.0, title="Ten robots, twenty minutes", min_observations=1500)


@pytest.fixture(autouse=True)
def nothing_of_others_stays() -> Iterator[None]:
    """What a test makes known, of strategies, networks, tasks and sources of motion, is unknown again after it."""
    from vibroswarm.motion import source
    from vibroswarm.networks import base as networks
    from vibroswarm.strategies import base as strategies
    from vibroswarm.tasks import base as tasks

    before = {room: set(room.known()) for room in (strategies, networks, tasks, source)}
    yield
    for room, names in before.items():
        for name in set(room.known()) - names:
            room.forget(name)
