"""A second process that compiles observation and inference while this one compiles motion.

Numba compiles one kernel at a time per process; with a second processor this makes a first run shorter by a
quarter. The second process only fills the kernel cache: whatever it does not finish, this process compiles itself.
It ends when this process ends.
"""

from __future__ import annotations

import atexit
import os
import subprocess
import sys
import threading
from typing import Final

LATER: Final = ("vibroswarm.observation.", "vibroswarm.inference.", "vibroswarm_generated.none_ideal_")
"""Modules whose kernels the second process compiles."""
EXCEPT: Final = "vibroswarm.inference.closed_loop"
"""Kernels of searches, which this process compiles."""
WAIT_S: Final = 60.0
"""Longest wait for the second process."""
COMMAND: Final = (
    "from vibroswarm.cli.background_compile import end_with_parent, compile_later; "
    "end_with_parent(); compile_later()"
)


def begin() -> bool:
    """Start the process unless there is one processor or no kernel cache; returns whether it was started."""
    from vibroswarm.core.jit import add_compile_listener, cache_folder

    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if processors < 2 or not sys.executable or cache_folder() is None:
        return False
    try:
        process = subprocess.Popen(
            [sys.executable, "-c", COMMAND],
            env=os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C goes to this process, which ends the other
        )
    except OSError:  # no more processes allowed
        return False

    def end() -> None:
        process.kill()
        process.wait()

    def wait_for_it(module: str) -> None:
        if module.startswith(LATER) and module != EXCEPT:
            try:
                process.wait(WAIT_S)
            except subprocess.TimeoutExpired:
                process.kill()

    atexit.register(end)
    add_compile_listener(wait_for_it)
    return True


def end_with_parent() -> None:
    """In the second process: exit when the first one is gone, which closes stdin."""

    def read() -> None:
        sys.stdin.buffer.read()
        os._exit(1)

    threading.Thread(target=read, daemon=True).start()


def compile_later() -> None:
    """Observe and infer one sample, which compiles the kernels that every run uses into the cache."""
    import polars as pl

    from vibroswarm.floors.floor import Floor
    from vibroswarm.inference.replay import infer
    from vibroswarm.motion.source import ENDS, MOTION, Motion
    from vibroswarm.observation.observe import observe
    from vibroswarm.scenario.scenario import preset

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
