"""A recording of robots, and what each strategy would have decided on these very observations.

python examples/replay_recording.py [DRAWS]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from vibroswarm import Floor, preset
from vibroswarm.floors import read_tiles
from vibroswarm.lab.replay import logged_outcomes, replay_recording, session_outcomes
from vibroswarm.recordings.assemble_recording import recording_of
from vibroswarm.recordings.read import read_log
from vibroswarm.recordings.threshold import find_threshold


def main(draws: int) -> None:
    """The small recordings of ``examples/lab``, which are simulated and stand for yours."""
    lab = Path(__file__).with_name("lab")
    logs = [read_log(lab / f"session-{number}.csv") for number in (1, 2)]
    ran = {"decision.gate": "own", "decision.min_observations": 12, "strategy.name": "positive"}
    scenario = preset("paper").with_values(ran)
    recording = recording_of(logs, Floor.filling(read_tiles(lab / "floor.txt")), scenario, list(ran))
    for session in logged_outcomes(recording):
        print(f"session {session.session}, as it ran: {session.consensus}, {session.undecided:.0%} undecided")

    for strategy in ("none", "positive", "soft"):
        replayed = replay_recording(
            recording, recording.scenario.with_values({"strategy.name": strategy}), draws=draws
        )
        for session in session_outcomes(recording, replayed):
            print(f"session {session.session}, {strategy}: {session.decision_time_s:.1f} s on average")

    found = find_threshold(recording)
    print(f"threshold by {found.rule}: {found.value:.2f} [{found.low:.2f}, {found.high:.2f}]")
    print(f"  {found.decidable.says}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "draws", type=int, nargs="?", default=50, help="replays, each with other losses; default: 50"
    )
    main(parser.parse_args().draws)
