"""What a user should know although the work goes on: said once, through ``logging``, which shows it on stderr."""

from __future__ import annotations

import logging
import multiprocessing
from functools import cache


@cache
def say_once(message: str) -> None:
    """Say it, the first time in the process that the user began; workers stay silent."""
    if multiprocessing.parent_process() is None:
        logging.getLogger("vibroswarm").warning("vibroswarm: %s", message)
