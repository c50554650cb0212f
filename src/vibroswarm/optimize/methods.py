"""Methods by name, all asked and told alike, all under the same account of runs."""

from __future__ import annotations

from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.batches import Random, Sobol
from vibroswarm.optimize.method import Method
from vibroswarm.optimize.pso import Pso
from vibroswarm.optimize.spec import Search


def method_of(search: Search, archive: Archive) -> Method:
    """The method that a search names, at its beginning.

    Raises:
        InputError: it needs a library that is not there.
    """
    name, starts = search.settings.method, list(search.starts)
    if name == "pso":
        return Pso(archive, search.seed, search.pso_settings, starts)
    seed, budget, evaluations = search.seed, search.search_budget, search.settings.evaluations
    if name == "random":
        return Random(archive, seed, budget, evaluations, starts)
    if name == "sobol":
        return Sobol(archive, seed, budget, evaluations, starts)
    from vibroswarm.optimize.libraries import Cmaes, OfOptuna

    if name == "cmaes":
        return Cmaes(archive, seed, budget, evaluations, starts)
    return OfOptuna(archive, seed, budget, evaluations, starts, name)


def check_libraries(search: Search) -> None:
    """Tell what is missing before a folder is made.

    Raises:
        InputError: the method or Optuna's storage needs a library that is not there, or the method other fields.
    """
    method_of(search, Archive(search.space, search.objectives))
    if search.has_dashboard:
        from vibroswarm.optimize.libraries import optuna

        optuna("search.dashboard")
