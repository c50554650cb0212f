"""What an installed package offers by entry points: on the command line, in files, in worker processes, and gone."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
POINTS = """\
[vibroswarm.strategies]
voter = mine.voter:voter

[vibroswarm.networks]
near = mine.near:near

[vibroswarm.tasks]
corner = mine.corner:corner
"""
CORNER = '''"""Does the lower left tile vibrate?"""

from vibroswarm.tasks import Task


def truth(floor, asked, p):
    return int(floor.tiles[-1, 0])


corner = Task(name="corner", truth=truth, answers=("it is still", "it vibrates"))
'''


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A folder with an installed package ``mine``."""
    site = tmp_path / "site packages"
    info = site / "mine-1.0.dist-info"
    (site / "mine").mkdir(parents=True)
    info.mkdir()
    (site / "mine" / "__init__.py").touch()
    (site / "mine" / "corner.py").write_text(CORNER, encoding="utf-8")
    shutil.copy(EXAMPLES / "strategies" / "voter.py", site / "mine")
    shutil.copy(EXAMPLES / "networks" / "near.py", site / "mine")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(POINTS, encoding="utf-8")
    return site


def python(*arguments: str, package: Path) -> subprocess.CompletedProcess[str]:
    environment = dict(os.environ)
    paths = [str(package), *filter(None, [environment.get("PYTHONPATH")])]
    environment["PYTHONPATH"] = os.pathsep.join(paths)
    command = [sys.executable, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment, check=False)


def vibroswarm(*arguments: str, package: Path) -> subprocess.CompletedProcess[str]:
    return python("-m", "vibroswarm", *arguments, package=package)


@pytest.mark.slow
def test_only_what_is_chosen_is_loaded(package: Path, tmp_path: Path) -> None:
    points = package / "mine-1.0.dist-info" / "entry_points.txt"
    points.write_text(
        POINTS.replace(
            "[vibroswarm.networks]",
            "broken = mine.nowhere:broken\nsoft = mine.voter:voter\n\n[vibroswarm.networks]",
        )
    )
    scenario = tmp_path / "own.toml"
    scenario.write_text(
        "[run]\nt_end_s = 20\n\n[strategy]\nname = 'none'\n\n[strategy.voter]\nphase_s = 30\n"
    )
    for words in (["--scenario", str(scenario)], ["--strategy", "voter", "--set", "run.t_end_s=20"]):
        done = vibroswarm("run", *words, package=package)
        assert done.returncode == 0, done.stderr
    misspelt = vibroswarm("run", "--set", "strategy.eta=3", package=package)
    assert "did you mean 'strategy.soft.eta'?" in misspelt.stderr
