"""A floor of your own: made or read, measured, asked whether it can be decided at all, inspected.

python examples/own_floor.py [RUNS]
"""

from __future__ import annotations

import argparse

import numpy as np

from vibroswarm import Floor, make_floor, measure, preset, simulate
from vibroswarm.statistics.decidability import decidability
from vibroswarm.statistics.figures import summary


def main(runs: int) -> None:
    """Two floors of one fill ratio, one in large patches and one in small ones."""
    patchy = make_floor(10, 10, fill_ratio=0.44, moran_index=0.7).tiles
    spread = make_floor(10, 10, fill_ratio=0.44, moran_index=-0.3).tiles
    for name, tiles in (("patchy", patchy), ("spread", spread)):
        scenario = preset("paper").with_values({"floor.tiles": tiles, "floor.source": name})
        hard = measure(tiles)
        print(f"{name}: Moran index {hard.moran_index:.2f}, entropy {hard.entropy:.2f}")
        print(decidability(scenario).says)
        result = simulate(scenario, seed=1, runs=runs)
        found = summary(result.robots, result.runs, t_end_s=1200.0)
        for figure in ("swarm_right", "swarm_wrong", "swarm_incomplete"):
            share = found[figure]
            print(f"  {figure}: {share.estimate:.2f} [{share.low:.2f}, {share.high:.2f}]")

    cut = Floor(np.eye(4, dtype=np.uint8), tile_width_m=0.3, tile_height_m=0.3, name="larger than the arena")
    print(f"{cut.name}: of what lies inside 1 m x 1 m {cut.fill_ratio_within(1.0, 1.0):.3f} vibrates")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", type=int, nargs="?", default=200, help="default: 200")
    main(parser.parse_args().runs)
