"""What a process that runs the command does before anything else is imported.

Whatever this file imports at its top must have been loaded by Python itself: the working folder is still searched.
"""

import os
import sys


def leave_working_folder_out(package: str) -> None:
    """Take the working folder off the search path where ``python -m vibroswarm`` has put it."""
    if sys.flags.safe_path or not _is_run_as_module():
        return
    try:
        working_folder = os.getcwd()  # noqa: PTH109 - pathlib is slow
    except FileNotFoundError:  # it was removed, and so is not on the search path
        return
    own_folder = os.path.dirname(os.path.abspath(package))  # noqa: PTH100, PTH120
    if sys.path[:1] == [working_folder] != [own_folder]:
        del sys.path[0]


def _is_run_as_module() -> bool:
    """Return whether Python looks for the package because of ``python -m vibroswarm``: argv is "-m" meanwhile."""
    if sys.argv[:1] != ["-m"]:
        return False
    word = sys.orig_argv[-len(sys.argv)]  # before the arguments: the name, or with its option, "-mNAME"
    module = word.partition("m")[2] if word.startswith("-") else word
    return module.partition(".")[0] == "vibroswarm"
