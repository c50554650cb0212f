"""A progress bar in one line of text, for terminals and notebooks."""

from __future__ import annotations

import sys
import time
from typing import Final, TextIO

WIDTH: Final = 30
EVERY_S: Final = 0.1
"""Least time between two updates."""


def in_notebook() -> bool:
    """Return whether this process is the kernel of a notebook."""
    shell = sys.modules.get("IPython")
    current = getattr(shell, "get_ipython", lambda: None)()
    return current is not None and "IPKernelApp" in getattr(current, "config", {})


def is_watched(stream: TextIO | None = None) -> bool:
    """Return whether somebody watches a stream (stderr): it is a terminal, or the output of a notebook's cell."""
    stream = sys.stderr if stream is None else stream
    return in_notebook() or (stream is not None and stream.isatty())


class ProgressLine:
    """Rewrites one line on stderr: a bar, counts, rate and the time left."""

    def __init__(self, what: str, stream: TextIO | None = None) -> None:
        self.what, self.stream = what, sys.stderr if stream is None else stream
        self.began_s, self.latest_s, self.width = time.monotonic(), -1.0, 0

    def show(self, done: int, wanted: int, note: str = "") -> None:
        """Show how many of the ``wanted`` runs are done; the last is always shown."""
        now_s = time.monotonic()
        if now_s - self.latest_s < EVERY_S and done < wanted:
            return
        self.latest_s = now_s
        rate = done / max(now_s - self.began_s, 1e-9)
        filled = WIDTH * done // max(wanted, 1)
        parts = [f"{done:,} of {wanted:,} runs"]
        if done:
            parts.append(f"{rate:,.0f} per second")
        if 0 < done < wanted:
            parts.append(f"{(wanted - done) / rate:.0f} s left")
        parts += [note] if note else []
        text = f"{self.what} [{'#' * filled}{'.' * (WIDTH - filled)}] {', '.join(parts)}"
        self.stream.write(f"\r{text.ljust(self.width)}")
        self.stream.flush()
        self.width = len(text)

    def end(self) -> None:
        """End the line, if there is one."""
        if self.width:
            self.stream.write("\n")
            self.stream.flush()
