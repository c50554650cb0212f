"""What robots ran with is found again in logs of simulated ones, and not where the log cannot tell."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import polars as pl
import pytest

from vibroswarm.calibrate.fit import contradictions
from vibroswarm.documents.recording import _inferred_value, write_pages
from vibroswarm.floors.floor import Floor
from vibroswarm.recordings.assemble_recording import recording_of
from vibroswarm.recordings.export import write_rugbot, write_webots
from vibroswarm.recordings.infer_settings import (
    infer_credible,
    infer_gate,
    infer_settings,
    infer_tau,
    infer_threshold,
)
from vibroswarm.recordings.inferred import Inferred
from vibroswarm.recordings.log import Log, in_order
from vibroswarm.recordings.log_readers import read_log
from vibroswarm.robot.walk import TIMERS
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import simulate


def found(told: Scenario, tmp_path: Path, **changes: Any) -> dict[str, Any]:
    scenario = told.with_values({name.replace("__", "."): value for name, value in changes.items()})
    result = simulate(scenario, 11, 2, segments=True)
    for run in (0, 1):
        write_rugbot(result, tmp_path / f"{run}.csv", run)
    logs = [in_order(read_log(tmp_path / f"{run}.csv")) for run in (0, 1)]
    return {one.name: one for one in infer_settings(logs)}


@pytest.mark.parametrize(
    ("gate", "strategy"), [("own", "none"), ("total", "positive"), ("received", "positive")]
)
def test_what_ran_is_found(told: Scenario, tmp_path: Path, gate: str, strategy: str) -> None:
    least = {"own": 60, "total": 300, "received": 240}[gate]
    settings = found(
        told, tmp_path, decision__gate=gate, decision__min_observations=least, strategy__name=strategy,
        sensor__rms_threshold=1.45, run__t_end_s=500.0,
    )  # fmt: skip
    threshold = settings["sensor.rms_threshold"]
    assert threshold.low <= 1.45 <= threshold.high + 0.0005  # energies are written to 0.001
    assert settings["strategy.name"].value == strategy, settings["strategy.name"].evidence
    tau = settings["sample.sample_interval_ms"]
    assert tau.low <= 2000 <= tau.high < tau.low + 100
    assert tau.value == 2000
    assert settings["decision.gate"].value == gate, settings["decision.gate"].evidence
    assert settings["decision.min_observations"].low <= least <= settings["decision.min_observations"].high


@pytest.mark.parametrize(
    ("low", "high", "value"), [(0.102, 0.9, 0.501), (1.549, 1.555, 1.55), (0.0015, 0.001502, 0.001501)]
)
def test_a_threshold_whose_bounds_are_far_apart_is_in_their_middle(
    low: float, high: float, value: float
) -> None:
    between = pl.DataFrame({"energy": [low / 2, low, high], "bit": [0, 0, 1]})
    assert infer_threshold(between).value == value


@pytest.mark.parametrize(("wrong", "value"), [(2, 1.5), (3, None)])
def test_a_threshold_that_more_than_2_percent_of_the_bits_contradict_is_inconclusive(
    wrong: int, value: float | None
) -> None:
    bits = [0] * 50 + [0] * wrong + [1] * (50 - wrong)
    inferred = infer_threshold(pl.DataFrame({"energy": [1.0] * 50 + [2.0] * 50, "bit": bits}))
    assert inferred.value == value
    assert f"at the best threshold {wrong} of them contradict it" in inferred.evidence


def test_one_robot_does_not_tell_the_strategy(logs: list[Path]) -> None:
    log = in_order(read_log(logs[0]))
    alone = replace(log, samples=log.samples.filter(pl.col("robot") == 1))
    strategy = next(one for one in infer_settings([alone]) if one.name == "strategy.name")
    assert strategy.value is None
    assert "of several robots" in strategy.evidence


def test_a_page_shows_no_gate_that_the_logs_do_not_show(
    logs: list[Path], ground: Floor, told: Scenario, tmp_path: Path
) -> None:
    """That of the scenario may be another than the robots'."""
    for known, stated in ((False, ()), (True, ("decision.gate", "decision.min_observations"))):
        recording = recording_of([read_log(logs[0])], ground, told, stated)
        unknown = [one | {"value": None} for one in recording.inferred]
        (page,) = write_pages(replace(recording, inferred=tuple(unknown)), tmp_path)
        assert f'"gated":{str(known).lower()}' in (tmp_path / page).read_text(encoding="utf-8")


@pytest.mark.parametrize("gate", ["own", "received", "total"])
def test_only_own_readings_can_be_the_current_sample(gate: str) -> None:
    """Two robots are sure but undecided, one decides; only the counts of ``gate`` keep them apart."""
    sent, received = {
        "own": ([9, 9, 11], [50, 50, 2]), "received": ([50, 50, 2], [9, 9, 11]), "total": ([9, 1, 6], [1, 9, 6])
    }[gate]  # fmt: skip
    samples = pl.DataFrame(
        {
            "robot": [0, 1, 2], "time_s": [1.0] * 3, "decision": [-1, -1, 1], "belief_below": [0.01] * 3,
            "sent": sent, "messages_received": received,
        }
    )  # fmt: skip
    logs = [Log("a log", "by hand", samples, tracks=pl.DataFrame())]
    kind, least = infer_gate(logs, 0.95)
    credible = infer_credible(logs, [kind, least])
    assert (credible.low, credible.high) == (0.5, pytest.approx(0.99))
    assert kind.value == gate, kind.evidence
    most = 10 if gate == "total" else 9  # of the undecided ones
    assert (least.value, least.low, least.high) == (most, most, most + 1)
    assert ("if the current sample counts" in least.evidence) is (gate != "received")


def test_where_nobody_decides_nothing_is_said_of_deciding(told: Scenario, tmp_path: Path) -> None:
    settings = found(told, tmp_path, decision__min_observations=10_000, run__t_end_s=120.0)
    assert settings["decision.gate"].value is None
    assert settings["decision.credible_threshold"].value is None
    # Before a decision positive feedback says what no feedback says.
    assert settings["strategy.name"].value != "soft"
    assert settings["strategy.name"].value is None, settings["strategy.name"].evidence


def test_clocks_that_differ_tell_no_strategy(told: Scenario, tmp_path: Path) -> None:
    """With one clock 5 s late what robots received is not what others sent, and soft feedback seems the likeliest."""
    undecided = {"decision.min_observations": 10_000, "strategy.name": "none", "run.t_end_s": 900.0}
    write_rugbot(simulate(told.with_values(undecided), 11, 1, segments=True), tmp_path / "log.csv", 0)
    log = in_order(read_log(tmp_path / "log.csv"))
    late = pl.col("time_s") + pl.when(pl.col("robot") == log.samples["robot"][0]).then(5.0).otherwise(0.0)
    samples = log.samples.with_columns(late).sort("time_s")
    said = [
        next(one for one in infer_settings([each]) if one.name == "strategy.name")
        for each in (log, replace(log, samples=samples))
    ]
    assert ["clocks differ" in one.evidence for one in said] == [False, True]
    assert said[1].value is None


def test_bits_that_are_logged_tell_threshold_and_strategy(console_logs: list[Path]) -> None:
    logs = [in_order(read_log(path)) for path in console_logs]
    settings = {one.name: one for one in infer_settings(logs)}
    assert settings["strategy.name"].value == "positive", settings["strategy.name"].evidence
    assert settings["sample.sample_interval_ms"].value == 2000


@pytest.fixture(scope="module")
def soft_logs(told: Scenario, tmp_path_factory: pytest.TempPathFactory) -> list[Log]:
    """A log of robots with soft feedback that has bits read, bits sent and posteriors."""
    path = tmp_path_factory.mktemp("soft") / "soft.txt"
    write_webots(simulate(told.with_values({"strategy.name": "soft"}), 11, 1), path)
    log = in_order(read_log(path))
    bits = (pl.col("energy") > told.sensor.rms_threshold).cast(log.samples.schema["observation"])
    return [replace(log, samples=log.samples.with_columns(observation=bits))]


def strategy_without_posteriors(logs: list[Log], is_left_out: pl.Expr) -> Inferred:
    columns = [pl.when(~is_left_out).then(name).alias(name) for name in ("alpha", "beta", "belief_below")]
    changed = [replace(log, samples=log.samples.with_columns(columns)) for log in logs]
    return {one.name: one for one in infer_settings(changed)}["strategy.name"]


def test_bits_sent_without_a_posterior_count_for_no_strategy(soft_logs: list[Log]) -> None:
    """Soft feedback cannot be tested with them; with the others it is found."""
    whole = strategy_without_posteriors(soft_logs, pl.lit(False))
    some = strategy_without_posteriors(soft_logs, pl.int_range(pl.len()) % 10 == 0)
    count, left_out = soft_logs[0].samples.height, -(-soft_logs[0].samples.height // 10)
    assert whole.value == some.value == "soft"
    assert whole.evidence.startswith(f"{count} bits sent; log likelihood none -")
    assert some.evidence.startswith(
        f"{count - left_out} bits sent ({left_out} without a posterior left out); log"
    )


def test_without_posteriors_no_strategy_is_inferred(soft_logs: list[Log]) -> None:
    found = strategy_without_posteriors(soft_logs, pl.lit(True))
    assert found.value is None
    assert "bits sent are logged, but no posterior" in found.evidence


@pytest.mark.parametrize(
    ("timer", "interval_ms"),
    [*((timer, 2000.0) for timer in TIMERS), (TIMERS[0], 3778.0)],
)
def test_the_timer_is_found(told: Scenario, tmp_path: Path, timer: str, interval_ms: float) -> None:
    changes = {
        "sample__timer": timer,
        "sample__sample_interval_ms": interval_ms,
        "sample__interrupts_avoidance": False,
    }
    inferred = found(told, tmp_path, **changes, run__t_end_s=600.0)["sample.timer"]
    assert inferred.value == timer, inferred.evidence


@pytest.mark.parametrize(
    "timer", ["reset_after_turn", "frozen_in_avoidance", "reset_at_avoidance", "hold_in_turn"]
)
def test_the_timer_is_found_where_legs_are_short(told: Scenario, tmp_path: Path, timer: str) -> None:
    """Many intervals have a turn at the end of a leg too, and are longer by it: the first was taken for the third.

    Two held turns may last as long as one turn and the time before it.
    """
    legs = {"walk__walk_duration_location_ms": 3000.0, "walk__walk_duration_scale_ms": 3000.0}
    changes = {"sample__timer": timer, "sample__sample_interval_ms": 5000.0, "run__t_end_s": 900.0}
    inferred = found(told, tmp_path, **legs, **changes)["sample.timer"]
    assert inferred.value == (None if timer == "hold_in_turn" else timer), inferred.evidence


def test_a_timer_is_not_found_where_the_log_cannot_tell(
    logs: list[Path], told: Scenario, tmp_path: Path
) -> None:
    """Avoidance that is not logged; few intervals; avoidances that may all be longer than the sample interval."""
    log = in_order(read_log(logs[0]))
    for changed, words in [
        (log.samples.with_columns(avoid_total_s=pl.lit(None, pl.Float64)), "avoidance is not logged"),
        (log.samples.filter(pl.col("time_s") < 45.0), "intervals with avoidance: too few"),
        (log.samples.filter(pl.col("time_s") < 10.0), "tau is unknown"),
    ]:
        inferred = {one.name: one for one in infer_settings([replace(log, samples=changed)])}["sample.timer"]
        assert inferred.value is None
        assert words in inferred.evidence
    short = found(told, tmp_path, sample__sample_interval_ms=500.0)["sample.timer"]
    assert (short.value, short.evidence) == (None, "tau is below 1.5 s")


def test_a_fit_warns_of_a_base_that_ran_otherwise(told: Scenario, capsys: pytest.CaptureFixture[str]) -> None:
    inferred = (
        {"name": "sample.sample_interval_ms", "value": 2000.0, "low": 1990.0, "high": 2050.0},
        {"name": "sample.timer", "value": "held_at_avoidance", "low": None, "high": None},
    )
    recording: Any = SimpleNamespace(inferred=inferred, scenario=told)
    simulated: Any = SimpleNamespace(scenario=told)  # a simulation as REAL: nothing is inferred
    ran = told.with_values({"sample.timer": "held_at_avoidance", "sample.sample_interval_ms": 2040.0})
    assert contradictions([recording, simulated], told) == [
        "sample.timer is reset_after_turn in the base, but held_at_avoidance in the recordings; "
        "add --set sample.timer=held_at_avoidance."
    ]
    assert contradictions([recording], ran) == []
    (other,) = contradictions([recording], ran.with_values({"sample.sample_interval_ms": 3000.0}))
    assert "add --set sample.sample_interval_ms=2000.0." in other
    assert contradictions([simulated], told.with_values({"swarm.robots": 9, "arena.width_m": 2.0})) == [
        f"swarm.robots is 9 in the base, but {told.swarm.robots} in the recordings; "
        f"add --set swarm.robots={told.swarm.robots}.",
        "arena.width_m is 2.0 in the base, but 1.0 in the recordings; add --set arena.width_m=1.0.",
    ]


def test_a_fit_warns_of_robots_that_it_does_not_search() -> None:
    (words,) = contradictions([], preset("e-puck"))
    assert "robot.body_radius_m 0.0355, searched from 0.004 to 0.025" in words
    assert contradictions([], preset("calibrated")) == []


def test_gates_are_inconclusive_without_beliefs(logs: list[Path]) -> None:
    log = in_order(read_log(logs[0]))
    unsure = replace(log, samples=log.samples.with_columns(belief_below=pl.lit(None, pl.Float64)))
    inferred = {one.name: one.evidence for one in infer_settings([unsure])}
    assert "decisions, beliefs or numbers of messages sent are not logged" in inferred["decision.gate"]


def test_tau_is_found_where_rows_cut_its_intervals(tmp_path: Path) -> None:
    """Rows every 0.22 s: an interval of 4.78 s is logged as 4.84 or 4.62 s, and a late row makes 5.06 s of one."""
    spacings_s = ([4.84] * 3 + [4.62]) * 30 + [5.06] * 2
    columns = {"whole": True, "spacing_s": spacings_s, "avoid_s": 0.0, "stop_s": 1.0}
    tau = infer_tau(pl.DataFrame(columns))
    assert tau.low <= 3778 <= tau.high
    assert tau.evidence.startswith("122 of 122 intervals without avoidance are 4.79")
    alike = infer_tau(
        pl.DataFrame(columns | {"spacing_s": [4.8] * 30})
    )  # less a stop of 1 s and up to 0.04 s
    assert (alike.low, alike.high) == pytest.approx((3760 - 20, 3760 + 40 + 20))
    stated = pl.DataFrame(columns | {"stop_s": pl.Series([None] * 122, dtype=pl.Float64)})
    assert infer_tau(stated, stop_s=5.0).evidence.endswith("s do not hold a stop of 5.000 s")


def test_without_a_usual_interval_there_is_no_tau(tmp_path: Path) -> None:
    """Intervals of 2, 3, 4, ... s: none is like another."""
    times = [sum(range(2, 2 + k)) for k in range(25)]
    rows = "".join(f"1,{time_s},0.5,0.5,1.0\n" for time_s in times)
    uses = ("robot", "time_s", "x_m", "y_m", "energy")
    (tmp_path / "log.csv").write_text(",".join(uses) + "\n" + rows)
    (tmp_path / "map.toml").write_text("[columns]\n" + "".join(f'{use} = "{use}"\n' for use in uses))
    log = in_order(read_log(tmp_path / "log.csv", columns=tmp_path / "map.toml"))
    tau = {one.name: one for one in infer_settings([log])}["sample.sample_interval_ms"]
    assert (tau.value, tau.low, tau.high) == (None, None, None)
    assert tau.evidence == "24 undisturbed intervals: too different from each other"


def test_an_inferred_number_has_six_digits_and_is_compared_with_all_it_has() -> None:
    value = 0.0015344999999999998
    setting = {"name": "sensor.rms_threshold", "value": value, "low": None, "high": None}
    recording = SimpleNamespace(stated=(), scenario={"sensor.rms_threshold": value})
    assert _inferred_value(recording, setting) == "0.0015345"
    assert _inferred_value(recording, setting | {"value": "soft"}) == "soft"
    recording.stated = ("sensor.rms_threshold",)
    assert _inferred_value(recording, setting) == f"0.0015345 (stated: {value})"
    recording.scenario = {"sensor.rms_threshold": 0.0015345001}
    assert "WHICH DOES NOT FIT" in _inferred_value(recording, setting)
