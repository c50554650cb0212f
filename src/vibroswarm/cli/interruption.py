"""What a command says after Ctrl-C: what is saved, and how to resume."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path

from vibroswarm.errors import InputError


def resume_hint(arguments: argparse.Namespace | None, words: Sequence[str]) -> str:
    """Return the message after an interruption.

    Args:
        arguments: of the command; None if they were not read yet. words: the command line, without the program.
    """
    if arguments is None or not getattr(arguments, "resumes", None):
        return (
            "interrupted; nothing is saved" if getattr(arguments, "out", None) is not None else "interrupted"
        )
    out: Path | None = arguments.out
    if out is None:
        return "interrupted; nothing is saved: with --out, finished work is saved and can be resumed"
    where = folder_of_runs(out) if arguments.resumes == "file" else out
    if not where.is_dir() or not any(where.iterdir()):
        return "interrupted; nothing is saved yet"
    command = shlex.join(["vibroswarm", *words])
    return f"interrupted; finished work is saved in '{where}'. To resume: {command}"


def folder_of_runs(file: Path) -> Path:
    """Return the folder beside a result file in which its runs are kept until it is written.

    Raises:
        InputError: a file has its name.
    """
    folder = file.with_name(f"{file.name}.runs")
    if folder.exists() and not folder.is_dir():
        raise InputError(
            "is a file; the runs of an interrupted search are kept under that name", field=str(folder)
        )
    return folder
