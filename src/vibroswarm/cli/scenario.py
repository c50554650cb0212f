"""``vibroswarm scenario``: write a scenario as TOML, with every field."""

from __future__ import annotations

from vibroswarm.cli.deliver import print_saved_file, print_text
from vibroswarm.cli.options import Force, OutFile, ScenarioOptions
from vibroswarm.cli.scenario_options import scenario_from
from vibroswarm.core.atomic_io import write_file


def scenario(*, out: OutFile = None, force: Force = False, scenario: ScenarioOptions) -> None:
    """Write a scenario as TOML, with every field, to edit and run again; to the terminal without --out.

    With --preset, it begins with the preset's comment: what the preset is, and its sources.

    example:
      vibroswarm scenario --robots 8 --out mine.toml; vibroswarm run --scenario mine.toml
    """
    from vibroswarm.scenario.presets import preset_text
    from vibroswarm.scenario.scenario import preset

    made = scenario_from(scenario)
    text = made.to_toml()
    if scenario.preset is not None:
        changed = "" if made == preset(scenario.preset) else "# Made from this preset, with other values:\n"
        comment = preset_text(scenario.preset).partition("\n[")[0]
        text = f"{changed}{comment}\n{text}"
    if out is None:
        print_text(text)
        return
    write_file(out, text, replace=force)
    print_saved_file(out, f"scenario {made.hash}")
