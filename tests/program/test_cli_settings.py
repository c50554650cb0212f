"""The user's settings file, and Ctrl-C while threads cannot be stopped."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest

from helpers.commands import output_of, refusal_of
from vibroswarm.cli import main, user_settings
from vibroswarm.cli.commands import parsed
from vibroswarm.study.executors import workers_for

SHORT = ["--set", "run.t_end_s=60", "--robots", "2", "--runs", "2", "--no-confirm", "--no-pictures"]


@pytest.fixture
def config(tmp_path, monkeypatch):
    """Write the file where it is looked for."""
    monkeypatch.delenv("VIBROSWARM_CONFIG")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    path = tmp_path / "vibroswarm" / "config.toml"
    path.parent.mkdir()

    def write(text: str) -> str:
        path.write_text(text)
        return str(path)

    return write


def defaults(command: list[str]) -> dict[str, object]:
    _, values = parsed(command)
    user_settings.apply(user_settings.read(), values, command)
    return vars(values)


def test_it_sets_style_and_workers_and_options_count_more(config):
    assert defaults(["evaluate"])["style"] is None, "no file"
    config('style = "slide"\nworkers = 3\n')
    for command in (["evaluate"], ["evaluate", "x.toml"], ["evaluate", "tradeoff"], ["optimize"]):
        found = defaults([*command, "--out", "out"])
        assert (found["style"], found["workers"]) == ("slide", 3)
        assert defaults(command)["style"] is None, "pictures are not saved"
    assert defaults(["evaluate", "--style", "page", "--workers", "1"])["style"] == "page"
    assert defaults(["evaluate", "--style", "page", "--workers", "1"])["workers"] == 1
    assert defaults(["reproduce"])["workers"] == 3


def test_who_has_no_home_has_no_settings(monkeypatch, capsys):
    """As a user without an entry in the system, and without HOME: many containers run programs so."""

    def no_home():
        raise RuntimeError("Could not determine home directory.")

    for name in ("VIBROSWARM_CONFIG", "XDG_CONFIG_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(user_settings.Path, "home", no_home)
    assert user_settings.location() is None
    assert "fill_ratio" in output_of(capsys, "tasks")


def test_settings_in_a_folder_of_another_user_are_none(config, monkeypatch):
    """As with HOME=/root in a container or by sudo."""

    def denied(path, **how):
        raise PermissionError(13, "Permission denied", str(path))

    config("workers = 3")
    with monkeypatch.context() as patch:
        patch.setattr(os, "stat", denied)
        assert user_settings.read() == {}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("stile = 'page'", ("config.toml: stile", "did you mean 'style'?")),
        ("seed = 5", ("config.toml: seed", "is not a setting", "belongs in a scenario")),
        ("[scenario]\nrobots = 9", ("scenario", "is not a setting")),
        ("style = 'colum'", ("config.toml: style", "did you mean 'column'?")),
        ("style = 3", ("config.toml: style",)),
        ("workers = 0", ("config.toml: workers", "whole number from 1")),
        ("workers = true", ("config.toml: workers",)),
        ("workers = 999999", ("config.toml: workers: 999999 is wrong; give a whole number from 1 to 4096",)),
        ("workers = '4'", ("config.toml: workers",)),
        ("workers = ", ("config.toml", "TOML")),
    ],
)
def test_anything_else_is_refused(config, capsys, text, words):
    config(text)
    assert main(["evaluate", *SHORT]) == 2
    said = capsys.readouterr()
    for word in words:
        assert word in said.err
    assert said.out == ""
    with pytest.raises(SystemExit, match="0"):
        main(["evaluate", "--help"])
    assert main(["--version"]) == 0


def test_the_variable_names_another_file_or_none(config, tmp_path, monkeypatch, capsys):
    config("workers = 0")
    (tmp_path / "other.toml").write_text("workers = 2\n")
    monkeypatch.setenv("VIBROSWARM_CONFIG", str(tmp_path / "other.toml"))
    assert defaults(["evaluate"])["workers"] == 2
    monkeypatch.setenv("VIBROSWARM_CONFIG", "")
    assert defaults(["evaluate"])["workers"] is None
    monkeypatch.setenv("VIBROSWARM_CONFIG", str(tmp_path / "nowhere.toml"))
    assert "nowhere.toml" in refusal_of(capsys, "evaluate", *SHORT)


def test_ctrl_c_does_not_wait_for_threads():
    """As for one that compiles, which nothing can stop."""

    def interrupted() -> None:
        with workers_for("threads", 1) as crew:
            crew.executor.submit(time.sleep, 5.0)
            raise KeyboardInterrupt

    began_s = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert time.monotonic() - began_s < 3.0


PROGRAM = """
import atexit, sys, threading, time
from vibroswarm import cli
from vibroswarm.cli import scenario

def stopped():
    atexit.register(print, "cleaned up", flush=True)
    threading.Thread(target=time.sleep, args=(60.0,)).start()  # the interpreter would wait for it
    raise KeyboardInterrupt

scenario.scenario = stopped
sys.argv = ["vibroswarm", "scenario"]
sys.exit(cli.main())
"""


def test_the_program_leaves_at_once_and_cleans_up():
    began_s = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=50, env=dict(os.environ)
    )
    assert time.monotonic() - began_s < 30.0
    assert (done.returncode, done.stdout.strip()) == (130, "cleaned up")
    assert done.stderr.strip() == "vibroswarm: interrupted"


LOST = """
import ctypes, os, signal, sys, time
from vibroswarm import cli
from vibroswarm.cli import scenario

def called_from_c():
    os.kill(os.getpid(), signal.SIGINT)  # as Ctrl-C while LLVM calls Python
    return 0

def stopped():
    ctypes.CFUNCTYPE(ctypes.c_int)(called_from_c)()
    if END == "error":
        raise RuntimeError("no compiled object yet")
    time.sleep(20.0)
    return 0

scenario.scenario = stopped
sys.argv = ["vibroswarm", "scenario"]
sys.exit(cli.main())
"""


BELOW_POLARS = """
import os, signal, sys, time
import polars as pl
from vibroswarm import cli
from vibroswarm.cli import scenario

def interrupted(of_list, inner):
    of_list.inner = inner
    pl.List.__init__ = as_before
    os.kill(os.getpid(), signal.SIGINT)

def stopped():
    frame.schema
    time.sleep(20.0)
    return 0

frame = pl.DataFrame({"a": [[1]]})
as_before = pl.List.__init__
pl.List.__init__ = interrupted
scenario.scenario = stopped
sys.argv = ["vibroswarm", "scenario"]
sys.exit(cli.main())
"""


def test_ctrl_c_where_polars_calls_python_is_no_panic_of_polars():
    done = subprocess.run([sys.executable, "-c", BELOW_POLARS], capture_output=True, text=True, timeout=50)
    assert (done.returncode, done.stderr.strip()) == (130, "vibroswarm: interrupted")


@pytest.mark.parametrize("end", ["error", "nothing"])
def test_ctrl_c_is_not_lost_where_llvm_calls_python(end):
    began_s = time.monotonic()
    program = f"END = {end!r}\n{LOST}"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=50)
    assert (done.returncode, done.stderr.strip()) == (130, "vibroswarm: interrupted")
    assert time.monotonic() - began_s < 15.0
