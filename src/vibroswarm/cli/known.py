"""Lists of what a scenario may name: strategies, networks, tasks, sources of motion, sensors, presets."""

from __future__ import annotations

from collections.abc import Callable

from vibroswarm.cli.deliver import print_document
from vibroswarm.cli.options import Json


def _listing(kind: str, words: str) -> Callable[..., None]:
    """Return the command that lists a kind; ``words`` are its help."""

    def command(*, json: Json = False) -> None:
        from vibroswarm.documents.known import known_document

        print_document(known_document(kind), as_json=json)

    command.__doc__ = words
    return command


strategies = _listing(
    "strategy", "List the strategies: what robots remember, send and decide. More in docs/strategies.md."
)
networks = _listing(
    "network", "List the networks: which messages arrive, and when. More in docs/networks-and-faults.md."
)
tasks = _listing("task", "List the tasks: what is asked of the swarm.")
motions = _listing("motion", "List the sources of motion: where and when robots sample.")
sensors = _listing("sensor", "List the sensors: what a sample measures. More in docs/scenario.md.")
presets = _listing("preset", "List the presets: scenarios by name.")
