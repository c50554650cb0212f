"""Of several processes that need a kernel at once, one compiles it; the others wait, and load it from the cache."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from vibroswarm.core import kernel_lock
from vibroswarm.core.jit import PLAIN
from vibroswarm.core.kernel_lock import KernelLock

pytestmark = pytest.mark.skipif(
    PLAIN or sys.platform == "win32", reason="nothing is compiled, or there are no locks"
)

KERNEL = """
from vibroswarm.core.jit import kernel

@kernel
def twice(x):
    return 2.0 * x
"""
COMPILES = """
import sys
from numba.core import event
from one_kernel import twice

class Hold(event.Listener):
    def on_start(self, what):  # the compilation begins, and goes on when the test says so
        print("compiles", flush=True)
        sys.stdin.readline()

    def on_end(self, what):
        pass

event.register("numba:compile", Hold())
{before}
print(twice(2.0), sum(twice.stats.cache_hits.values()), flush=True)
"""
WITHOUT_LOCKS = "from vibroswarm.core.kernel_lock import KernelLock; KernelLock.acquire = lambda self: None"


@contextmanager
def program(folder: Path, before: str = "") -> Iterator[subprocess.Popen[str]]:
    """A program that is about to compile the kernel, into a cache that all programs of the folder share."""
    (folder / "one_kernel.py").write_text(KERNEL, encoding="utf-8")
    os.utime(folder / "one_kernel.py", (1e9, 1e9))
    cache = str(folder / "cache")
    env = os.environ | {"XDG_CACHE_HOME": cache, "LOCALAPPDATA": cache, "HOME": cache}
    with subprocess.Popen(
        [sys.executable, "-c", COMPILES.format(before=before)],
        cwd=folder, env=env, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        try:
            yield process
        finally:
            process.kill()


def next_line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def test_one_process_compiles_and_the_other_loads(tmp_path: Path) -> None:
    with program(tmp_path) as one:
        assert next_line(one) == "compiles"
        with program(tmp_path) as other:
            time.sleep(0.5)  # The other may have come to the kernel, or come later: it finds the same.
            one.communicate("\n")
            assert other.communicate()[0] == "4.0 1\n", "from the cache, and nothing was compiled"


def test_without_the_lock_both_compile(tmp_path: Path) -> None:
    """Negative control: the test above sees a process that does not wait."""
    with program(tmp_path) as one:
        assert next_line(one) == "compiles"
        with program(tmp_path, WITHOUT_LOCKS) as other:
            assert next_line(other) == "compiles"


def test_a_process_that_is_killed_while_it_compiles_holds_nobody_up(tmp_path: Path) -> None:
    with program(tmp_path) as one:
        assert next_line(one) == "compiles"
        with program(tmp_path) as other:
            one.kill()
            assert other.communicate("\n")[0] == "compiles\n4.0 0\n"


def test_a_process_that_stands_still_is_not_waited_for_without_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    holder = "from vibroswarm.core.kernel_lock import KernelLock; from pathlib import Path; "
    holder += "KernelLock(Path('.'), 'a').acquire(); print('held', flush=True); input()"
    with subprocess.Popen(
        [sys.executable, "-c", holder], cwd=tmp_path, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert next_line(process) == "held"
        waits: list[float] = []
        monkeypatch.setattr(kernel_lock, "WAIT_S", 0.2)
        monkeypatch.setattr(kernel_lock, "sleep", lambda s: waits.append(s) or time.sleep(s))
        KernelLock(tmp_path, "b").acquire()
        assert waits == [], "another kernel's lock is free"
        KernelLock(tmp_path, "a").acquire()
        assert waits
        process.communicate("\n")


def test_where_there_can_be_no_locks_nobody_waits(tmp_path: Path) -> None:
    (tmp_path / "locks").mkdir()
    lock = KernelLock(tmp_path, "a")
    lock.acquire()
    lock.release()


def test_nobody_waits_for_a_file_of_another_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> int:
        raise PermissionError(errno.EACCES, "Permission denied")  # a lock held by another has this number too

    monkeypatch.setattr(kernel_lock.os, "open", refused)
    monkeypatch.setattr(kernel_lock, "sleep", lambda s: pytest.fail("waits"))
    KernelLock(tmp_path, "a").acquire()
