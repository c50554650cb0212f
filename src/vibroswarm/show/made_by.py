"""How results were made, as texts by name for ``Document.made_by``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence


def versions_in_words(made_by: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Return the versions that made a result, numbered if there are several.

    Args:
        made_by: the different ``simulation.versions``, which have the version of each part of the software.
    """
    return {
        "made by" if len(made_by) == 1 else f"made by ({number})": ", ".join(
            f"{name} {version}" for name, version in versions.items()
        )
        for number, versions in enumerate(made_by, start=1)
    }
