"""Measure what docs/figures/vibration.md claims of vibration as physics, and print its tables as Markdown.

python benchmarks/vibration.py hold LAB      # how long motors keep their amplitude, by recordings (lab import)
"""

from __future__ import annotations

import argparse
import math
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray
from sklearn.neighbors import KNeighborsClassifier

from vibroswarm import Scenario, preset, simulate
from vibroswarm.analysis.intervals import wilson_limits
from vibroswarm.analysis.map_scores import map_scores
from vibroswarm.calibrate.dataset import dataset_of
from vibroswarm.calibrate.fit_camera import fit_camera
from vibroswarm.calibrate.fit_vibration import FIELDS, _Simulator, facts_of, relative_misfit
from vibroswarm.calibrate.vibration_facts import fact_samples, facts
from vibroswarm.paper.claims import CANNOT
from vibroswarm.paper.columns import scenario_of
from vibroswarm.paper.item import Settings
from vibroswarm.paper.reproduce import all_items, reproduce
from vibroswarm.recordings.recording import read_result
from vibroswarm.result import Result
from vibroswarm.sensors import Samples, sensor
from vibroswarm.sensors.base import STUDY_GRID

PHYSICS = "physics"
CASES: tuple[tuple[str, str, float, dict[str, Any]], ...] = (
    *(("paper", name, at, {}) for name in ("none", "positive", "soft") for at in (1.33, 1.55)),
    *(("calibrated", name, 1.33, {}) for name in ("none", "soft", "places")),
    (
        "calibrated",
        "places",
        1.33,
        {"strategy.places.variance_factor": 2.0, "localisation.method": "mixture"},
    ),
    ("paper", "places", 1.33, {}),
    # Robots that assume the error rates that the physics has at least 2 cm from another kind.
    (
        "calibrated",
        "places",
        1.33,
        {"decision.assumed_false_positive": 0.035, "decision.assumed_false_negative": 0.103},
    ),
)
"""Presets, strategies, theta_E and further fields."""
FILLS = (0.48, 0.52)
BATCH = 50
"""Runs that are simulated together."""
CLAIMED = (
    "feedback-grid",
    "fill-ratios",
    "swarm-sizes",
    "patterns",
    "example-run",
    "readings",
    "side-claims",
)
"""Items of the reproduction whose claims depend on readings, and need no recordings."""
HOLDS_S = (0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0)


def hold(lab: Path) -> None:
    """Print the correlations of scatter over the time for which motors keep their amplitude, and the misfit."""
    seen = dataset_of([read_result(lab)])
    found = seen.corrected(fit_camera(seen).camera)
    rows = np.arange(found.samples.height)
    print(
        "| `motor_hold_s` | misfit | correlation of successive samples | of two robots within 5 s |\n|---|---|---|---|"
    )
    for hold_s in HOLDS_S:
        base = preset("paper").with_values(
            {"sensor.model": "acceleration", "sensor.acceleration.motor_hold_s": hold_s}
        )
        values = {name: getattr(base.sensor.params, name) for name in FIELDS}
        by_name = {fact.name: fact for fact in facts_of(_Simulator(found, base), values)}
        simulator = _Simulator(found, base)
        misfit = relative_misfit(simulator.simulated(values, rows), simulator.recorded(rows))
        pairs = ("successive samples of a robot", "two robots within 5 s")
        own = [
            [by_name[f"{kind}: correlation of {words}"] for kind in ("vibrating", "still")] for words in pairs
        ]
        cells = [", ".join(f"{fact.simulated:.2f} +- {fact.spread:.2f}" for fact in of) for of in own]
        print(f"| {hold_s:g} s | {100 * misfit:.1f} % | {cells[0]} | {cells[1]} |")
    cells = [", ".join(f"{fact.recorded:.2f}" for fact in of) for of in own]
    print(f"| recorded | | {cells[0]} | {cells[1]} |")
    for words, places in (("as the camera saw them", seen), ("corrected", found)):
        recorded = facts(fact_samples(places), places.samples["energy"].to_numpy(), 1.33)
        beside = [f"{name}: {value:.2f}" for name, value in recorded.items() if "within 5 mm" in name]
        print(f"places {words}: {'; '.join(beside)}")


def laws(runs: int, seed: int) -> None:
    """Print what robots decide, and how well their maps are, with laws of energies and with physics."""
    print(
        "| preset, strategy, fill ratio, theta_E | sensor | wrong | undecided | time, s | Brier at 300, 1200 s | AUC "
        "at 300 s |"
    )
    print("|---" * 7 + "|")
    for name, strategy, threshold, more in CASES:
        told = f" ({', '.join(f'{field} = {value}' for field, value in more.items())})" if more else ""
        for fill in FILLS:
            values = {
                "strategy.name": strategy, "sensor.rms_threshold": threshold, "floor.source": f"random:{fill}"
            } | more  # fmt: skip
            words = f"`{name}`, `{strategy}`{told}, {fill}, {threshold}"
            for control in (None, PHYSICS):
                scenario = scenario_of(name, values, control=control)
                found = all_runs(scenario, seed, runs, fill)
                if strategy == "places":
                    short = all_runs(scenario.with_values({"run.t_end_s": 300.0}), seed, runs, fill)
                    found = found.with_columns(brier_300=short["brier"], auc_300=short["auc"])
                print(f"| {words} | {control or 'laws'} | {cells_of(found)} |", flush=True)
                words = ""


def all_runs(scenario: Scenario, seed: int, runs: int, fill: float) -> pl.DataFrame:
    """Simulate runs, and return their rows (``of_runs``)."""
    batches = [range(k, min(k + BATCH, runs)) for k in range(0, runs, BATCH)]
    return pl.concat([of_runs(simulate(scenario, seed, batch), fill) for batch in batches])


def of_runs(result: Result, fill: float) -> pl.DataFrame:
    """Return a row for each run: shares of robots, their mean time, and the scores of their maps (null: no maps)."""
    right = int(fill > result.scenario.decision.decision_boundary)
    undecided = pl.col("decision") == -1
    robots = result.robots.with_columns(
        wrong=(pl.col("decision") == 1 - right).cast(pl.Float64),
        undecided=undecided.cast(pl.Float64),
        time_s=pl.when(undecided).then(result.scenario.run.t_end_s).otherwise(pl.col("decision_time_s")),
    )
    runs = robots.group_by("run").agg(pl.col("wrong", "undecided", "time_s").mean()).sort("run")
    if result.scenario.strategy.name != "places":
        return runs
    return runs.hstack(pl.DataFrame([map_of(result, run) for run in runs["run"].to_list()]))


def map_of(result: Result, run: int) -> dict[str, float]:
    """Return the mean scores of the robots' maps at the end of a run."""
    floor = result.floor(run)
    maps = result.reports.filter(run=run, name="p").sort("robot", "index")["value"].to_numpy()
    scores = [map_scores(one, floor) for one in maps.reshape(-1, floor.tiles.size)]
    return {name: float(np.mean([score[name] for score in scores])) for name in ("brier", "auc")}


def cells_of(runs: pl.DataFrame) -> str:
    """Return the cells of a row of a table, +- one standard error over runs."""

    def cell(name: str, factor: float, decimals: int) -> str:
        if name not in runs.columns:
            return ""
        values = factor * runs[name].to_numpy()
        return f"{values.mean():.{decimals}f} +- {values.std(ddof=1) / values.size**0.5:.{decimals}f}"

    maps = [cell(name, 1.0, 4) for name in ("brier_300", "brier", "auc_300")]
    undecided = f"{100 * float(np.mean(runs['undecided'].to_numpy())):.1f} %"
    briers = ", ".join(filter(None, maps[:2]))
    return f"{cell('wrong', 100.0, 1)} % | {undecided} | {cell('time_s', 1.0, 0)} | {briers} | {maps[2]}"


def claims(runs: int, seed: int, out: Path) -> None:
    """Print the verdicts on claims of the paper with laws of energies and with physics."""
    items = [item for item in all_items() if item.name in CLAIMED]
    found = {
        control: reproduce(
            Settings(runs, seed, ("paper",), control), out / (control or "laws"), items
        ).decided
        for control in (None, PHYSICS)
    }
    print("| claim | laws | physics |\n|---|---|---|")
    for one, other in zip(found[None], found[PHYSICS], strict=True):
        print(f"| {one.claim.statement} | {measured(one)} | {measured(other)} |")


def measured(decided: Any) -> str:
    """Return a verdict with the range of what was measured."""
    values = decided.cells["estimate"].drop_nulls()
    if values.is_empty() or decided.verdict == CANNOT:
        return str(decided.verdict)
    return f"{decided.verdict}: {values.min():.3g} to {values.max():.3g}"


MOTORS: dict[str, tuple[tuple[float, ...], tuple[int, ...], float]] = {
    "motors of 70, 105, 150 Hz": ((70.0, 105.0, 150.0), (1, 2, 3), 0.0),
    "still, motors of 90 and 140 Hz": ((90.0, 140.0), (0, 1, 2), 1.0),
}
"""Motors, the kinds on the floor, and theta_E."""
DISTANCES_CM = (0.0, 1.0, 2.0, 3.0, 5.0, 100.0)
TIMES_MS = (50.0, 200.0, 500.0)
NUMBERS = ("peak_hz", "band_90", "band_140", "variance", "kurtosis")


class Labelled(NamedTuple):
    """Samples at random places of random floors of 5 x 5 tiles, (samples,) each."""

    kind: NDArray[np.int64]
    """Of the tile below."""
    distance_m: NDArray[np.float64]
    """To the nearest tile of another kind."""
    read: NDArray[np.int64]
    """Kind that a robot reads."""
    values: NDArray[np.float64]
    """(samples, numbers)."""


def labelled(name: str, floors: int, seed: int = 5, **fields: Any) -> Labelled:
    """Return 200 samples on each of some floors, with further fields of ``sensor.acceleration``."""
    motor_hz, kinds, threshold = MOTORS[name]
    own = {
        f"sensor.acceleration.{field}": value for field, value in ({"motor_hz": motor_hz} | fields).items()
    }
    base = {"sensor.model": "acceleration", "sensor.rms_threshold": threshold}
    several = {"strategy.name": "dirichlet", "task.name": "majority"}
    params, model = Scenario().with_values(several | base | own).sensor.params, sensor("acceleration")
    rng, number, parts = np.random.default_rng(seed), np.arange(200), []
    for run in range(floors):
        tiles = rng.permutation(np.resize(kinds, 25)).astype(np.uint8)
        x_m, y_m = rng.random(200), rng.random(200)
        place = (STUDY_GRID, tiles, x_m, y_m, 3.0 * number)
        values = model.sensed(Samples(*place, robot=number, sample=number, seed=seed, run=run), params)
        below = tiles[(4 - (y_m / 0.2).astype(int)) * 5 + (x_m / 0.2).astype(int)].astype(np.int64)
        parts.append((below, to_other_m(tiles, below, x_m, y_m), model.classes(values, params), values))
    return Labelled(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def to_other_m(
    tiles: NDArray[np.uint8], below: NDArray[np.int64], x_m: NDArray[np.float64], y_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the distance of places from the nearest tile of another kind than is below, m."""
    row, column = np.divmod(np.arange(25), 5)
    away = [
        np.maximum(np.abs(at_m[:, None] - 0.2 * (index + 0.5)) - 0.1, 0.0)
        for at_m, index in ((x_m, column), (y_m, 4 - row))
    ]
    distance_m = np.where(tiles == below[:, None], np.inf, np.hypot(*away))
    return np.asarray(distance_m.min(axis=1))


def kinds(floors: int) -> None:
    """Print shares of samples read right, and confusion matrices, over distance to another kind and time."""
    for name, (_, there, _) in MOTORS.items():
        found = {time_ms: labelled(name, floors, signal_ms=time_ms) for time_ms in TIMES_MS}
        print(
            f"\n{name}\n\n| time | "
            + " | ".join(f"{a:g} to {b:g} cm" for a, b in pairwise(DISTANCES_CM))
            + " |"
        )
        print("|---" * len(DISTANCES_CM) + "|")
        for time_ms, of in found.items():
            cells = [limits((of.read == of.kind)[near(of, *ends)]) for ends in pairwise(DISTANCES_CM)]
            print(f"| {time_ms:g} ms | " + " | ".join(cells) + " |")
        print("\n| time | distance | kind | " + " | ".join(f"read as {kind}" for kind in there) + " |")
        print("|---" * (3 + len(there)) + "|")
        for time_ms, of in found.items():
            for ends in ((0.0, 1.0), (1.0, 3.0), (3.0, 100.0)):
                for kind in there:
                    rows = near(of, *ends) & (of.kind == kind)
                    cells = [limits(of.read[rows] == read) for read in there]
                    print(
                        f"| {time_ms:g} ms | {ends[0]:g} to {ends[1]:g} cm | {kind} | "
                        + " | ".join(cells)
                        + " |"
                    )


def near(of: Labelled, low_cm: float, high_cm: float) -> NDArray[np.bool_]:
    """Return which samples are at such a distance from another kind."""
    return (of.distance_m >= 0.01 * low_cm) & (of.distance_m < 0.01 * high_cm)


def limits(is_so: NDArray[np.bool_]) -> str:
    """Return a share in % with its 95 % interval."""
    low, high = wilson_limits(int(is_so.sum()), is_so.size)
    return f"{100 * is_so.mean():.1f} [{100 * float(low):.1f}, {100 * float(high):.1f}]"


def axes(floors: int) -> None:
    """Print shares of samples read right at least 3 cm from another kind, by axis of the signal."""
    names = ("magnitude", "x", "y", "z")
    print("| kinds | `lateral` | " + " | ".join(names) + " |\n" + "|---" * 6 + "|")
    for name in MOTORS:
        for lateral in (0.1, 1.0, 3.0):
            of_axes = [labelled(name, floors, lateral=lateral, axis=axis) for axis in names]
            cells = [limits((of.read == of.kind)[near(of, 3.0, 100.0)]) for of in of_axes]
            print(f"| {name} | {lateral:g} | " + " | ".join(cells) + " |", flush=True)


def best(floors: int) -> None:
    """Print how often still tiles and two motors can be told at best, 3 cm or more from another kind.

    A rule by the nearest of samples with known kinds gets at least so many right; the best of all rules by the same
    numbers gets at most the share that Cover and Hart's bound leaves (IEEE Trans. Inf. Theory 13, 1967): with c kinds
    and the error r of the nearest one, its error is at least (c - 1)/c (1 - sqrt(1 - c r/(c - 1))).
    """
    of = labelled("still, motors of 90 and 140 Hz", floors, features=NUMBERS)
    rows = near(of, 3.0, 100.0)
    numbers = np.log(np.maximum(of.values[rows], 1e-6))
    numbers = (numbers - numbers.mean(axis=0)) / numbers.std(axis=0)
    kind, read, half = of.kind[rows], of.read[rows], rows.sum() // 2
    print(f"robots: {limits(read[half:] == kind[half:])}")
    for names, chosen in (("bands", [0, 2, 3]), ("all", list(range(numbers.shape[1])))):
        for samples in (half // 8, half // 2, half):
            own = numbers[half - samples : half, chosen], kind[half - samples : half]
            cells = []
            for neighbours in (1, 10, 40, 160):
                rule = KNeighborsClassifier(neighbours).fit(*own)
                cells.append(limits(rule.predict(numbers[half:, chosen]) == kind[half:]))
                if neighbours == 1:
                    error = 1.0 - rule.score(numbers[half:, chosen], kind[half:])
            least = (1.0 - math.sqrt(1.0 - 1.5 * error)) * 2.0 / 3.0
            print(
                f"{names}, {samples} known samples: {', '.join(cells)}; at best {100 * (1.0 - least):.1f}",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="table", required=True)
    commands.add_parser("hold", help=hold.__doc__).add_argument("lab", type=Path)
    for table in (kinds, axes, best):
        command = commands.add_parser(table.__name__, help=(table.__doc__ or "").splitlines()[0])
        command.add_argument("--floors", type=int, default=120)
    for table in (laws, claims):
        command = commands.add_parser(table.__name__, help=table.__doc__)
        command.add_argument("--runs", type=int, default=400)
        command.add_argument("--seed", type=int, default=11)
    command.add_argument("--out", type=Path, required=True)
    given = vars(parser.parse_args())
    tables = (hold, laws, claims, kinds, axes, best)
    {table.__name__: table for table in tables}[given.pop("table")](**given)


if __name__ == "__main__":
    main()
