"""Search for good parameters: spaces, objectives, methods, and validation on fresh runs.

The names below are imported when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from vibroswarm.core.lazy_names import lazy_names

if TYPE_CHECKING:
    from vibroswarm.inference.outcome_arrays import Outcomes
    from vibroswarm.optimize.grid import Grid, scores_of, truth_of_grid
    from vibroswarm.optimize.loop import Found, run_search
    from vibroswarm.optimize.objective import Objective
    from vibroswarm.optimize.pso import PsoSettings
    from vibroswarm.optimize.scenario_comparison import compare_scenarios
    from vibroswarm.optimize.search_report import best_scenario, write_report
    from vibroswarm.optimize.sensitivity import ped_anova, sobol_indices
    from vibroswarm.optimize.simulate_outcomes import outcomes_of
    from vibroswarm.optimize.space import Space
    from vibroswarm.optimize.spec import Search, SearchSettings
    from vibroswarm.optimize.validation import Front, Truth, front_of, truth_of

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
    "Front": "validation",
    "Grid": "grid",
    "Objective": "objective",
    "Outcomes": "evaluate",
    "PsoSettings": "pso",
    "Search": "spec",
    "SearchSettings": "spec",
    "Space": "space",
    "Truth": "validation",
    "best_scenario": "search_report",
    "compare_scenarios": "scenario_comparison",
    "front_of": "validation",
    "outcomes_of": "simulate_outcomes",
    "ped_anova": "sensitivity",
    "run_search": "loop",
    "scores_of": "grid",
    "sobol_indices": "sensitivity",
    "truth_of": "validation",
    "truth_of_grid": "grid",
    "write_report": "search_report",
}

__getattr__ = lazy_names(__name__, _HOME)


def __dir__() -> list[str]:
    return sorted(__all__)
