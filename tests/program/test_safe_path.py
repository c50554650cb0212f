"""Files of the working folder that have the names of modules are not executed, here or in any process started."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import vibroswarm
from helpers.hostile_files import executed, hostile_folder

SOURCES = Path(vibroswarm.__file__).parents[1]
EVALUATE = "evaluate --executor processes --workers 1 --runs 4 --robots 2 --set run.t_end_s=30 --no-pictures"


def test_control_the_files_are_executed_without_the_safe_path(tmp_path):
    folder = hostile_folder(tmp_path)
    subprocess.run([sys.executable, "-c", "import vibroswarm"], cwd=folder, capture_output=True, check=False)
    assert executed(folder)


@pytest.mark.parametrize("words", ["--version", pytest.param(EVALUATE, marks=pytest.mark.slow)])
def test_the_working_folder_is_left_out(words, tmp_path):
    """Of these, ``vibroswarm.py`` alone is Python's own choice: ``python -m`` looks for it before we are there."""
    folder = hostile_folder(tmp_path)
    (folder / "vibroswarm.py").unlink()
    command, environment = (
        [sys.executable, "-m", "vibroswarm", *words.split()],
        os.environ | {"PYTHONPATH": str(SOURCES)},
    )
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    assert executed(folder) == []
