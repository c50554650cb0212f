"""The variant of ``places`` for the options that are on: its hooks, arrays and size of messages.

The options are parameters of ``places``: ``energies`` and ``draws``, with hooks of ``place_samples``, and
``share_map``, with hooks of ``place_summaries``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from threading import Lock
from types import ModuleType
from typing import Any, Final

from vibroswarm.errors import InputError
from vibroswarm.strategies import place_samples, place_summaries
from vibroswarm.strategies.base import MAX_BYTES, Strategy, array
from vibroswarm.strategies.static_analysis import STRATEGY_HOOKS

TWELVE_BITS: Final = 4095
"""Largest coordinate in mm that 12 bits hold."""
_making: Final = Lock()
"""Held while a variant is made: two threads would make two, and compile each."""


def with_options(places: Strategy, p: Any, sizes: Mapping[str, int]) -> Strategy:
    """Return the variant of ``places`` for parameters of which at least one option is on.

    Args:
        p: ``places.Params``. sizes: "tiles", number of tiles, and "longest_mm", longer side of the arena; both 0 to
            check only which options go together.
    Raises:
        InputError: options do not go together, ``draws`` is 1, or a message would be too large.
    """
    field = f"strategy.{places.name}"
    if p.rate_pairs:  # with the options there are no maps by pair of rates
        on = next(name for name in ("energies", "draws", "share_map") if getattr(p, name))
        raise InputError(f"does not go with {on}; leave one out", field=f"{field}.rate_pairs")
    if p.draws == 1:
        raise InputError(
            "1 draw does not show how uncertain the place is; give 2 to 4, or 0 for mean and spread",
            field=f"{field}.draws",
        )
    if p.share_map and p.draws:
        raise InputError("does not go with share_map; leave one out", field=f"{field}.draws")
    size = message_bytes(p, sizes)
    if size > MAX_BYTES:
        raise InputError(
            f"a map of {sizes['tiles']} tiles takes {size} bytes; a message has {MAX_BYTES}",
            field=f"{field}.share_map",
        )
    # Without draws there is one map, by mean places.
    with _making:
        return _variant(places, p.share_map, max(p.draws, 1), size)


def message_bytes(p: Any, sizes: Mapping[str, int]) -> int:
    """Return the size of a message in bytes, as the modules of the options list its parts.

    Args:
        p: ``places.Params``. sizes: "tiles", number of tiles, and "longest_mm", longer side of the arena.
    """
    if p.share_map:
        return place_summaries.HEADER_BYTES + sizes["tiles"]
    if p.draws:  # sender with bit, number and two spreads; x and y of each draw; the log ratio
        return 4 + 4 * int(p.draws) + int(p.energies)
    # With energies x and y have 12 bits each, so that the log ratio fits into 8 bytes, if the arena is small enough.
    return 9 if p.energies and sizes["longest_mm"] > TWELVE_BITS else 8


@cache
def _variant(places: Strategy, share_map: bool, maps: int, size: int) -> Strategy:
    """Return ``places`` with the hooks and arrays of an option's module, ``maps`` maps and messages of ``size`` bytes.

    It is cached so that runs with the same options share one strategy, and with it the compiled code.
    """
    module: ModuleType = place_summaries if share_map else place_samples
    # The size of ``odds`` depends on the number of maps, so the array is declared here, in a class made for it.
    arrays = type("Arrays", (module.Arrays,), {"odds": array("float64", f"{maps}*robots*tiles")})
    # A hook that the module does not have is set to None, so that the hook of ``places`` is not used.
    changed: dict[str, Any] = {hook: getattr(module, hook, None) for hook in STRATEGY_HOOKS}
    changed |= {"state": module.State, "message": module.Message, "arrays": arrays}
    return replace(places, **changed, bytes_on_air=size, reads_details=True)
