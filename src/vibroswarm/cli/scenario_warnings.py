"""Warnings about probable mistakes in scenarios, each printed once a command.

Every command clears what an earlier command of the same process has printed, so this module imports nothing that
simulations need: ``vibroswarm --help`` loads it too.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

from vibroswarm.cli.terminal import say

if TYPE_CHECKING:
    from vibroswarm.scenario.scenario import Scenario

MOST: Final = 3
"""How many warnings are printed at once; a study may have one in each of many cells."""
_printed: Final[set[str]] = set()
"""Warnings that ``warn_of`` has printed or counted during this command."""


def forget() -> None:
    """Forget the printed warnings, since a new command starts in the same process."""
    _printed.clear()


def warn_of(scenarios: Iterable[Scenario]) -> None:
    """Print on stderr the first ``MOST`` new warnings about these scenarios, and how many others there are.

    A warning is new if this command has not printed or counted it yet.
    """
    from vibroswarm.analysis.claimed_rates import claims_warnings
    from vibroswarm.motion.robot_params import scenario_warnings
    from vibroswarm.observation.edge_response import edge_warnings
    from vibroswarm.observation.energy_model import sensor_warnings
    from vibroswarm.scenario.change_fields import change_warnings
    from vibroswarm.scenario.fault_fields import fault_warnings

    texts = dict.fromkeys(  # each different warning once, in order
        text
        for scenario in scenarios
        for text in (
            *scenario_warnings(scenario),
            *fault_warnings(scenario.faults, scenario.swarm.robots),
            *edge_warnings(scenario),
            *change_warnings(scenario.change, scenario.run.t_end_s, _is_final(scenario)),
            *sensor_warnings(scenario.sensor),
            *claims_warnings(scenario),
        )
    )
    new = [text for text in texts if text not in _printed]
    _printed.update(new)
    for text in new[:MOST]:
        say(f"Warning: {text}.")
    if len(new) > MOST:
        say(f"Warnings that are not printed: {len(new) - MOST}.")


def _is_final(scenario: Scenario) -> bool:
    """Return whether robots keep their decisions; False for a strategy whose code is not loaded."""
    from vibroswarm import strategies

    known = strategies.known().get(scenario.strategy.name)
    if known is None or known.decides == "opinion" or scenario.task.name == "changed":
        return False
    return not (known.revises and scenario.decision.revise)
