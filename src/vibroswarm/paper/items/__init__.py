"""The items of the paper, each a module of its own, and their registry."""

from __future__ import annotations

from functools import cache

from vibroswarm.errors import InputError, nearest
from vibroswarm.paper.item import Item


@cache
def all_items() -> tuple[Item, ...]:
    """Return all items, in the paper's order."""
    from vibroswarm.paper.items import (
        calibration,
        difficulty,
        example_run,
        experiment_accuracy,
        experiments,
        feedback_grid,
        fill_ratios,
        headline,
        hidden_threshold,
        patterns,
        readings,
        search,
        search_repeats,
        sharing,
        side_claims,
        swarm_sizes,
        timer,
    )

    modules = (
        difficulty,
        calibration,
        search,
        feedback_grid,
        fill_ratios,
        swarm_sizes,
        patterns,
        experiments,
        example_run,
        readings,
        side_claims,
        headline,
        sharing,
        search_repeats,
        timer,
        experiment_accuracy,
        hidden_threshold,
    )
    return tuple(module.ITEM for module in modules)


def items_named(names: list[str] | None) -> tuple[Item, ...]:
    """Return the items of these names in the paper's order; all if None.

    Raises:
        InputError: there is no such item.
    """
    known = {item.name: item for item in all_items()}
    if names is None:
        return all_items()
    requested = [name.replace("_", "-") for name in names]
    for name in requested:
        if name not in known:
            raise InputError(
                f"there is no item '{name}'{nearest(name, known)} (there are {', '.join(known)})",
                field="--only",
            )
    return tuple(item for item in all_items() if item.name in requested)
