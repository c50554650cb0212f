"""What ``--verbose`` reports on stderr: versions, kernels as they are loaded or compiled, and times."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from vibroswarm.cli import user_settings
from vibroswarm.cli.terminal import printing

_since_s = [0.0]
_listens: list[bool] = []


def _line(text: str) -> None:
    if printing.verbose:
        print(f"[{time.monotonic() - _since_s[0]:7.2f} s] {text}", file=sys.stderr, flush=True)


@contextmanager
def verbose() -> Iterator[None]:
    """Report on the command that runs inside."""
    from vibroswarm.core.jit import add_compile_listener, cache_folder, compiles
    from vibroswarm.simulation import versions

    _since_s[0] = time.monotonic()
    _line(", ".join(f"{name} {value}" for name, value in versions().items()))
    if (settings := user_settings.read()) and (path := user_settings.location()):
        _line(f"settings of {path}: {', '.join(f'{name} {value}' for name, value in settings.items())}")
    if compiles():
        _line(f"cache of compiled kernels: {cache_folder() or 'none can be used'}")
    if not _listens:
        _listens.append(True)
        add_compile_listener(lambda module: _line(f"loads or compiles a kernel of {module}"))
    try:
        yield
    finally:
        _line("end")
