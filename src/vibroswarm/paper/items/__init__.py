"""The items of the paper, one or two in a module, and their registry."""

from __future__ import annotations

from functools import cache

from vibroswarm.errors import check_choice
from vibroswarm.paper.item import Item


@cache
def all_items() -> tuple[Item, ...]:
    """Return all items, in the paper's order."""
    # Imported here, so that importing this package does not load the modules of all items.
    from vibroswarm.paper.items import (
        calibration,
        example_run,
        experiment_accuracy,
        experiments,
        feedback,
        fill_ratios_and_sizes,
        patterns,
        search,
        side_claims,
    )

    return (
        patterns.DIFFICULTY,
        calibration.ITEM,
        search.SEARCH,
        feedback.GRID,
        fill_ratios_and_sizes.FILL_RATIOS,
        fill_ratios_and_sizes.SWARM_SIZES,
        patterns.FIVE_PATTERNS,
        experiments.ITEM,
        example_run.ITEM,
        side_claims.ITEM,
        feedback.SHARING,
        experiment_accuracy.ITEM,
    )


def items_named(names: list[str] | None) -> tuple[Item, ...]:
    """Return the items with these names, in the paper's order; all items if ``names`` is None.

    Underscores in names count as hyphens.

    Raises:
        InputError: a name is not the name of an item.
    """
    known = {item.name: item for item in all_items()}
    if names is None:
        return all_items()
    requested = [name.replace("_", "-") for name in names]
    for name in requested:
        check_choice(name, "--only", known)
    return tuple(item for item in all_items() if item.name in requested)
