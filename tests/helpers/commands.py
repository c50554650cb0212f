"""Commands, called in this process: what one prints that must succeed, and the message of one that must be refused.

And programs in a process of their own.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any

import pytest

from vibroswarm.cli import main


def output_of(capsys: pytest.CaptureFixture[str], *line: object) -> str:
    """Return what a command prints, which must succeed."""
    capsys.readouterr()  # what was printed before
    assert main([str(word) for word in line]) == 0
    return capsys.readouterr().out


def words_of(capsys: pytest.CaptureFixture[str], *line: object) -> str:
    """Return what a command prints, which must succeed, without its line breaks."""
    return " ".join(output_of(capsys, *line).split())


def json_of(capsys: pytest.CaptureFixture[str], *line: object) -> Any:
    """Return the JSON that a command prints, which must succeed."""
    return json.loads(output_of(capsys, *line))


def refusal_of(capsys: pytest.CaptureFixture[str], *line: object) -> str:
    """Return the message, without its line breaks, of a command that must be refused: exit code 2."""
    capsys.readouterr()
    assert main([str(word) for word in line]) == 2
    return " ".join(capsys.readouterr().err.split())


def printed_by(program: str, **environment: str) -> str:
    """Return what a Python program prints in a process of its own, which must succeed."""
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, env=os.environ | environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout
