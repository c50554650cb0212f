"""The bar of ``Study.run``: what it shows, and where."""

from __future__ import annotations

import io
import sys
from types import SimpleNamespace

import pytest

from vibroswarm import Study, preset
from vibroswarm.cli import progress as of_commands
from vibroswarm.core import jit, progress_line
from vibroswarm.core.progress_line import ProgressLine, in_notebook, is_watched
from vibroswarm.study.runner import StudyProgress

SHORT = preset("paper").with_values({"run.t_end_s": 60.0, "swarm.robots": 2})


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_the_line_is_rewritten_and_always_ends_at_the_last_run(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0, 1.0, 1.01, 1.02])
    monkeypatch.setattr(progress_line.time, "monotonic", lambda: next(clock))
    out = io.StringIO()
    line = ProgressLine("simulating", out)
    line.show(30, 120)
    line.show(60, 120)  # too soon
    line.show(120, 120, "1 batches failed")
    line.end()
    first, last = out.getvalue().removesuffix("\n").split("\r")[1:]
    assert first == f"simulating [{'#' * 7}{'.' * 23}] 30 of 120 runs, 30 per second, 3.0 s left"
    assert last.startswith(f"simulating [{'#' * 30}] 120 of 120 runs, ")
    assert last.endswith("1 batches failed")
    assert len(last) >= len(first)


def test_a_line_of_a_command_says_how_long_the_rest_takes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now_s = 0.0
    monkeypatch.setattr(of_commands.time, "monotonic", lambda: now_s)
    with of_commands.study_progress("simulating") as show:
        now_s = 20.0
        show(StudyProgress(done=100, wanted=400, failed=1))
    said = "simulating: 100 of 400 runs (25 %), 5 per second, 60 s left, 1 batch failed\n"
    assert capsys.readouterr().err == said


def test_long_runs_have_a_rate(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Less than one run in two seconds was "0 per second"."""
    now_s = 0.0
    monkeypatch.setattr(of_commands.time, "monotonic", lambda: now_s)
    with of_commands.study_progress("simulating") as show:
        now_s = 10.0
        show(StudyProgress(done=0, wanted=20, failed=0))
        now_s = 40.0
        show(StudyProgress(done=10, wanted=20, failed=0))
    first, last = capsys.readouterr().err.splitlines()
    assert first == "simulating: 0 of 20 runs (0 %)"
    assert last == "simulating: 10 of 20 runs (50 %), 0.25 per second, 40 s left"


def test_the_time_left_does_not_count_compiling(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A league on a cold cache had "1.5 h left" when 3 minutes remained."""
    now_s = 0.0
    monkeypatch.setattr(of_commands.time, "monotonic", lambda: now_s)
    with of_commands.study_progress("simulating") as show:
        for module in ("first", "second"):
            jit._compile_listeners[-1](module)
            now_s += 60.0
            show(StudyProgress(done=0, wanted=300, failed=0))
        for done in (10, 20, 110):  # the second of two workers that waited, and then the others
            now_s += 10.0 if done != 20 else 0.5
            show(StudyProgress(done=done, wanted=300, failed=0))
    lines = capsys.readouterr().err.splitlines()
    assert "left" not in "".join(lines[:-1])
    assert lines[-1] == "simulating: 110 of 300 runs (36 %), 9.5 per second, 20 s left"


def test_a_bar_is_shown_where_somebody_watches(monkeypatch: pytest.MonkeyPatch) -> None:
    study = Study.of(SHORT, 2)
    for stream, progress, shows in (
        (Terminal(), True, True),
        (Terminal(), False, False),
        (io.StringIO(), True, False),
    ):
        monkeypatch.setattr(sys, "stderr", stream)
        study.run(progress=progress)
        assert ("2 of 2 runs" in stream.getvalue()) == shows
    seen: list[int] = []
    monkeypatch.setattr(sys, "stderr", Terminal())
    study.run(progress=lambda now: seen.append(now.done))
    assert seen[-1] == 2
    assert sys.stderr.getvalue() == ""  # type: ignore[attr-defined]


def test_a_notebook_is_known_by_its_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not in_notebook()
    for config, known in (({"IPKernelApp": {}}, True), ({}, False)):
        shell = SimpleNamespace(get_ipython=lambda config=config: SimpleNamespace(config=config))
        monkeypatch.setitem(sys.modules, "IPython", shell)  # type: ignore[arg-type]
        assert in_notebook() is known
        assert is_watched(io.StringIO()) is known
