"""Searching for good parameters: spaces, objectives, methods that ask and are told, and what is true afterwards.

The names below are looked up when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from vibroswarm.lazy import lazy_names

if TYPE_CHECKING:
    from vibroswarm.inference.cost_outcomes import Outcomes
    from vibroswarm.optimize.check import compare_scenarios
    from vibroswarm.optimize.fronts import Front, front_of
    from vibroswarm.optimize.grid import Grid, scores_of, truth_of_grid
    from vibroswarm.optimize.importance import ped_anova
    from vibroswarm.optimize.loop import Found, run_search
    from vibroswarm.optimize.objective import Objective
    from vibroswarm.optimize.pso import PsoSettings
    from vibroswarm.optimize.report import best_scenario, write_report
    from vibroswarm.optimize.sensitivity import sobol_indices
    from vibroswarm.optimize.simulate_runs import outcomes_of
    from vibroswarm.optimize.space import Space
    from vibroswarm.optimize.spec import Search, SearchSettings
    from vibroswarm.optimize.truth import Truth, truth_of

__all__ = [
    "Found",
    "Front",
    "Grid",
    "Objective",
    "Outcomes",
    "PsoSettings",
    "Search",
    "SearchSettings",
    "Space",
    "Truth",
    "best_scenario",
    "compare_scenarios",
    "front_of",
    "outcomes_of",
    "ped_anova",
    "run_search",
    "scores_of",
    "sobol_indices",
    "truth_of",
    "truth_of_grid",
    "write_report",
]

_HOME: Final = {
    "Found": "loop",
    "Front": "fronts",
    "Grid": "grid",
    "Objective": "objective",
    "Outcomes": "evaluate",
    "PsoSettings": "pso",
    "Search": "spec",
    "SearchSettings": "spec",
    "Space": "space",
    "Truth": "truth",
    "best_scenario": "report",
    "compare_scenarios": "check",
    "front_of": "fronts",
    "outcomes_of": "simulate_runs",
    "ped_anova": "importance",
    "run_search": "loop",
    "scores_of": "grid",
    "sobol_indices": "sensitivity",
    "truth_of": "truth",
    "truth_of_grid": "grid",
    "write_report": "report",
}

__getattr__ = lazy_names(__name__, _HOME)


def __dir__() -> list[str]:
    return sorted(__all__)
