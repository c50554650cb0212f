"""A second process that compiles the kernels of observation and inference while this process compiles those of motion.

Numba compiles one kernel at a time in each process. If there is a second processor, a second process makes the very
first run shorter by a quarter. The second process only fills the kernel cache on disk, from which this process loads
the kernels. If the second process does not finish a kernel, this process compiles that kernel when it needs it. The
second process ends when this process ends.
"""

from __future__ import annotations

import atexit
import os
import subprocess
import sys
import threading
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from vibroswarm.scenario.scenario import Scenario

LATER: Final = ("vibroswarm.observation.", "vibroswarm.inference.")
"""Modules whose kernels the second process compiles, besides those generated for a strategy and a network."""
EXCEPT: Final = "vibroswarm.inference.closed_loop"
"""Module of kernels of searches, which match a prefix of ``LATER``, but which the second process does not compile."""
WAIT_S: Final = 60.0
"""Longest wait of this process for the end of the second process."""
COMMAND: Final = (
    "import gc, sys; gc.disable(); from vibroswarm.cli.background_compile import end_with_parent, compile_later; "
    "end_with_parent(); compile_later(*sys.argv[1:])"
)
"""Python program that the second process runs; its arguments are those of ``compile_later``. It collects no garbage,
as it soon ends."""


def begin(scenario: Scenario | None = None) -> bool:
    """Start the second process; make this process wait for it before loading a kernel that the second one compiles.

    Args:
        scenario: whose strategy and network will be needed; if it is not given, or names a user's code, those of
            ``compile_later`` are compiled.
    Returns:
        True if the second process was started. False if there is only one processor, if there is no kernel cache that
        both processes can use, or if the process cannot be started.
    """
    from vibroswarm.core import child_python
    from vibroswarm.core.jit import add_compile_listener, cache_folder

    # the processors that this process may use, or on systems that do not report them, those of the machine
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if processors < 2 or not sys.executable or cache_folder() is None:
        return False
    pair = ("none", "ideal")
    if scenario is not None and not scenario.codes:
        pair = (scenario.strategy.name, scenario.network.name)
    later = (*LATER, f"vibroswarm_generated.{'_'.join(pair)}_")
    try:
        process = subprocess.Popen(
            child_python.command("-c", COMMAND, *pair),
            env=child_python.environment(),  # so that the second process imports the same vibroswarm and Numba
            # Nothing is written to this pipe. It closes when this process ends, and then the second process ends too
            # (``end_with_parent``).
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C reaches this process only, which then ends the second process
        )
    except OSError:  # no more processes allowed
        return False

    def end() -> None:
        process.kill()
        process.wait()

    def wait_before_loading(module: str) -> None:
        """If the second process compiles the kernel of ``module``, wait until that process ends.

        The second process ends when it has compiled all its kernels. They are then in the cache, so that this process
        need not compile them too. This function is called before any kernel is loaded from the cache or compiled. After
        ``WAIT_S`` the second process is killed; this process then compiles what is missing itself.
        """
        if module.startswith(later) and module != EXCEPT:
            try:
                process.wait(WAIT_S)
            except subprocess.TimeoutExpired:
                process.kill()

    atexit.register(end)
    add_compile_listener(wait_before_loading)
    return True


def end_with_parent() -> None:
    """In the second process: start a thread that ends this second process when the first process ends."""

    def exit_when_stdin_closes() -> None:
        sys.stdin.buffer.read()  # returns when the pipe from the first process closes; nothing is ever written to it
        os._exit(1)

    threading.Thread(target=exit_when_stdin_closes, daemon=True).start()


def compile_later(strategy: str = "none", network: str = "ideal") -> None:
    """In the second process: observe a single sample and infer from it, which compiles the kernels of ``LATER``.

    The compiled kernels are saved in the cache; those generated for the strategy and the network are among them. The
    tables of motion hold one sample of robot 0, and the end of every robot; columns that do not matter are 0.
    """
    import polars as pl

    from vibroswarm.floors.floor import Floor
    from vibroswarm.inference.replay import infer
    from vibroswarm.motion.source import ENDS, MOTION, Motion
    from vibroswarm.observation.observe import observe
    from vibroswarm.scenario.scenario import preset

    scenario = preset("text").with_values({"strategy.name": strategy, "network.name": network})
    # a single still tile
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
    observations = observe(scenario, seed=1, samples=samples, floors={0: floor})  # run 0 has this floor
    infer(scenario, seed=1, motion=Motion(samples, ends), observations=observations)
