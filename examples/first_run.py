"""A first run in Python: simulate an inspection, say the verdict, keep tables and the page that plays it back.

python examples/first_run.py [FOLDER]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from vibroswarm import preset, simulate, verdict, write_run_page


def main(folder: Path) -> None:
    """One run of the paper's setting with soft feedback, kept in ``folder``."""
    scenario = preset("paper").with_values({"strategy.name": "soft"})
    result = simulate(scenario, seed=2, poses=True)
    found = verdict(result)
    print(f"consensus: {found.consensus}, after {found.consensus_time_s} s")
    for robot in found.robots:
        print(
            f"robot {robot.robot}: decision {robot.decision}, estimate of the fill ratio {robot.estimate:.3f}"
        )

    last = result.inference.group_by("robot", maintain_order=True).last()
    print(last.select("robot", "sample", "alpha", "beta", "belief_below"))
    result.write(folder)
    write_run_page(result, folder / "run.html")
    print(f"kept in {folder}; open {folder / 'run.html'} in a browser")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "folder", type=Path, nargs="?", default="out/first-run", help="default: out/first-run"
    )
    main(parser.parse_args().folder)
