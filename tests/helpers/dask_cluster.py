"""A real Dask scheduler and real workers, each a process of its own, on this machine only."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from helpers.forked import begin, run_module

PATIENCE_S = 60.0


class Cluster:
    """A scheduler with workers; a context manager. ``scheduler_file`` and ``address`` lead to it."""

    def __init__(self, folder: Path, workers: int, sources: Path | None = None) -> None:
        self.folder, self.scheduler_file, self.sources = folder, folder / "scheduler file.json", sources
        self.scheduler = self.start("dask_scheduler", "--port", "0")
        self.wait_for(self.scheduler_file.is_file)
        self.workers = [self.start_worker() for _ in range(workers)]

    def start(self, what: str, *options: str) -> Any:
        """A process that is forked, or one of its own where it has other sources than these."""
        module = f"distributed.cli.{what}"
        words = [
            "--host",
            "127.0.0.1",
            "--no-dashboard",
            "--dashboard-address",  # its pages are served nevertheless, by default on port 8787 of every address
            "127.0.0.1:0",
            "--scheduler-file",
            str(self.scheduler_file),
            *options,
        ]
        if self.sources is None:
            return begin(run_module, module, words, self.folder)
        env = {**os.environ, "PYTHONPATH": str(self.sources)}
        with (self.folder / "cluster.log").open("ab") as log:
            return OwnProcess(
                [sys.executable, "-m", module, *words], env=env, cwd=self.folder, stdout=log, stderr=log
            )

    def start_worker(self) -> Any:
        return self.start(
            "dask_worker", "--nthreads", "1", "--no-nanny", "--local-directory", str(self.folder)
        )

    @property
    def address(self) -> str:
        import json

        told = json.loads(self.scheduler_file.read_text(encoding="utf-8"))["address"]
        return str(told).replace("tcp://", "dask://")

    def wait_for_workers(self) -> None:
        """Until all have come."""
        import distributed

        with distributed.Client(scheduler_file=str(self.scheduler_file), set_as_default=False) as client:
            client.wait_for_workers(sum(w.exitcode is None for w in self.workers), timeout=PATIENCE_S)

    def add_worker(self) -> None:
        self.workers.append(self.start_worker())
        self.wait_for_workers()

    def wait_for(self, it_is_so: object) -> None:
        until_s = time.monotonic() + PATIENCE_S
        while not it_is_so():  # type: ignore[operator]
            assert time.monotonic() < until_s, (self.folder / "cluster.log").read_text()
            time.sleep(0.05)

    def __enter__(self) -> Cluster:
        self.wait_for_workers()
        return self

    def __exit__(self, *_: object) -> None:
        for process in [*self.workers, self.scheduler]:
            process.kill()
        for process in [*self.workers, self.scheduler]:
            process.join()


class OwnProcess(subprocess.Popen[bytes]):
    """A program, with the names that processes of ``multiprocessing`` have."""

    join = subprocess.Popen.wait

    @property
    def exitcode(self) -> int | None:
        return self.poll()
