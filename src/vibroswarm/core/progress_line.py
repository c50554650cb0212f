"""A progress bar in one line of text, for terminals and notebooks."""

from __future__ import annotations

import sys
import time
from typing import Final, TextIO

from vibroswarm.core.numbers import count, duration, rate_of, whole

WIDTH: Final = 30
"""Length of the bar, characters."""
EVERY_S: Final = 0.1
"""Least time between two updates."""


def in_notebook() -> bool:
    """Return whether this process is the kernel of a notebook; does not import IPython."""
    ipython = sys.modules.get("IPython")
    shell = getattr(ipython, "get_ipython", lambda: None)()  # None outside IPython
    return shell is not None and "IPKernelApp" in getattr(shell, "config", {})


def is_watched(stream: TextIO | None = None) -> bool:
    """Return whether somebody watches a stream: it is a terminal, or this process runs a notebook.

    Args:
        stream: by default stderr, which is None in a process without a console.
    """
    stream = sys.stderr if stream is None else stream
    return in_notebook() or (stream is not None and stream.isatty())


class ProgressLine:
    """A line on stderr that is rewritten again and again: a bar, counts, rate and the time left.

    ``width`` is the length of the text that is now on the line, in characters; 0 before the first text. The caller has
    checked that the stream exists (``is_watched``).

    Args:
        what: the words before the bar, such as "simulating".
        stream: where the line is written; by default stderr.
    """

    def __init__(self, what: str, stream: TextIO | None = None) -> None:
        # The time of the latest update is -1 at first, so that the first text is always shown.
        self.what, self.stream = what, sys.stderr if stream is None else stream
        self.began_s, self.latest_s, self.width = time.monotonic(), -1.0, 0

    def show(self, done: int, wanted: int, note: str = "") -> None:
        """Show that ``done`` of the ``wanted`` runs are done, with ``note`` at the end of the line.

        Calls that follow the last update within EVERY_S are ignored, except when all runs are done.
        """
        now_s = time.monotonic()
        if now_s - self.latest_s < EVERY_S and done < wanted:
            return
        self.latest_s = now_s
        rate = done / max(now_s - self.began_s, 1e-9)  # runs per second; the clock may not have moved yet
        filled = WIDTH * done // max(wanted, 1)  # ``wanted`` may be 0
        parts = [f"{whole(done)} of {count(wanted, 'run')}"]
        if done:
            parts.append(f"{rate_of(rate)} per second")
        if 0 < done < wanted:
            parts.append(f"{duration((wanted - done) / rate)} left")
        parts += [note] if note else []
        text = f"{self.what} [{'#' * filled}{'.' * (WIDTH - filled)}] {', '.join(parts)}"
        self.stream.write(f"\r{text.ljust(self.width)}")  # blanks cover the end of a longer previous text
        self.stream.flush()
        self.width = len(text)

    def end(self) -> None:
        """End the line, if anything has been shown on it."""
        if self.width:
            self.stream.write("\n")
            self.stream.flush()
