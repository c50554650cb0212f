"""Measure what places decide, beside soft feedback on the same motion and readings.

    python benchmarks/places_outcomes.py --out out/places

measures every case of ``places_cases.py``, about an hour of one core, and prints the tables. A case that
OUT holds is not measured again, so that a measurement that was cut off goes on. ``--tables reached,patterns`` and
``--cases "poor gyro"`` measure some, ``--runs`` and ``--seed`` others than ``places_cases.RUNS``.

A cell: mean decision time in s (end of the run if undecided)/% of robots wrong, with the half-width of its 95 %
interval (the run is the unit)/% undecided. Forced: % whose belief at the end of the run is on the wrong side, decided
or not, of soft and of the last column, over all floors of the case. Less: % wrong of the last column less that of soft,
over all floors, paired by run, with its 95 % interval. What a case has as "felt"
robots are not told. The grid is known, but for the table of grids.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from places_cases import ALIKE, COLUMNS, ROWS, RUNS, TABLES, Case
from vibroswarm.core.atomic_io import write_file
from vibroswarm.core.tables import csv_bytes
from vibroswarm.inference.deliveries import Timeline, timeline_of
from vibroswarm.inference.replay import replay_to_end
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.motion.source import moved as motion_of
from vibroswarm.observation.observe import observe
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import OF_MOTION, floors_of

Array = NDArray[np.float64]
SOFT = "soft"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, help="of each cell")
    parser.add_argument("--seed", type=int)
    parser.add_argument("--out", type=Path, required=True, help="folder of one CSV file per case")
    parser.add_argument("--tables", default=",".join(TABLES), help="separated by commas")
    parser.add_argument("--cases", help="separated by semicolons; default: all of these tables")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for table in given.tables.split(","):
        cases, runs, seed = TABLES[table], given.runs or RUNS[table][0], given.seed or RUNS[table][1]
        names = [name for name in cases if given.cases is None or name in given.cases.split(";")]
        files = []
        for name, case in cases.items():
            of_name = "".join(sign if sign.isalnum() else "_" for sign in name)
            file = given.out / f"{table}-{runs}-{seed}-{of_name}.csv"
            if name in names and not file.exists():
                print(f"{table}: {name}", flush=True)
                write_file(file, csv_bytes(measured(name, case, runs, seed)))
            files += [file] if file.exists() else []
        if files:
            print(markdown(pl.concat([pl.read_csv(file) for file in files]), table), flush=True)


def measured(name: str, case: Case, runs: int, seed: int) -> pl.DataFrame:
    """Return a row per setting and floor of a case."""
    base = preset(case.preset).with_values(
        {"strategy.name": "places", "localisation.method": "mixture", "strategy.places.variance_factor": 1.0}
        | case.values
    )
    timeline = moved(base, runs, seed)
    wrong: dict[str, list[Array]] = {}
    forced: dict[str, list[Array]] = {}
    rows: list[dict[str, Any]] = []
    for floor_source in case.floors:
        floor = base.with_values({"floor.source": floor_source} | case.felt)
        readings = read(floor, runs, seed)
        truth = int(float(floor_source.partition(":")[2]) > base.decision.decision_boundary)
        for label in (SOFT, *case.rows):
            values = {"strategy.name": SOFT} if label == SOFT else ROWS[label]
            told = {"floor.source": case.values.get("floor.source", floor_source)}
            scenario = base.with_values(told | values)
            agents = ended(scenario, floor, runs, seed, timeline, readings)
            decision = agents["decision"].reshape(runs, -1)
            time_s = np.where(agents["decision"] == -1, base.run.t_end_s, agents["decided_s"])
            side = agents["belief"].reshape(runs, -1) <= 0.5
            wrong.setdefault(label, []).append((decision == 1 - truth).mean(axis=1))
            forced.setdefault(label, []).append((side != truth).mean(axis=1))
            less = wrong[label][-1] - wrong[SOFT][-1]
            rows.append(
                {
                    "case": name,
                    "row": label,
                    "floor": floor_source,
                    "runs": runs,
                    "seed": seed,
                    "time_s": time_s.mean(),
                    **percent("wrong", wrong[label][-1]),
                    "undecided": 100.0 * (decision == -1).mean(),
                    **percent("forced", forced[label][-1]),
                    **percent("less", less),
                }
            )
    for label in (SOFT, *case.rows):
        both = [np.concatenate(of[label]) for of in (wrong, forced)]
        less = both[0] - np.concatenate(wrong[SOFT])
        mine = [row for row in rows if row["row"] == label]
        means = {key: float(np.mean([row[key] for row in mine])) for key in ("time_s", "undecided")}
        shares = percent("wrong", both[0]) | percent("forced", both[1]) | percent("less", less)
        rows.append(
            {"case": name, "row": label, "floor": "all", "runs": runs, "seed": seed, **means, **shares}
        )
    return pl.DataFrame([{key: row[key] for key in rows[0]} for row in rows])


def moved(scenario: Scenario, runs: int, seed: int) -> Timeline:
    """Return the motion of some runs, the same object for cases that move alike."""
    key = repr((runs, seed, [getattr(scenario, section) for section in OF_MOTION]))
    if key not in _moved:
        _moved.clear()
        _read.clear()
        motion = motion_of("event", scenario, seed, range(runs), True)
        _moved[key] = (motion, timeline_of(scenario, motion))
    return _moved[key][1]


def read(floor: Scenario, runs: int, seed: int) -> NDArray[np.uint8]:
    """Return the readings on a floor; the motion is that of the last call of ``moved``."""
    key = repr((runs, seed, floor.floor, floor.sensor, floor.faults))
    if key not in _read:
        ((motion, _),) = _moved.values()
        floors = floors_of(floor, seed, list(range(runs)))
        _read[key] = observe(floor, seed, motion.samples, floors, energies=False)["observation"].to_numpy()
    return _read[key]


def ended(
    scenario: Scenario, floor: Scenario, runs: int, seed: int, timeline: Timeline, readings: NDArray[np.uint8]
) -> NDArray[np.void]:
    """Return the robots at the end; soft feedback on the same motion and readings is computed once."""
    if scenario.strategy.name != SOFT:
        return replay_to_end(scenario, seed, timeline, readings).agents.copy()
    sections = (*OF_MOTION, "floor", "sensor", "faults", "network")
    key = repr((runs, seed, [getattr(floor, name) for name in sections]))
    if key not in _soft:
        _soft[key] = replay_to_end(scenario, seed, timeline, readings).agents.copy()
    return _soft[key]


_moved: dict[str, tuple[Motion, Timeline]] = {}
_read: dict[str, NDArray[np.uint8]] = {}
_soft: dict[str, NDArray[np.void]] = {}


def percent(name: str, of_runs: Array) -> dict[str, float]:
    """Return the mean of a share over runs in %, and the half-width of its 95 % interval."""
    return {
        name: 100.0 * float(of_runs.mean()),
        f"{name}_half": 196.0 * float(of_runs.std()) / of_runs.size**0.5,
    }


def markdown(found: pl.DataFrame, table: str) -> str:
    """Return a table of what was measured, a line per case and floor: the first of those that are alike."""
    columns = COLUMNS[table]
    shown = columns[-1]
    head = ["case", "f", *columns, "forced", "less"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for name in dict.fromkeys(found["case"].to_list()):
        of_case = found.filter(case=name)
        of_all = {row["row"]: row for row in of_case.filter(floor="all").iter_rows(named=True)}
        soft, last = of_all[SOFT], of_all[shown]
        tail = [
            f"{soft['forced']:.1f}; {last['forced']:.1f}",
            f"{last['less']:+.1f}+-{last['less_half']:.1f}",
        ]
        floors = [each for each in of_case["floor"].unique(maintain_order=True) if each != "all"]
        for floor in floors[:1] if table in ALIKE else floors:
            cells = {row["row"]: cell(row) for row in of_case.filter(floor=floor).iter_rows(named=True)}
            first = [name, floor.partition(":")[2].lstrip("0")]
            lines.append(
                "| " + " | ".join([*first, *(cells.get(label, "") for label in columns), *tail]) + " |"
            )
            name, tail = "", [""] * len(tail)
    runs = sorted({f"{row[0]} runs a cell, seed {row[1]}" for row in found.select("runs", "seed").rows()})
    return "\n".join([", ".join(runs) + ":", "", *lines]) + "\n"


def cell(row: dict[str, float]) -> str:
    """Return the words of one row."""
    return f"{row['time_s']:.0f}/{row['wrong']:.1f}+-{row['wrong_half']:.1f}/{row['undecided']:.0f}"


if __name__ == "__main__":
    main()
