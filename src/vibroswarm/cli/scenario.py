"""``vibroswarm scenario``: write a scenario as TOML, with every field."""

from __future__ import annotations

from vibroswarm.cli.options import Force, OutFile, ScenarioOptions


def scenario(*, out: OutFile = None, force: Force = False, scenario: ScenarioOptions) -> None:
    """Write a scenario as TOML, with every field, to edit and run again; to the terminal without --out.

    example:
      vibroswarm scenario --robots 8 --out mine.toml; vibroswarm run --scenario mine.toml
    """
    from vibroswarm.cli.scenario_options import scenario_from
    from vibroswarm.core.atomic_io import whole_file

    made = scenario_from(scenario)
    if out is None:
        print(made.to_toml(), end="")
        return
    with whole_file(out, replace=force) as part:
        part.write_text(made.to_toml(), encoding="utf-8")
    print(f"Saved: {out} (scenario {made.hash})")
