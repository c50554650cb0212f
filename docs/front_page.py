"""The replay on the front page: one inspection, simulated when the site is built, as ``_static/replay.html``."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

COMMAND = ("run", "--strategy", "soft", "--seed", "2")


def write_replay(app: Any, failed: Exception | None) -> None:
    """Write the page; in a process of its own, since the kernels of this one are plain Python."""
    if failed is not None or app.builder.format != "html":
        return
    compiled = {name: value for name, value in os.environ.items() if name != "VIBROSWARM_PLAIN"}
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        command = [sys.executable, "-m", "vibroswarm", *COMMAND, "--out", str(run)]
        subprocess.run(command, env=compiled, check=True, capture_output=True)
        page = (run / "run.html").read_bytes()
    (Path(app.outdir) / "_static" / "replay.html").write_bytes(page)


def setup(app: Any) -> dict[str, bool]:
    """Register the hook."""
    app.connect("build-finished", write_replay)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
