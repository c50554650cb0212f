"""The first run of all, with nothing compiled yet."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import vibroswarm
from vibroswarm.core.jit import PLAIN

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(PLAIN or sys.platform == "win32", reason="nothing is compiled"),
]
RUN = ["-m", "vibroswarm", "run", "--json", "--set", "run.t_end_s=30"]


def test_the_first_run_says_that_it_compiles_and_gives_what_later_ones_give(tmp_path: Path) -> None:
    source = str(Path(vibroswarm.__file__).parents[1])
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path), "HOME": str(tmp_path), "PYTHONPATH": source}
    command = [sys.executable, "-P", *RUN]
    first, again = (
        subprocess.run(command, env=environment, capture_output=True, text=True, check=True) for _ in range(2)
    )
    assert "compiling the engine" in first.stderr
    assert (again.stdout, again.stderr) == (first.stdout, "")
    assert not [path for path in tmp_path.rglob("*") if ".tmp." in path.name], "nothing half-written"
