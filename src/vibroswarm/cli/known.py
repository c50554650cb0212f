"""Lists of what a scenario may name: strategies, networks, tasks, sources of motion, sensors, presets."""

from __future__ import annotations

from vibroswarm.cli.options import Json


def _print(kind: str, *, json: bool) -> None:
    from vibroswarm.cli.deliver import print_document
    from vibroswarm.documents.known import known_document

    print_document(known_document(kind), as_json=json)


def strategies(*, json: Json = False) -> None:
    """List the strategies: what robots remember, send and decide. More in docs/strategies.md."""
    _print("strategy", json=json)


def networks(*, json: Json = False) -> None:
    """List the networks: which messages arrive, and when. More in docs/networks.md."""
    _print("network", json=json)


def tasks(*, json: Json = False) -> None:
    """List the tasks: what is asked of the swarm."""
    _print("task", json=json)


def motions(*, json: Json = False) -> None:
    """List the sources of motion: where and when robots sample."""
    _print("motion", json=json)


def sensors(*, json: Json = False) -> None:
    """List the sensors: what a sample measures. More in docs/scenario.md."""
    _print("sensor", json=json)


def presets(*, json: Json = False) -> None:
    """List the presets: scenarios by name."""
    _print("preset", json=json)
