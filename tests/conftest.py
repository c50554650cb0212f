"""What tests of several kinds share; ``helpers`` has the parts that they import by name."""

from __future__ import annotations

import helpers.common_instructions  # noqa: F401  # isort: skip - before NumPy

import gc
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import polars as pl
import pytest
from hypothesis import settings
from matplotlib.figure import Figure

from vibroswarm.core.jit import is_cached

pytest_plugins = [
    "helpers.numba_programs",
    "helpers.recordings",
    "helpers.browser",
]

# The settings of whoever runs the tests change nothing.
os.environ.pop("FORCE_COLOR", None)

# A tenth of the time went into looking for garbage among the libraries and tests that are loaded: Python looks less
# often, and from the first test on not at these.
gc.set_threshold(50_000, 20, 20)


def pytest_collection_finish() -> None:
    gc.freeze()


def pytest_itemcollected(item: pytest.Item) -> None:
    """Leave statistics and browsers to ``make test-slow``."""
    if "statistical" in item.path.parts or "browser" in getattr(item, "fixturenames", ()):
        item.add_marker("slow")


@pytest.hookimpl(trylast=True)  # when those are left out that are not asked for
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Begin the share of each worker with long tests, so that none is left alone with one at the end."""
    workers = getattr(config, "workerinput", {"workercount": 1})["workercount"]
    long = [item for item in items if item.get_closest_marker("long")]
    others = [item for item in items if item not in long]
    ends = [len(others) * worker // workers for worker in range(workers + 1)]
    items.clear()
    for worker in range(workers):
        items += long[worker::workers] + others[ends[worker] : ends[worker + 1]]


# In CI the same examples every time, so that a red run can be made again; elsewhere new ones. No example has a
# deadline, which a busy machine would miss.
settings.register_profile("ci", derandomize=True, print_blob=True, deadline=None)
settings.register_profile("elsewhere", deadline=None)
settings.load_profile("ci" if os.environ.get("CI") == "true" else "elsewhere")


def pytest_configure(config: pytest.Config) -> None:
    """Compile both engines side by side before worker processes start, each of which would wait for the other's."""
    if not getattr(config.option, "numprocesses", None) or hasattr(config, "workerinput"):
        return
    if is_cached("event") and is_cached("fixed-step"):
        return
    compiling = [
        subprocess.Popen([sys.executable, "-c", COMPILE, engine]) for engine in ("event", "fixed-step")
    ]
    # Otherwise each worker would compile all tests. What is wrong with them is reported by the workers.
    subprocess.run([sys.executable, "-m", "pytest", "--collect-only"], stdout=subprocess.DEVNULL, check=False)
    codes = [process.wait() for process in compiling]
    if any(codes):
        raise pytest.UsageError("the engines cannot be compiled, see above")


COMPILE = """
import sys
from vibroswarm import preset, simulate
simulate(preset("paper").with_values({"run.t_end_s": 20.0}), 1, motion=sys.argv[1])
"""


@pytest.fixture
def empty_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures are made, with numbers and captions, and what is written of them is empty: for tests of all but them."""
    from vibroswarm.plots import picture

    empty = {"svg": picture.picture_bytes(Figure(figsize=(1, 1)), "svg")}
    monkeypatch.setattr(picture, "picture_bytes", lambda figure, kind, **how: empty.get(kind, b"not drawn"))


@pytest.fixture
def blank_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is drawn, and pages have blank pictures: for tests that look at no picture and no caption."""
    from vibroswarm.plots.picture import Picture
    from vibroswarm.report.report import Figure as ReportFigure

    blank = Picture(Figure(figsize=(1, 1)), pl.DataFrame({"blank": [0]}), "Blank.")
    monkeypatch.setattr(ReportFigure, "picture", property(lambda self: blank))


@pytest.fixture
def one_focal_length(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cameras are fitted from one focal length in place of four, half of the time of tracking a few pictures."""
    monkeypatch.setattr("vibroswarm.lab.tracking.camera.FOCAL_STARTS", (1.2,))


@pytest.fixture(autouse=True)
def nothing_of_others_stays() -> Iterator[None]:
    """What a test makes known, of strategies, sensors, networks, tasks and motion, is unknown again after it."""
    os.environ.pop("COLUMNS", None)  # of the terminal in which tests run; those about widths set their own
    with forgotten_afterwards():
        yield


@pytest.fixture(autouse=True, scope="module")
def nothing_of_other_files_stays() -> Iterator[None]:
    """What the fixtures of a file make known, for all of its tests, is unknown in other files."""
    with forgotten_afterwards():
        yield


@contextmanager
def forgotten_afterwards() -> Iterator[None]:
    """Context manager: what is made known inside it is unknown again after it."""
    from vibroswarm.motion import source
    from vibroswarm.networks import base as networks
    from vibroswarm.sensors import base as sensors
    from vibroswarm.strategies import base as strategies
    from vibroswarm.tasks import base as tasks

    before = {room: set(room.known()) for room in (strategies, networks, sensors, tasks, source)}
    try:
        yield
    finally:
        for room, names in before.items():
            for name in set(room.known()) - names:
                room.forget(name)
