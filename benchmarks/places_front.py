"""Measure and draw time against error of places and of all rivals, each at several settings, on the same motion.

    python benchmarks/places_front.py --runs 150 --seed 9401 --out out/front     measure, if OUT does not hold it
    python benchmarks/places_front.py --draw out/front --picture docs/images/places-front

5 robots of the paper, 1200 s, floors of 12 and 13 vibrating tiles of 25 at random. Settings are those by which each
strategy trades time against error (``analysis/fronts.toml``), besides its preset. Error: % of robots that are wrong,
or undecided and on the wrong side at the end ("forced"). **Places are told the grid**; rivals count readings.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from html import escape
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vibroswarm.analysis.forced_error import front_of, front_settings
from vibroswarm.core.atomic_io import write_file
from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import InputError
from vibroswarm.inference.deliveries import timeline_of
from vibroswarm.inference.replay import replay_to_end
from vibroswarm.motion.source import source
from vibroswarm.observation.observe import observe
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import floors_of
from vibroswarm.strategies import strategy

FLOORS = (("random:0.48", 0), ("random:0.52", 1))
TRUE = {"localisation.method": "true"}
MIXTURE = {"localisation.method": "mixture"}
PLAYERS: dict[str, tuple[str, dict[str, Any]]] = {
    **{
        f"places{told}, v = {v}": ("places", values | {"strategy.places.variance_factor": float(v)})
        for told, values in (("", MIXTURE), (", true places", TRUE))
        for v in (1, 2, 3)
    },
    **{
        name: (name, {})
        for name in ("soft", "totals", "positive", "none", "asdf", "bayes_cpf", "bayes_bots", "dbbs", "mcp",
                     "distrust", "dc", "dmvd", "dmmd", "three_valued")
    },
    "field": ("field", MIXTURE | {"strategy.field.min_samples": 100}),
}  # fmt: skip
"""Strategy and fixed settings by the name of the curve."""


def settings_of(name: str, base: Scenario) -> Iterator[tuple[str, Scenario]]:
    """Yield the settings of a curve in words, with their scenarios."""
    of, fixed = PLAYERS[name]
    base = base.with_values({"strategy.name": of} | fixed)
    yield "preset", base
    fields = {key: values for key, values in front_settings().get(of, {}).items() if key not in fixed}
    for values in product(*fields.values()):
        chosen = dict(zip(fields, values, strict=True))
        try:
            scenario = base.with_values(chosen)
        except InputError:  # a setting that this scenario refuses
            continue
        yield ", ".join(f"{key.rpartition('.')[2]} {value:g}" for key, value in chosen.items()), scenario


def measure(runs: int, seed: int, out: Path) -> None:
    base, motion = preset("paper"), None
    for name in PLAYERS:
        file = out / f"{name.replace(', ', '-').replace(' = ', '')}.csv"
        if file.exists():
            continue
        if motion is None:
            motion = source("event").batch(base, seed, range(runs), False, True)
            timeline, read = timeline_of(base, motion), {}
            for floor_source, _ in FLOORS:
                floor = base.with_values({"floor.source": floor_source})
                floors = floors_of(floor, seed, list(range(runs)))
                readings = observe(floor, seed, motion.samples, floors, energies=False)["observation"]
                read[floor_source] = readings.to_numpy()
        rows = []
        for words, scenario in settings_of(name, base):
            times, errors, sent = [], [], []
            for floor_source, truth in FLOORS:
                agents = replay_to_end(scenario, seed, timeline, read[floor_source]).agents
                open_ = agents["decision"] == -1
                side = np.where(open_, agents["belief"] <= 0.5, agents["decision"])
                times.append(np.where(open_, base.run.t_end_s, agents["decided_s"]).mean())
                errors.append((side != truth).reshape(runs, -1).mean(axis=1))
                sent.append(agents["sent"].mean() * strategy(scenario.strategy.name).bytes_on_air)
            error = np.concatenate(errors)
            rows.append(
                {
                    "curve": name,
                    "setting": words,
                    "runs": runs,
                    "seed": seed,
                    "time_s": round(float(np.mean(times)), 1),
                    "forced_error": round(100.0 * float(error.mean()), 2),
                    "half": round(196.0 * float(error.std()) / error.size**0.5, 2),
                    "bytes_sent": round(float(np.mean(sent))),
                }
            )
        write_file(file, csv_bytes(pl.DataFrame(rows)))
        print(f"{name}: {len(rows)} settings", flush=True)


WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 760, 470, 56, 150, 40, 48
LAST_S, MOST = 1200.0, 50.0
STYLE = """
svg { --back: #ffffff; --ink: #1a1a1a; --grid: #dddddd; --rival: #8a8a8a; --places: #0a5fa5; --true: #6aa9dd;
      --soft: #b4470d; --field: #2e7d32; }
@media (prefers-color-scheme: dark) {
  svg { --back: #15181c; --ink: #e8e8e8; --grid: #33383e; --rival: #8f969e; --places: #5db3ff; --true: #2f78b3;
        --soft: #ff9a5c; --field: #7bd37f; } }
text { font: 12px sans-serif; fill: var(--ink); } polyline { fill: none; stroke-width: 1.6; }
.grid { stroke: var(--grid); } .title { font-weight: 600; font-size: 14px; }
"""


def colour(name: str) -> str:
    if name.startswith("places"):
        return "true" if "true" in name else "places"
    return name if name in ("soft", "field") else "rival"


def place(time_s: float, error: float) -> tuple[float, float]:
    x = LEFT + (WIDTH - LEFT - RIGHT) * time_s / LAST_S
    return x, HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * min(error, MOST) / MOST


def draw(found: pl.DataFrame) -> str:
    """Return the picture: a line for each curve through its best settings."""
    parts = [f'<rect width="{WIDTH}" height="{HEIGHT}" style="fill:var(--back)"/>']
    title = "Grid known: time against error, 5 robots, 12 or 13 of 25 tiles vibrate"
    parts.append(f'<text class="title" x="{LEFT}" y="22">{title}</text>')
    for error in range(0, int(MOST) + 1, 10):
        (x, y), (end, _) = place(0.0, error), place(LAST_S, error)
        parts.append(f'<line class="grid" x1="{x}" y1="{y:.1f}" x2="{end}" y2="{y:.1f}"/>')
        parts.append(f'<text x="{x - 8}" y="{y + 4:.1f}" text-anchor="end">{error}</text>')
    for time_s in range(0, int(LAST_S) + 1, 200):
        (x, y), (_, end) = place(time_s, 0.0), place(time_s, MOST)
        parts.append(f'<line class="grid" x1="{x:.1f}" y1="{y}" x2="{x:.1f}" y2="{end}"/>')
        parts.append(f'<text x="{x:.1f}" y="{y + 18}" text-anchor="middle">{time_s}</text>')
    middle = 0.5 * (LEFT + WIDTH - RIGHT)
    parts.append(f'<text x="{middle}" y="{HEIGHT - 8}" text-anchor="middle">mean decision time, s</text>')
    parts.append(
        f'<text transform="translate(14 {HEIGHT / 2}) rotate(-90)" text-anchor="middle">robots wrong, % '
        "(undecided: by their side at the end)</text>"
    )
    labels: list[tuple[float, float, str, str]] = []
    for name in reversed(list(dict.fromkeys(found["curve"].to_list()))):
        mine = found.filter(curve=name)
        x, y = front_of(mine["time_s"].to_numpy(), mine["forced_error"].to_numpy())
        points = [place(a, b) for a, b in zip(x, y, strict=True)]
        ink = f"var(--{colour(name)})"
        line = " ".join(f"{a:.1f},{b:.1f}" for a, b in points)
        dash = {"1": "", "2": "6 3", "3": "2 3"}.get(name[-1], "")
        parts.append(f'<polyline points="{line}" style="stroke:{ink}" stroke-dasharray="{dash}"/>')
        parts += [f'<circle cx="{a:.1f}" cy="{b:.1f}" r="2.5" style="fill:{ink}"/>' for a, b in points]
        labels.append((points[-1][1], points[-1][0], name, ink))
    labels.sort()
    heights = [y + 4.0 for y, *_ in labels]
    for k in range(1, len(heights)):
        heights[k] = max(heights[k], heights[k - 1] + 13.0)
    heights[-1] = min(heights[-1], HEIGHT - BOTTOM + 4.0)
    for k in range(len(heights) - 2, -1, -1):
        heights[k] = min(heights[k], heights[k + 1] - 13.0)
    for low, (y, x, name, ink) in zip(heights, labels, strict=True):
        parts.append(f'<text x="{WIDTH - RIGHT + 10}" y="{low:.1f}" style="fill:{ink}">{escape(name)}</text>')
        parts.append(
            f'<line x1="{x:.1f}" y1="{y:.1f}" x2="{WIDTH - RIGHT + 7}" y2="{low - 4:.1f}" '
            f'style="stroke:{ink};stroke-width:0.4"/>'
        )
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" '
        f'height="{HEIGHT}" role="img"><title>{title}</title><style>{STYLE}</style>'
    )
    return head + "\n" + "\n".join(parts) + "\n</svg>\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=150)
    parser.add_argument("--seed", type=int, default=9401)
    parser.add_argument("--out", type=Path, help="folder of one CSV file per curve")
    parser.add_argument("--draw", type=Path, help="draw what this folder holds")
    parser.add_argument("--picture", type=Path, help="path of the picture, without .svg")
    given = parser.parse_args()
    if given.out is not None:
        given.out.mkdir(parents=True, exist_ok=True)
        measure(given.runs, given.seed, given.out)
    if given.draw is not None and given.picture is not None:
        files = {file.name: pl.read_csv(file) for file in given.draw.glob("*.csv")}
        found = pl.concat([files[name] for name in sorted(files)])
        order = {name: k for k, name in enumerate(PLAYERS)}
        found = found.sort(pl.col("curve").replace_strict(order), maintain_order=True)
        write_file(given.picture.with_suffix(".csv"), csv_bytes(found))
        write_file(given.picture.with_suffix(".svg"), draw(found))


if __name__ == "__main__":
    main()
