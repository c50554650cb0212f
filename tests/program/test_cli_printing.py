"""How much a command prints: ``--wide``, ``--quiet``, ``--verbose``, large swarms, and short options."""

from __future__ import annotations

import pytest

from helpers.commands import output_of, refusal_of, remarks_of
from vibroswarm.cli import main
from vibroswarm.cli.commands import COMMANDS

RUN = ["run", "--set", "run.t_end_s=60", "--set", "decision.min_observations=5"]
STUDY = ["evaluate", "--runs", "2", "--no-confirm", *RUN[1:]]


def test_all_commands_and_tasks_take_the_options():
    for command in (command for command in COMMANDS.values() if command.place):
        options = command.parser().format_help()
        for option in ("--wide", "-q, --quiet", "-v, --verbose"):
            assert option in options, command.words


def test_quiet_tries_no_runs_to_tell_how_long_they_take(monkeypatch):
    monkeypatch.setattr("vibroswarm.study.runner.expected", lambda *_: pytest.fail("runs are tried"))
    assert main([*STUDY, "--quiet"]) == 0


def test_quiet_leaves_results_and_errors(capsys):
    assert main(STUDY) == 0
    loud = capsys.readouterr()
    assert "To do: 2 runs" in loud.err
    assert main([*STUDY, "--quiet"]) == 0
    quiet = capsys.readouterr()
    assert quiet.err == ""
    assert quiet.out == loud.out
    assert main(["-q", *STUDY]) == 0, "before the command too"
    assert capsys.readouterr().err == ""
    assert "swarm.robots" in refusal_of(capsys, *STUDY, "-q", "--robots", "0")
    assert main(STUDY) == 0
    assert "To do: 2 runs" in capsys.readouterr().err, "for one command only"


def test_verbose_reports_versions_and_tracebacks(capsys):
    printed = remarks_of(capsys, *RUN, "-v")
    assert "vibroswarm 0." in printed
    assert "cache of compiled kernels" in printed
    assert "Traceback" not in printed
    assert main([*RUN, "-v", "--floor", "nothing"]) == 2
    printed = capsys.readouterr().err
    assert "Traceback" in printed
    assert printed.splitlines()[-1].startswith("vibroswarm: error: --floor: 'nothing'")
    assert "Traceback" not in refusal_of(capsys, *RUN, "--floor", "nothing")


def test_both_are_refused():
    assert main([*RUN, "-q", "-v"]) == 2


def test_a_terminal_of_one_column_is_no_error(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "1")
    assert "majority" in output_of(capsys, "tasks")


def test_a_large_swarm_is_summarised(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    lines = output_of(capsys, *RUN, "--robots", "60").splitlines()
    assert len(lines) < 25
    counted = next(line for line in lines if line.startswith("robots  "))
    assert sum(map(int, counted.split()[1:])) == 60
    words = [line.split() for line in output_of(capsys, *RUN, "--robots", "60", "--wide").splitlines()]
    rows = [first for first, *_ in filter(None, words) if first.isdigit()]
    assert rows[-60:] == [str(robot) for robot in range(60)]
