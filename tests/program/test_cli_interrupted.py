"""After Ctrl-C: exit code 130, what is saved, the command that resumes, and the same results in the end."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import threading
from concurrent.futures import CancelledError
from contextlib import suppress
from pathlib import Path

import pytest

from helpers.commands import output_of, refusal_of
from vibroswarm.cli import main
from vibroswarm.core.atomic_io import MANIFEST, folder_lock, remove_folder
from vibroswarm.core.folders import read_manifest
from vibroswarm.core.user_code import errors_in
from vibroswarm.documents.saved import begin
from vibroswarm.optimize.steps import SearchFolder
from vibroswarm.study.executors import WorkerDied, workers_for
from vibroswarm.study.store import Store

SHORT = ["--set", "run.t_end_s=60", "--set", "decision.min_observations=5", "--robots", "2"]
LEAGUE = ["--patterns", "stripe", "--strategy", "none,soft", "--runs", "3", *SHORT]
RESUMED = {
    "evaluate": [*SHORT, "--vary", "walk.walk_duration_scale_ms=9000,9500", "--runs", "3", "--no-pictures"],
    "detect": [*SHORT, "--fills", "0.4,0.6", "--runs", "3"],
    "league": [*LEAGUE, "--belief-runs", "2", "--fault-runs", "0"],
    "league tune": [*LEAGUE, "--points", "4"],
    "optimize": ["search.toml", "--budget", "120", "--fresh", "4", "--no-pictures"],
}
SEARCH = """
[scenario]
preset = "paper"
swarm = { robots = 2 }
run = { t_end_s = 60 }
[space]
"decision.min_observations" = { from = 1, to = 20 }
[search]
method = "random"
finalists = 2
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "search.toml").write_text(SEARCH)
    return tmp_path


def stop_after(times: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the so manieth piece of finished work end with Ctrl-C, once it is saved."""
    left = [times]
    for kind in (Store, SearchFolder):
        real = kind.add

        def add(self, *given, real=real):
            real(self, *given)
            left[0] -= 1
            if left[0] == 0:
                raise KeyboardInterrupt

        monkeypatch.setattr(kind, "add", add)


def results(text: str) -> list[str]:
    """Lines of results, without those of where they are saved."""
    return [line for line in text.splitlines() if not line.startswith(("Saved", "Page"))]


@pytest.mark.slow
@pytest.mark.usefixtures("blank_pictures")
@pytest.mark.parametrize("name", RESUMED)
def test_it_resumes_by_the_command_that_is_printed(name, here, monkeypatch, capsys):
    file = "settings.toml" if name == "league tune" else None
    whole = output_of(capsys, *name.split(), *RESUMED[name], "--out", file or "whole")
    text = Path(file).read_text() if file else ""
    command = [*name.split(), *RESUMED[name], "--out", f"my {file or 'out'}"]
    with monkeypatch.context() as patched:
        stop_after(1, patched)
        assert main(command) == 130
    said = capsys.readouterr().err.splitlines()[-1]
    kept = Path(f"my {file}.runs" if file else "my out")
    assert said.startswith(f"vibroswarm: interrupted; finished work is saved in '{kept}'. To resume: ")
    assert any(kept.iterdir())
    resume = shlex.split(said.partition("To resume: ")[2])
    assert resume == ["vibroswarm", *command]
    assert results(output_of(capsys, *(resume[1:]))) == results(whole)
    if file:
        assert Path(f"my {file}").read_text() == text
        assert not kept.exists(), "the runs of a search that is done are removed"


def test_work_that_is_saved_is_not_done_again_nor_mixed_with_that_of_another_seed(here, monkeypatch, capsys):
    added = []
    command = ["league", "tune", *RESUMED["league tune"], "--out", "s.toml"]
    with monkeypatch.context() as patched:
        stop_after(2, patched)
        assert main(command) == 130
    assert "the same 'vibroswarm league tune' command" in output_of(capsys, "show", "s.toml.runs")
    assert "with other settings; give another --out" in refusal_of(capsys, *command, "--seed", "5")
    with folder_lock(Path("s.toml.runs")):
        assert f"s.toml.runs: is in use by process {os.getpid()}" in refusal_of(capsys, *command)
    with monkeypatch.context() as patched:
        patched.setattr("vibroswarm.study.executors.versions", lambda: {"code": "later"})
        said = refusal_of(capsys, *command)
    assert "begun by other versions" in said
    assert "); give another --out, or add --force" in said
    real = Store.add
    monkeypatch.setattr(
        Store, "add", lambda self, done: (added.append(self.folder.name), real(self, done))[1]
    )
    assert main(command) == 0
    assert "0-first" not in added
    assert "0-third" in added
    again = [*command, "--force"]
    with monkeypatch.context() as patched:
        stop_after(2, patched)
        assert main(again) == 130
    assert shlex.split(capsys.readouterr().err.partition("To resume: ")[2]) == ["vibroswarm", *again]
    added.clear()
    assert main(again) == 0
    assert "0-first" not in added
    with monkeypatch.context() as patched:
        stop_after(2, patched)
        assert main(again) == 130
    stop_after(1, monkeypatch)
    assert main([*again, "--seed", "5"]) == 130
    assert added.count("0-first") == 2, "runs of another question begin anew"
    Path("other.toml.runs").mkdir()
    Path("other.toml.runs/notes.txt").write_text("mine")
    assert "other.toml.runs" in refusal_of(capsys, *command[:-1], "other.toml")
    assert Path("other.toml.runs/notes.txt").exists()


@pytest.mark.usefixtures("here")
def test_a_tuning_tells_whether_it_is_done_when_its_runs_go(monkeypatch, capsys):
    command = ["league", "tune", *RESUMED["league tune"], "--out", "s.toml"]

    def stopped(folder: Path) -> None:
        shutil.rmtree(folder)
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:  # the user removes the folder during the work
        patched.setattr(Store, "add", lambda self, done: stopped(Path("s.toml.runs")))
        assert main(command) == 130
    assert capsys.readouterr().err.endswith("interrupted; nothing is saved yet\n")
    monkeypatch.setattr("vibroswarm.cli.league.remove_folder", stopped)
    assert main(command) == 130
    assert Path("s.toml").exists()
    assert capsys.readouterr().err.endswith("vibroswarm: interrupted\n")


@pytest.mark.usefixtures("here")
def test_two_tunings_that_begin_or_end_together_do_not_share_runs(monkeypatch, capsys):
    command = ["league", "tune", *RESUMED["league tune"], "--out", "s.toml"]
    other = {
        "was removed by another process": shutil.rmtree,
        "with other settings": lambda folder: begin(folder, "league tune", "of another"),
    }
    for said, done in other.items():  # by another process, before the folder is locked

        def locked(folder: Path, done=done):
            done(folder)
            return folder_lock(folder)

        with monkeypatch.context() as patched:
            patched.setattr("vibroswarm.cli.league.folder_lock", locked)
            assert said in refusal_of(capsys, *command)
        assert Path("s.toml.runs").exists() == (done is not shutil.rmtree)
        shutil.rmtree("s.toml.runs", ignore_errors=True)

    def removed(folder: Path) -> None:
        with folder_lock(folder):  # another tuning has just begun
            remove_folder(folder)

    monkeypatch.setattr("vibroswarm.cli.league.remove_folder", removed)
    assert "decision.min_observations" in output_of(capsys, *command)
    assert Path("s.toml.runs").exists()


def test_show_names_the_command_that_began_the_work(here, monkeypatch, capsys):
    """A study is ``evaluate``'s unless another command made it; of the reproduction nothing was shown at all."""
    Path("own.toml").write_text(
        SEARCH.partition("[space]")[0].replace("[", 'name = "League"\nruns = 3\n[', 1)
    )
    began = {
        "out": ["detect", *RESUMED["detect"], "--out", "out"],
        "s.toml.runs/0-first": ["league", "tune", *RESUMED["league tune"], "--out", "s.toml"],
        "grid": ["optimize", "--method", "grid", "--runs", "1", "--out", "grid"],
        "own": ["evaluate", "own.toml", "--out", "own"],
    }
    for folder, command in began.items():
        with monkeypatch.context() as patched:
            stop_after(1, patched)
            assert main(command) == 130
        next(Path(folder).glob("shards/*.json")).unlink()  # so few runs are done at once
    begin(Path("paper"), "reproduce")
    for folder, command in (
        ("out", "detect"),
        ("s.toml.runs/0-first", "league tune"),
        ("grid", "optimize --method grid"),
        ("paper", "reproduce"),
    ):
        said = f"the same 'vibroswarm {command}' command again"
        assert said in output_of(capsys, "show", folder)
    assert "To resume: vibroswarm evaluate own/study.toml --out own" in output_of(capsys, "show", "own")
    assert json.loads(output_of(capsys, "show", "own", "--json"))["command"] == "evaluate"
    for folder in ("out", "paper"):  # written by somebody else
        about = read_manifest(Path(folder)) | {"command": "x\n" * 100_000}
        Path(folder, MANIFEST).write_text(json.dumps(about))
        assert len(output_of(capsys, "show", folder)) < 1000
        assert len(refusal_of(capsys, "inspect", "--out", folder)) < 1000


def test_what_is_said_without_a_folder(here, monkeypatch, capsys):
    stop_after(1, monkeypatch)
    assert main(["evaluate", *RESUMED["evaluate"]]) == 130
    assert "nothing is saved: with --out, finished work is saved" in capsys.readouterr().err


def interrupted_after(module: str, *start: str) -> tuple[int, str, str]:
    """Exit code, output and messages of a command that gets Ctrl-C once it has imported a module."""
    line = [sys.executable, "-X", "importtime", *start, "check", "paper"]
    process = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    for said in process.stderr:
        if said.endswith(f" {module}\n"):
            process.send_signal(signal.SIGINT)
            break
    out, err = process.communicate(timeout=60)
    return process.returncode, out, "".join(x for x in err.splitlines(True) if "import time:" not in x)


@pytest.mark.parametrize("module", ["lazy_loader", "vibroswarm.cli", "polars", "pydantic", "numpy", "numba"])
def test_ctrl_c_while_modules_are_imported_ends_with_one_line(module):
    # A signal reaches a process a moment after it was sent: the modules that follow are then being imported.
    assert interrupted_after(module, "-m", "vibroswarm") == (130, "", "vibroswarm: interrupted\n")


@pytest.mark.parametrize("module", ["lazy_loader", "vibroswarm.cli.commands"])
def test_so_it_does_in_the_installed_program(module, tmp_path):
    program = tmp_path / "vibroswarm"
    program.write_text("import sys\nfrom vibroswarm.cli import main\nsys.exit(main())\n")
    assert interrupted_after(module, str(program)) == (130, "", "vibroswarm: interrupted\n")


@pytest.mark.parametrize("signals", ["signal.default_int_handler", "signal.SIG_IGN"])
def test_a_program_that_imports_the_package_keeps_its_own_ctrl_c(signals):
    code = f"import signal; signal.signal(signal.SIGINT, {signals}); import vibroswarm\n"
    code += f"assert signal.getsignal(signal.SIGINT) == {signals}"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_ctrl_c_ends_a_function_that_never_returns():
    """A user's, say, which is compiled: Python calls no handler of signals meanwhile. This one is of the library."""
    code = (
        "import hashlib, vibroswarm.cli as cli\n"
        "def forever(argv): print('begun', flush=True); hashlib.pbkdf2_hmac('sha256', b'', b'', 2**31 - 1)\n"
        "cli._code = forever\n"
        "cli.main()\n"
    )
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", code], stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "begun\n"
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (130, "vibroswarm: interrupted\n")


def ends_with_one_line(code: str) -> None:
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (130, "vibroswarm: interrupted\n")


def test_a_second_ctrl_c_does_not_interrupt_the_message():
    code = (
        "import os, signal, vibroswarm.cli as cli\n"
        "from vibroswarm.cli import terminal\n"
        "def press(*given): os.kill(os.getpid(), signal.SIGINT); return 'interrupted'\n"
        "cli._code = terminal.plain = press\n"
        "cli.main()\n"
    )
    ends_with_one_line(code)


def test_a_pool_that_is_being_ended_is_waited_for():
    """Else the process that tracks semaphores reports one whose removal was cut short."""
    code = (
        "import multiprocessing, os, signal, threading, time\n"
        "from multiprocessing import synchronize\n"
        "import vibroswarm.cli as cli\n"
        "locks = [multiprocessing.get_context('spawn').Lock()]\n"
        "unlink, removed = synchronize.sem_unlink, threading.Event()\n"
        "def slowly(name): unlink(name); removed.set(); time.sleep(0.3)\n"
        "synchronize.sem_unlink = slowly\n"
        "def stop(argv):\n"
        "    threading.Thread(target=locks.clear).start(); removed.wait(); os.kill(os.getpid(), signal.SIGINT)\n"
        "cli._code = stop\n"
        "cli.main()\n"
    )
    ends_with_one_line(code)


@pytest.mark.parametrize("executor", ["threads", "processes"])
def test_a_stopped_search_does_not_wait_for_a_function_that_never_returns(executor):
    """A user's cost, say; the program that calls the search would not end before it."""
    with suppress(KeyboardInterrupt), workers_for(executor, 1) as workers:
        future = workers.executor.submit(never_returns)
        if executor == "threads":
            assert BEGUN.wait(30.0)
        raise KeyboardInterrupt
    with pytest.raises((KeyboardInterrupt, CancelledError, WorkerDied)):
        future.result(timeout=30.0)


BEGUN = threading.Event()


def never_returns():
    with errors_in("mine.py:cost"):
        BEGUN.set()
        while True:
            pass
