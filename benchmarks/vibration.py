"""Measure what docs/figures/vibration.md claims of vibration as physics, and print its tables as Markdown.

python benchmarks/vibration.py hold LAB      # how long motors keep their amplitude, by recordings (lab import)
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from vibroswarm.calibrate.dataset import dataset_of
from vibroswarm.calibrate.fit_camera import fit_camera
from vibroswarm.calibrate.fit_vibration import FIELDS, _Simulator, facts_of, relative_misfit
from vibroswarm.recordings.recording import read_result
from vibroswarm.scenario.scenario import preset

HOLDS_S = (0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0)


def hold(lab: Path) -> None:
    """Print the correlations of scatter over the time for which motors keep their amplitude, and the misfit."""
    found = dataset_of([read_result(lab)])
    found = found.corrected(fit_camera(found).camera)
    rows = np.arange(found.samples.height)
    print(
        "| `motor_hold_s` | misfit | correlation of successive samples | of two robots within 5 s |\n|---|---|---|---|"
    )
    for hold_s in HOLDS_S:
        base = preset("paper").with_values(
            {"sensor.model": "acceleration", "sensor.acceleration.motor_hold_s": hold_s}
        )
        values = {name: getattr(base.sensor.params, name) for name in FIELDS}
        facts = {fact.name: fact for fact in facts_of(found, base, values)}
        simulator = _Simulator(found, base)
        misfit = relative_misfit(simulator.simulated(values, rows), simulator.recorded(rows))
        pairs = ("successive samples of a robot", "two robots within 5 s")
        own = [
            [facts[f"{kind}: correlation of {words}"] for kind in ("vibrating", "still")] for words in pairs
        ]
        cells = [", ".join(f"{fact.simulated:.2f} +- {fact.spread:.2f}" for fact in of) for of in own]
        print(f"| {hold_s:g} s | {100 * misfit:.1f} % | {cells[0]} | {cells[1]} |")
    cells = [", ".join(f"{fact.recorded:.2f}" for fact in of) for of in own]
    print(f"| recorded | | {cells[0]} | {cells[1]} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="table", required=True)
    commands.add_parser("hold", help=hold.__doc__).add_argument("lab", type=Path)
    given = vars(parser.parse_args())
    {"hold": hold}[given.pop("table")](**given)


if __name__ == "__main__":
    main()
