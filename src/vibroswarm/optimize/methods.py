"""Methods by name, all asked and told alike, all under the same account of runs."""

from __future__ import annotations

from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.method import Method
from vibroswarm.optimize.pso import Pso
from vibroswarm.optimize.spec import Search


def method_of(search: Search, archive: Archive) -> Method:
    """The method that a search names, at its beginning.

    Raises:
        InputError: it needs a library that is not there.
    """
    return Pso(archive, search.seed, search.pso_settings, list(search.starts))
