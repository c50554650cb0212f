"""Another process that compiles what comes after motion, while this one compiles motion.

Numba compiles one kernel at a time in a process. Where there is a second processor, a first run is so shorter
by a quarter. The other process only fills the folder of kept kernels: what it does not come to do, is killed
over or does otherwise, this one compiles by itself. It ends with this one, however that ends.
"""

from __future__ import annotations

import atexit
import os
import subprocess
import sys
import threading
from typing import Final

LATER: Final = ("vibroswarm.observation.", "vibroswarm.inference.", "vibroswarm_made.none_ideal_")
"""Where the kernels are that the other process compiles."""
NOT_THERE: Final = "vibroswarm.inference.closed_loop"
"""Kernels of a search, which this process compiles."""
LONGEST_S: Final = 60.0
"""Nobody waits longer for it; what it takes three seconds for, this process does as well by itself."""
COMMAND: Final = (
    "from vibroswarm.cli.beside import end_with_parent, compile_later; end_with_parent(); compile_later()"
)


def begin() -> bool:
    """Start it, unless there is but one processor or nowhere to keep kernels; says whether it was started."""
    from vibroswarm.compiled import cache_folder, tell_before_compiling

    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if processors < 2 or not sys.executable or cache_folder() is None:
        return False
    try:
        other = subprocess.Popen(
            [sys.executable, "-c", COMMAND],
            env=os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for this process, which ends the other
        )
    except OSError:  # no more processes: then without
        return False

    def end() -> None:
        other.kill()
        other.wait()

    def wait_for_it(module: str) -> None:
        if module.startswith(LATER) and module != NOT_THERE:
            try:
                other.wait(LONGEST_S)
            except subprocess.TimeoutExpired:
                other.kill()

    atexit.register(end)
    tell_before_compiling(wait_for_it)
    return True


def end_with_parent() -> None:
    """In the other process: end when the one that started it is gone, which closes our standard input."""

    def read() -> None:
        sys.stdin.buffer.read()
        os._exit(1)

    threading.Thread(target=read, daemon=True).start()


def compile_later() -> None:
    """Observe and infer one sample: the kernels are then kept, as any run calls them."""
    import polars as pl

    from vibroswarm.floors.floor import Floor
    from vibroswarm.inference.replay import infer
    from vibroswarm.motion.contract import ENDS, MOTION, Motion
    from vibroswarm.observation.model import observe
    from vibroswarm.presets import preset

    scenario = preset("text")
    floor = Floor([[0]], scenario.arena.width_m, scenario.arena.height_m)  # type: ignore[arg-type]
    row = {"run": 0, "robot": 0, "sample": 0, "stop_start_s": 1.0, "time_s": 2.0, "x_m": 0.5, "y_m": 0.5}
    samples = pl.DataFrame([{name: row.get(name, 0.0) for name in MOTION}], schema=MOTION)
    ends = pl.DataFrame(
        [
            {name: {"robot": i, "end_s": 3.0}.get(name, 0) for name in ENDS}
            for i in range(scenario.swarm.robots)
        ],
        schema=ENDS,
    )
    observations = observe(scenario, 1, samples, {0: floor})
    infer(scenario, 1, Motion(samples, ends), observations)
