"""vibroswarm: swarms of small robots that inspect a surface and decide together what it is like.

    from vibroswarm import preset, simulate, verdict

    result = simulate(preset("paper"), seed=7)
    print(verdict(result).consensus)

The public names are those of ``__all__``; each is looked up when it is first used, so that importing the
package costs next to nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from vibroswarm.core.lazy_names import lazy_names

if TYPE_CHECKING:
    from vibroswarm.analysis.verdict import verdict
    from vibroswarm.errors import InputError, RunError
    from vibroswarm.floors.design import make_floor
    from vibroswarm.floors.difficulty import measure
    from vibroswarm.floors.floor import Floor
    from vibroswarm.motion.pose import pose
    from vibroswarm.result import Result
    from vibroswarm.run_page.write import write_run_page
    from vibroswarm.scenario.scenario import Scenario, preset
    from vibroswarm.simulation import replay, simulate
    from vibroswarm.study.spec import Study
    from vibroswarm.study.study_result import StudyResult

__all__ = [
    "Floor",
    "InputError",
    "Result",
    "RunError",
    "Scenario",
    "Study",
    "StudyResult",
    "make_floor",
    "measure",
    "pose",
    "preset",
    "replay",
    "simulate",
    "verdict",
    "write_run_page",
]

_HOME: Final = {
    "Floor": "floors.floor",
    "InputError": "errors",
    "Result": "result",
    "RunError": "errors",
    "Scenario": "scenario.scenario",
    "Study": "study.spec",
    "StudyResult": "study.study_result",
    "make_floor": "floors.design",
    "measure": "floors.difficulty",
    "pose": "motion.pose",
    "preset": "scenario.scenario",
    "replay": "simulation",
    "simulate": "simulation",
    "verdict": "analysis.verdict",
    "write_run_page": "run_page.write",
}


__getattr__ = lazy_names(__name__, _HOME)


def __dir__() -> list[str]:
    return sorted(__all__)
