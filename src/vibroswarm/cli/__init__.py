"""The command ``vibroswarm``: one function for each command.

Exit codes: 0 success; 2 bad input; 1 failure during the work; 130 interrupted (Ctrl-C).
"""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Final

from vibroswarm.errors import InputError, RunError

INTERRUPTED: Final = (
    "interrupted; with --out, finished runs are kept there, and the same command continues with them"
)
GC_THRESHOLD: Final = 700_000
"""New objects between garbage collections: more than short commands make."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line and return the exit code."""
    words = sys.argv[1:] if argv is None else list(argv)
    # Our workers use all cores already, and the last bits of linear algebra would depend on their number.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ["MPLBACKEND"] = "agg"  # pictures are files
    if "--plain" in words and "vibroswarm.core.jit" not in sys.modules:  # which reads it once
        os.environ["VIBROSWARM_PLAIN"] = "1"
    gc.set_threshold(GC_THRESHOLD)
    try:
        code = _command(words)
    except BrokenPipeError:  # the reader, such as `head`, has enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except InputError as error:
        return _failed(f"error: {error}", 2)
    except (RunError, MemoryError, OSError) as error:
        # an error of the system that names a file is about a name that the user gave
        return _failed(f"error: {error}", 2 if getattr(error, "filename", None) else 1)
    except KeyboardInterrupt:
        return _failed(INTERRUPTED, 130)
    if argv is None:
        gc.freeze()  # the end of the process need not search for garbage
    return code


def _command(words: Sequence[str]) -> int:
    from vibroswarm.cli import commands, terminal
    from vibroswarm.cli.command_line import bound, group_of
    from vibroswarm.cli.options import Common

    terminal.printing = Common()
    if not words or words[0].startswith("-"):
        return commands.run_top(words)
    command, rest = commands.command_in(words)
    values = vars(command.parser().parse_args(rest))
    terminal.printing = group_of(Common, values)
    trust: AbstractContextManager[None] = nullcontext()
    if terminal.printing.trust:
        from vibroswarm.scenario import plugins

        trust = plugins.trust_code()
    with trust:
        call = bound(command.function(), values)
        code = command.function()(*call.args, **call.kwargs)
    sys.stdout.flush()  # here, where an error has its exit code
    return int(code or 0)


def _failed(message: str, code: int) -> int:
    from vibroswarm.cli import terminal

    if terminal.printing.verbose:
        import traceback

        traceback.print_exc()
    terminal.say(f"vibroswarm: {message}")
    return code
