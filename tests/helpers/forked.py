"""Processes that are forked from one that has imported the package: to start them costs none of its imports.

For tests of what happens when processes are killed, not of how they start.
"""

from __future__ import annotations

import multiprocessing
import os
import runpy
import sys
from pathlib import Path
from typing import Any

METHOD = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
FORKED: Any = multiprocessing.get_context(METHOD)
"""Where there is no fork, each process starts Python."""
FORKED.set_forkserver_preload(["vibroswarm.study.run", "distributed.worker"])


def begin(function: Any, *arguments: Any) -> Any:
    """Begin a process that calls a function; its ``exitcode`` is None until it has ended."""
    process = FORKED.Process(target=function, args=arguments)
    process.start()
    return process


def run_study(file: Path, folder: Path, executor: str) -> None:
    """Begin a study from a file, or go on with it."""
    from vibroswarm.study.spec import Study

    Study.read(file).run(folder, executor=executor, workers=2)


def run_module(name: str, words: list[str], folder: Path) -> None:
    """Run a module as a program, which writes into the log of a folder."""
    os.chdir(folder)
    log = os.open("cluster.log", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for stream in (1, 2):
        os.dup2(log, stream)
    sys.argv = [name, *words]
    runpy.run_module(name, run_name="__main__", alter_sys=True)
