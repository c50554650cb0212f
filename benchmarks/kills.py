"""Commands killed at random moments and given again leave what they leave when nobody kills them: the long check.

    python benchmarks/kills.py [--kills 96] [--ctrl-c] [--seed 1] [--only run optimize ...]

Each command that writes a folder (or a file) is begun and killed (SIGKILL) at a random moment of its whole time, or
right when something new appears in its folder; then it is begun again, and so on, up to ``ROUND`` kills; at last it is
let finish. What then counts is the outcome of the round:

    equal     the same tables, bit by bit, as of the command left alone, no hidden file and no process left
    refused   exit code 2 or 1 with one sentence, no traceback, in any of the beginnings
    other     anything else: other tables, a traceback, something left over, a command that hangs

With ``--ctrl-c`` the signal is that of Ctrl-C, after which the command must end with exit code 130 and say so.

Studies are also begun by threads and by processes, and until a precision. A round that is refused is shown with its
sentence. Exit code 1 where any round ended otherwise. The control: a table changed by hand must be found.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import polars as pl

from vibroswarm.study.study_result import StudyResult

ROUND = 4
"""Kills before a command is let finish."""
STARTS_S = 1.0
"""Time in which Python and the package are loaded, on a machine that does much else."""
LONGEST_S = 600.0
"""What takes longer hangs."""
ROOT = Path(__file__).parents[1]
MAIN = [sys.executable, "-m", "vibroswarm"]

STUDY = """
seed = 5
{length}
[scenario.run]
t_end_s = 120.0
[scenario.decision]
min_observations = 5
[grid]
"swarm.robots" = [2, 4]
"floor.source" = ["random:0.44", "diagonal:0.46"]
"strategy.name" = ["none", "positive"]
"""
SEARCH = """
seed = 3
[scenario.run]
t_end_s = 100.0
[scenario.swarm]
robots = 2
[space]
"sample.sample_interval_ms" = {{ from = 1000, to = 6000 }}
"decision.min_observations" = {{ from = 0, to = 60 }}
{more}
[search]
method = "{method}"
budget = {budget}
"""


@dataclass(frozen=True)
class Attacked:
    """A command, and what of its folder is compared."""

    name: str
    words: Sequence[str]
    out: str
    """Last word but one is ``--out``; where it writes, below the round's folder."""
    again: Sequence[str] = ()
    """What is added when it is given again, where something may be there already."""
    compared: Sequence[str] = ("*.parquet", "*.csv", "*.toml")
    study: bool = False
    """Whether its tables are those of a study, in shards that may be cut otherwise."""


def commands(folder: Path, runs: int) -> list[Attacked]:
    """What is attacked; its inputs are written into a folder."""
    lab = ROOT / "examples" / "lab"
    study, until = folder / "study.toml", folder / "until.toml"
    study.write_text(STUDY.format(length=f"runs = {runs}"))
    until.write_text(STUDY.format(length=f'until = "2%"\nmax_runs = {runs}'))
    swarm = "[pso]\nparticles = 4\nevaluations = 3\nextra = 3"
    for method, more in (("pso", swarm), ("tpe", "")):
        text = SEARCH.format(method=method, more=more, budget=runs if method == "pso" else runs // 2)
        (folder / f"{method}.toml").write_text(text)
    sessions = [str(lab / f"session-{k}.csv") for k in (1, 2)]
    numbers = ["--no-pictures", "--no-confirm"]
    sweep = ["evaluate", str(study), *numbers, "--workers", "2"]
    drawn = ["evaluate", str(study), "--runs", "40", "--no-confirm", "--pictures"]
    short = [
        "--set",
        "run.t_end_s=120",
        "--strategy",
        "none,soft",
        "--robots",
        "2",
        "--patterns",
        "diagonal,stripe",
    ]
    few = str(max(runs // 10, 4))
    league = ["league", "--runs", few, "--belief-runs", few, "--fault-runs", few, "--untuned", *short]
    tune = ["league", "tune", "--runs", "5", "--points", "8", *short]
    detect = ["detect", "--runs", few, "--robots", "2", "--set", "run.t_end_s=120", "--no-pictures"]
    searched = ["--fresh", "50", "--no-pictures", "--workers", "2"]
    search = ("best.toml", "candidates.csv", "history.csv", "steps/*.parquet", "fresh/*.parquet")
    imported = ["lab", "import", *sessions, "--floor", str(lab / "floor.txt"), "--tiles", "5x5"]
    return [
        Attacked("run", ["run", "--seed", "4"], "run", ["--force"]),
        Attacked("sweep", sweep, "sweep", study=True),
        Attacked("sweep, processes", [*sweep, "--executor", "processes"], "processes", study=True),
        Attacked("sweep until", ["evaluate", str(until), *numbers], "until", study=True),
        Attacked("sweep, drawn", drawn, "drawn", study=True),
        Attacked("evaluate", ["evaluate", "--runs", str(runs), *numbers], "evaluate", study=True),
        Attacked("optimize pso", ["optimize", str(folder / "pso.toml"), *searched], "pso", compared=search),
        Attacked("optimize tpe", ["optimize", str(folder / "tpe.toml"), *searched], "tpe", compared=search),
        Attacked("league", league, "league", study=True, compared=("*.csv",)),
        Attacked("tune", tune, "tuned.toml", ["--force"], compared=()),
        Attacked("detect", detect, "detect", study=True),
        Attacked("inspect", ["inspect", "--set", "run.t_end_s=120", "--no-pictures"], "inspect"),
        Attacked("reproduce", ["reproduce", "--only", "difficulty", "fill-ratios", "--columns", "paper",
                               "--runs", "40"], "paper", compared=("items/*/*.parquet", "tables/*.csv")),
        Attacked("lab import", imported, "lab", ["--force"]),
        Attacked("calibrate fit", ["calibrate", "fit", str(folder / "recording"), "--candidates", "200"],
                 "fitted.toml", compared=()),
    ]  # fmt: skip


@dataclass
class Round:
    """What came of one round."""

    kills: int = 0
    refused: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)

    @property
    def outcome(self) -> str:
        """In one word."""
        return "other" if self.wrong else "refused" if self.refused else "equal"


def line(command: Attacked, out: Path, again: bool) -> list[str]:
    """The command as it is given."""
    return [*MAIN, *command.words, *(command.again if again else ()), "--out", str(out)]


def entries(folder: Path) -> int:
    """Files below a folder and hidden ones beside it, roughly: they come and go."""
    with suppress(OSError):
        return sum(1 for _ in folder.parent.rglob("*"))
    return 0


def begun(words: Sequence[str], sessions: set[int]) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        words, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    sessions.add(process.pid)
    return process


def kill_once(words: Sequence[str], out: Path, takes_s: float, dice: random.Random, round_: Round,
              sessions: set[int], stop: signal.Signals) -> None:  # fmt: skip
    """Begin, and kill at some moment: of the whole time, or just after something was written."""
    process, before = begun(words, sessions), entries(out)
    # Python itself answers Ctrl-C with a traceback before the program has begun.
    least_s = STARTS_S if stop == signal.SIGINT else 0.0
    until_s = time.monotonic() + least_s + dice.random() * max(takes_s - least_s, 0.0)
    on_change = dice.random() < 0.7
    while process.poll() is None and (on_change or time.monotonic() < until_s):
        if on_change and time.monotonic() > until_s and entries(out) != before:
            break
        time.sleep(0.002)
    if on_change:
        time.sleep(dice.random() ** 3 * 0.1)
    if process.poll() is None:
        process.send_signal(stop)
        round_.kills += 1
    try:
        told = process.communicate(timeout=LONGEST_S)[1]
    except subprocess.TimeoutExpired:
        process.kill()
        told = process.communicate()[1]
        round_.wrong.append(f"did not end in {LONGEST_S:g} s")
    note(process.returncode, told, round_)


def note(code: int, told: str, round_: Round) -> None:
    """Note what a command said that was not killed and did not end well."""
    if code in (0, -9):
        return
    if code == 130 and "Traceback" not in told and "interrupted" in told:
        return
    last = told.strip().splitlines()[-1] if told.strip() else f"exit code {code}, no word"
    clear = code in (1, 2) and "Traceback" not in told and "error: " in last
    (round_.refused if clear else round_.wrong).append(last)


def attack(
    command: Attacked, place: Path, alone: Path, takes_s: float, dice: random.Random, stop: signal.Signals
) -> Round:
    """One round: kills, then the command is let finish, and compared."""
    place.mkdir()
    out, round_, sessions = place / command.out, Round(), set[int]()
    for _ in range(ROUND):
        kill_once(line(command, out, out.exists()), out, takes_s, dice, round_, sessions, stop)
    last = begun(line(command, out, out.exists()), sessions)
    try:
        told = last.communicate(timeout=LONGEST_S)[1]
    except subprocess.TimeoutExpired:
        last.kill()
        last.communicate()
        round_.wrong.append(f"hung for {LONGEST_S:g} s")
        return round_
    note(last.returncode, told, round_)
    if last.returncode == 0:
        round_.wrong += [f"{what} differs" for what in differing(command, alone, out)]
    round_.wrong += [f"left over: {path.relative_to(place)}" for path in place.rglob(".*")]
    time.sleep(1.0)  # workers end with the process that began them
    if count := still_there(sessions):
        round_.wrong.append(f"{count} processes left")
    return round_


def differing(command: Attacked, alone: Path, out: Path) -> list[str]:
    """What is not equal."""
    if alone.is_file():
        return [] if alone.read_bytes() == out.read_bytes() else [out.name]
    if command.study:
        mine, theirs = StudyResult.open(out), StudyResult.open(alone)
        found = [what for what in ("robots", "runs", "cells") if not same(mine, theirs, what)]
        names = {path.name for path in (*alone.glob("*.csv"), *out.glob("*.csv"))}
        summed = sorted(name for name in names if not same_file(alone / name, out / name))
        return [*found, *summed, *mine.store.damaged, *(str(one) for one in mine.store.failures)]
    names = {
        path.relative_to(root) for root in (alone, out) for one in command.compared for path in root.glob(one)
    }
    assert names, "nothing is compared"
    return sorted(str(name) for name in names if not same_file(alone / name, out / name))


def same(mine: StudyResult, theirs: StudyResult, table: str) -> bool:
    a, b = (getattr(result, table) for result in (mine, theirs))
    a, b = (one() if callable(one) else one for one in (a, b))
    return bool(a.equals(b, null_equal=True))


def same_file(a: Path, b: Path) -> bool:
    if not (a.is_file() and b.is_file()):
        return False
    if a.suffix == ".parquet":
        return pl.read_parquet(a).equals(pl.read_parquet(b), null_equal=True)
    return a.read_bytes() == b.read_bytes()


def still_there(sessions: set[int]) -> int:
    """Processes of these sessions that live."""
    count = 0
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, _, _, session, *_ = path.read_text().rpartition(")")[2].split()
            count += int(session) in sessions and state != "Z"
    return count


def control(command: Attacked, alone: Path, folder: Path) -> bool:
    """Whether a table that was changed is found: the comparison can fail."""
    changed = folder / "changed"
    shutil.copytree(alone, changed)
    path = next(changed.rglob("robots.parquet"))
    frame = pl.read_parquet(path)
    frame.with_columns(pl.col("decision") + 1).write_parquet(path)
    return bool(differing(command, alone, changed))


def main() -> int:
    """Attack every command."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=96, help="in all, at least (default 96)")
    parser.add_argument("--runs", type=int, default=2000, help="of each cell and search (default 2000)")
    parser.add_argument(
        "--ctrl-c", action="store_true", help="interrupt as Ctrl-C does, in the place of killing"
    )
    parser.add_argument("--seed", type=int, default=1, help="of the moments")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="only commands whose names begin so")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="kills-") as name:
        return attack_all(Path(name), options)


def attack_all(folder: Path, options: argparse.Namespace) -> int:
    """Attack all commands in turn until the wanted number of kills; report how each round ended."""
    stop = signal.SIGINT if options.ctrl_c else signal.SIGKILL
    dice, rounds, kills = random.Random(options.seed), Counter[tuple[str, str]](), Counter[str]()
    chosen = [
        one for one in commands(folder, options.runs)
        if not options.only or one.name.startswith(tuple(options.only))
    ]  # fmt: skip
    lab = next(one for one in commands(folder, options.runs) if one.name == "lab import")
    subprocess.run(line(lab, folder / "recording", False), check=True, stdout=subprocess.DEVNULL)
    times = {one.name: alone_s(one, folder) for one in chosen}
    good = True
    if any(one.name == "run" for one in chosen):
        run = next(one for one in chosen if one.name == "run")
        good = control(run, folder / "alone" / run.out, folder)
        print(f"control, a table changed by hand: {'found' if good else 'NOT FOUND'}", flush=True)
    number = 0
    while sum(kills.values()) < options.kills:
        for command in chosen:
            number += 1
            place = folder / f"round {number}"
            made = attack(command, place, folder / "alone" / command.out, times[command.name], dice, stop)
            kills[command.name] += made.kills
            rounds[command.name, made.outcome] += 1
            for words in {*made.refused, *made.wrong}:
                print(f"{command.name}: {made.outcome}: {words}", flush=True)
            shutil.rmtree(place)
    for command in chosen:
        told = ", ".join(f"{rounds[command.name, one]} {one}" for one in ("equal", "refused", "other"))
        print(f"{command.name}: killed {kills[command.name]} times while at work; rounds: {told}", flush=True)
    counted = Counter(
        {one: sum(n for (_, o), n in rounds.items() if o == one) for one in ("equal", "refused", "other")}
    )
    print(json.dumps({"kills": sum(kills.values()), "rounds": dict(counted)}))
    good = good and not counted["other"]
    print("good" if good else "FAILED")
    return 0 if good else 1


def alone_s(command: Attacked, folder: Path) -> float:
    """Seconds that it takes when nobody kills it; what it leaves is kept beside."""
    out = folder / "alone" / command.out
    out.parent.mkdir(exist_ok=True)
    began_s = time.monotonic()
    done = subprocess.run(line(command, out, False), capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{command.name}, left alone, failed: {done.stderr}")
    return time.monotonic() - began_s


if __name__ == "__main__":
    os.environ.setdefault("PYTHONPATH", str(ROOT / "src"))
    sys.exit(main())
