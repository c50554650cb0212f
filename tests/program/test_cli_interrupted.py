"""After Ctrl-C: exit code 130, what is saved, the command that resumes, and the same results in the end."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from helpers.commands import output_of
from vibroswarm.cli import main
from vibroswarm.search.steps import SearchFolder
from vibroswarm.study.store import Store

SHORT = ["--set", "run.t_end_s=60", "--set", "decision.min_observations=5", "--robots", "2"]
LEAGUE = ["--patterns", "stripe", "--strategy", "none,soft", "--runs", "3", *SHORT]
RESUMED = {
    "evaluate": [*SHORT, "--vary", "walk.walk_duration_scale_ms=9000,9500", "--runs", "3", "--no-pictures"],
    "detect": [*SHORT, "--fills", "0.4,0.6", "--runs", "3"],
    "league": [*LEAGUE, "--belief-runs", "2"],
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

    def ending(real):
        def add(self, *given):
            real(self, *given)
            left[0] -= 1
            if left[0] == 0:
                raise KeyboardInterrupt

        return add

    monkeypatch.setattr(Store, "put", ending(Store.put))
    monkeypatch.setattr(SearchFolder, "add", ending(SearchFolder.add))


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
