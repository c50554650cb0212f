"""The first moments of a process that runs the command, before anything else is imported.

Whatever this file imports at its top must have been loaded by Python itself: the working folder is still searched.
"""

import os
import sys

PROGRAM = "vibroswarm"
INTERRUPTED = 130
"""Exit code of a command that Ctrl-C ended."""


def leave_working_folder_out(package: str) -> None:
    """Take the working folder off the search path where ``python -m vibroswarm`` has put it.

    Otherwise a file such as ``numpy.py`` in a folder of somebody else's data would be executed. The folder stays if
    this package itself was found in it, and for other programs, which may need modules of their own from there.

    Args:
        package: the folder of this package.
    """
    if sys.flags.safe_path or not _is_run_as_module():
        return
    try:
        working_folder = os.getcwd()  # noqa: PTH109 - pathlib is slow
    except FileNotFoundError:  # it was removed, and so is not on the search path
        return
    own_folder = os.path.dirname(os.path.abspath(package))  # noqa: PTH100, PTH120
    if sys.path[:1] == [working_folder] != [own_folder]:
        del sys.path[0]


def listen_to_ctrl_c() -> None:
    """Handle Ctrl-C by ``end_at_once`` if this process is the command, until ``cli.interruption`` takes over.

    Programs that import the package, and the command's worker processes, are left alone.
    """
    if not (_is_run_as_module() or _is_script()):
        return
    try:
        import signal  # this imports other modules, which takes milliseconds

        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, end_at_once)
    except KeyboardInterrupt:
        end_at_once()


def end_at_once(number: int = 0, frame: object = None) -> None:
    """End the process with one line: it has only imported modules. This is a handler of signals."""
    try:
        os.write(2, f"{PROGRAM}: interrupted\n".encode())
    finally:  # stderr may be closed
        os._exit(INTERRUPTED)


def _is_run_as_module() -> bool:
    """Return whether Python looks for the package because of ``python -m vibroswarm``: argv is "-m" meanwhile."""
    if sys.argv[:1] != ["-m"]:
        return False
    word = sys.orig_argv[-len(sys.argv)]  # before the arguments: the name, or with its option, "-mNAME"
    module = word.partition("m")[2] if word.startswith("-") else word
    return module.partition(".")[0] == PROGRAM


def _is_script() -> bool:
    """Return whether this process runs the installed script; a worker has its name, but was started otherwise."""
    script = sys.argv[0] if sys.argv else ""
    name = os.path.basename(script)  # noqa: PTH119 - pathlib is slow
    return name.partition(".")[0] == PROGRAM and script in sys.orig_argv
