"""Small programs that use kernels, each in a process of its own, without the second that importing Numba takes.

One process imports Numba, compiles a function, and then forks for every program. The package itself is not imported
before the fork: each program hashes the sources, finds its cache and declares its kernels as any start does.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import pytest

SERVER = """
import json, os, runpy, sys, traceback
import numba
numba.njit(lambda x: 2.0 * x)(1.0)


def run(asked):
    for stream, number in (("stdout", 1), ("stderr", 2)):
        os.dup2(os.open(asked[stream], os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
    os.chdir(asked["folder"])
    os.environ.clear()
    os.environ.update(asked["env"])
    sys.dont_write_bytecode = bool(asked["env"].get("PYTHONDONTWRITEBYTECODE"))
    sys.argv = asked["argv"]
    sys.path[:1] = [os.path.dirname(os.path.abspath(sys.argv[0])), *filter(None, [asked["env"].get("PYTHONPATH")])]
    runpy.run_path(sys.argv[0], run_name="__main__")


print(flush=True)
for line in sys.stdin:
    child = os.fork()
    if child == 0:
        code = 1
        try:
            run(json.loads(line))
            code = 0
        except BaseException:
            traceback.print_exc()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


class NumbaPrograms:
    """Runs programs one after the other, each forked from a process that has imported Numba."""

    def __init__(self, folder: Path) -> None:
        """Start the process; where there is no fork, each program starts Python.

        Args:
            folder: of the files that take what programs print.
        """
        self._folder = folder
        without = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        self._server: subprocess.Popen[str] | None = None
        if hasattr(os, "fork"):
            self._server = subprocess.Popen(
                [sys.executable, "-c", SERVER],
                env=without, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            )  # fmt: skip
            self._line()

    def _line(self) -> str:
        assert self._server is not None
        assert self._server.stdout is not None
        return self._server.stdout.readline()

    def run(
        self, program: Path, *words: str, cache: Path, env: Mapping[str, str] = os.environ
    ) -> CompletedProcess[str]:
        """Run a Python file in its folder, with a cache of kernels of its own; return what it printed."""
        env = {**env, "XDG_CACHE_HOME": str(cache), "LOCALAPPDATA": str(cache), "HOME": str(cache)}
        if self._server is None:
            return subprocess.run(
                [sys.executable, program, *words], cwd=program.parent, env=env, capture_output=True, text=True,
                check=False, timeout=120,
            )  # fmt: skip
        files = {name: self._folder / name for name in ("stdout", "stderr")}
        asked: dict[str, Any] = {name: str(file) for name, file in files.items()}
        asked |= {"folder": str(program.parent), "env": env, "argv": [str(program), *words]}
        assert self._server.stdin is not None
        print(json.dumps(asked), file=self._server.stdin, flush=True)
        code = int(self._line())
        said, errors = (file.read_text(encoding="utf-8") for file in files.values())
        return CompletedProcess(asked["argv"], code, said, errors)

    def close(self) -> None:
        """End the process."""
        if self._server is not None:
            self._server.communicate()


@pytest.fixture(scope="session")
def numba_programs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[NumbaPrograms]:
    """Runs programs that use kernels."""
    programs = NumbaPrograms(tmp_path_factory.mktemp("programs"))
    yield programs
    programs.close()
