"""``vibroswarm scenario``: write a scenario as TOML, with every field."""

from __future__ import annotations

from vibroswarm.cli.deliver import print_saved_file
from vibroswarm.cli.options import Force, OutFile, ScenarioOptions
from vibroswarm.cli.scenario_options import scenario_from
from vibroswarm.core.atomic_io import write_file


def scenario(*, out: OutFile = None, force: Force = False, scenario: ScenarioOptions) -> None:
    """Write a scenario as TOML, with every field, to edit and run again; to the terminal without --out.

    example:
      vibroswarm scenario --robots 8 --out mine.toml; vibroswarm run --scenario mine.toml
    """
    wanted = scenario_from(scenario)
    if out is None:
        print(wanted.to_toml(), end="")
        return
    write_file(out, wanted.to_toml(), replace=force)
    print_saved_file(out, f"scenario {wanted.hash}")
