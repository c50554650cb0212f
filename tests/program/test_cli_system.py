"""The program and the system: full, closed and broken outputs, names and folders that cannot be."""

from __future__ import annotations

import errno
import multiprocessing
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import polars as pl
import pytest

from vibroswarm.cli import commands, main
from vibroswarm.core import tables
from vibroswarm.core.atomic_io import whole_folder, write_file
from vibroswarm.core.folders import matching
from vibroswarm.errors import InputError, RunError
from vibroswarm.study import executors

PROGRAM = f"{sys.executable} -m vibroswarm"


def started(line: str) -> tuple[int, str]:
    """Exit code and stderr of a shell's line; ``COMPLETION`` prints most in least time."""
    for word in ("COMPLETION bash", "SCENARIO"):
        line = line.replace(word, f"{PROGRAM} {word.lower()}")
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False)
    return done.returncode, done.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
@pytest.mark.parametrize(
    ("line", "code", "said"),
    [
        ("COMPLETION bash > /dev/full", 1, "the output could not be written: No space left on device"),
        ("SCENARIO --help > /dev/full", 1, "the output could not be written: No space left on device"),
        ("COMPLETION bash >&-", 1, "stdout is closed"),
        ("COMPLETION bash | head -1 > /dev/null; exit ${PIPESTATUS[0]}", None, ""),
        ("SCENARIO --robots x 2>&-", 2, ""),
        ("SCENARIO --verbose 2> /dev/full", 0, ""),  # what it is doing is lost, what it does is not
    ],
)
def test_outputs_that_cannot_be_written(line: str, code: int | None, said: str) -> None:
    found, stderr = started(line)
    assert found == code if code is not None else found in (0, 1)
    assert "Traceback" not in stderr
    assert "Exception ignored" not in stderr
    assert said in stderr
    assert len(stderr.splitlines()) <= 1


def test_pictures_need_no_windows(tmp_path: Path) -> None:
    """A backend of the environment that matplotlib does not know ended in a traceback."""
    line = f"MPLBACKEND=nonsense {PROGRAM} floors show diagonal:0.48 --out {tmp_path}/floor.png"
    assert started(line) == (0, "")


def test_a_working_folder_that_was_removed_is_not_called_an_output(tmp_path: Path) -> None:
    line = f"cd {tmp_path} && mkdir gone && cd gone && rmdir ../gone && SCENARIO --out scenario.toml"
    assert started(line) == (2, "vibroswarm: error: the working folder was removed; change to another one\n")


LONG = "x" * 300


@pytest.mark.parametrize(
    "line",
    [
        ["scenario", "--scenario", LONG],
        ["scenario", "--scenario", f"{LONG}/a.toml"],
        ["scenario", "--energies", LONG],
        ["scenario", "--floor", f"{LONG}.txt"],
        ["run", "--out", LONG, "--set", "run.t_end_s=1"],
        ["evaluate", LONG],
        ["show", LONG],
        ["evaluate", "merge", LONG, LONG],
        ["lab", "import", LONG, "--floor", "diagonal:0.46", "--out", "lab"],
        ["lab", "export", LONG, "--out", "x"],
        ["lab", "replay", LONG],
        ["lab", "threshold", LONG],
        ["calibrate", "compare", LONG, LONG],
        ["calibrate", "figures", LONG],
        ["optimize", LONG],
        ["optimize", "--check", LONG],
        ["scenario", "--out", LONG],
        ["floors", "show", LONG],
        ["scenario", "--robots", "9" * 5000],
        ["scenario", "--set", f"swarm.robots={'9' * 5000}"],
        ["scenario", "--scenario", "a\0b"],
        ["show", "a\0b"],
        ["run", "--out", "a\0b", "--set", "run.t_end_s=1"],
    ],
    ids=lambda line: " ".join(line)[:30],
)
def test_names_that_cannot_be_are_refused(
    line: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(line) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("vibroswarm: error: ")
    assert len(said) < 700
    assert list(tmp_path.iterdir()) == []


NOBODY = 65534


@pytest.fixture
def locked() -> Iterator[Path]:
    """A folder that this process may not read; root, to whom nothing is forbidden, is somebody else meanwhile."""
    with tempfile.TemporaryDirectory() as parent:
        Path(parent).chmod(0o755)
        folder = Path(parent) / "locked"
        folder.mkdir(mode=0)
        root = os.geteuid() == 0
        if root:
            os.seteuid(NOBODY)
        try:
            yield folder
        finally:
            if root:
                os.seteuid(0)
            folder.chmod(0o700)


def test_a_folder_that_cannot_be_read_does_not_count_as_empty(locked: Path) -> None:
    """One of shards or steps: of a study there would seem to be no runs."""
    assert matching(locked.parent, "lock*") == [locked]
    assert matching(locked.parent / "none", "*") == []
    with pytest.raises(InputError, match="cannot be read: Permission denied"):
        matching(locked, "*")


def test_a_table_that_may_not_be_read_is_not_called_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(path: Path) -> None:
        raise PermissionError(f"Permission denied (os error 13): {path}")

    (tmp_path / "runs.parquet").touch()
    monkeypatch.setattr(tables, "scan_frame", refused)
    with pytest.raises(InputError, match=r"runs\.parquet: cannot be read: Permission denied$"):
        tables.read_frame(tmp_path / "runs.parquet", "runs")


def test_a_panic_of_polars_is_reported_in_a_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As with few open files (ulimit -n 20): a panic is no Exception of Python, and had its traceback."""

    def panic(*arguments: object) -> int:
        raise pl.exceptions.PanicException("Too many open files")

    monkeypatch.setattr(commands, "call", panic)
    assert main(["presets"]) == 1
    assert capsys.readouterr().err == (
        "vibroswarm: error: polars failed: Too many open files; see the traceback with --verbose\n"
    )


def test_processes_that_cannot_share_memory_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where /dev/shm is read-only."""

    def refused(*arguments: object, **named: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), "/dev/shm/pym-1")

    monkeypatch.setattr(executors, "_ProcessFlag", refused)
    with (
        pytest.raises(RunError, match=r"share memory .*/dev/shm/pym-1.*; use threads instead"),
        executors.workers_for("processes", 1),
    ):
        pass


def test_a_process_that_may_start_none_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """All runs were lost, with "AssertionError: daemonic processes are not allowed to have children"."""
    monkeypatch.setitem(multiprocessing.current_process()._config, "daemon", True)  # type: ignore[attr-defined]
    with (
        pytest.raises(RunError, match="cannot start processes; use threads"),
        executors.workers_for("processes", 1),
    ):
        pass


def test_a_file_that_does_not_fit_is_named_by_the_folder_that_was_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*arguments: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(RunError) as found, whole_folder(tmp_path / "mine") as part:
        write_file(part / "run.html", "page")
    assert str(found.value) == f"could not write '{tmp_path / 'mine' / 'run.html'}': No space left on device"


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (OSError("could not load libllvmlite.so"), 1, "could not load libllvmlite.so"),
        # of polars, if the folder of a study is removed while it runs
        (
            OSError("No such file (os error 2): gone/a.parquet"),
            2,
            "gone/a.parquet: cannot be used: No such file",
        ),
        # of tempfile
        (
            OSError(errno.ENOENT, "No usable temporary directory found"),
            1,
            "No usable temporary directory found",
        ),
    ],
)
def test_an_error_of_a_library_is_not_taken_for_the_output(
    error: OSError, code: int, said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails(*_: object) -> int:
        raise error

    monkeypatch.setattr(commands, "call", fails)
    assert main(["scenario"]) == code
    assert capsys.readouterr().err == f"vibroswarm: error: {said}\n"


@pytest.mark.parametrize("command", ["show", "lab replay", "evaluate", "evaluate merge out"])
def test_folders_that_cannot_be_read_are_refused(
    command: str, locked: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(PermissionError):
        list(locked.iterdir())
    assert main([*command.split(), str(locked)]) == 2
    assert f"error: {locked}: " in capsys.readouterr().err, "a file in it is named"


def test_what_a_file_holds_does_not_reach_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A message is one line, and no escape sequence of a terminal."""
    path = tmp_path / "energies.csv"
    path.write_text('kind,energy\n"\x1b[31m\nx",1\n')
    assert main(["scenario", "--energies", str(path)]) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1
    assert said.rstrip("\n").isprintable()
