"""Checks of the law and of places: what cannot be made is said, and what samples feel is what is drawn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

from helpers.documents import ROOT
from helpers.inspections import drawn_samples
from vibroswarm import inspect, preset
from vibroswarm.documents.damage import not_certified
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.floors.io import read_tiles
from vibroswarm.inspection.checks import PLACES, _statistics, law_checks
from vibroswarm.inspection.damage import drawn_values, tiles_below, values_at
from vibroswarm.inspection.laws import hash_of_run, law_for_session, law_of_measured
from vibroswarm.inspection.others import Others, by_patches, by_tiles
from vibroswarm.inspection.patches import declared, shares_of
from vibroswarm.inspection.samples import Law, Samples, read_by
from vibroswarm.inspection.stopping import Question
from vibroswarm.inspection.tile_map import felt_on
from vibroswarm.observation.decision_boundary import grid_of
from vibroswarm.observation.energy_model import error_rates
from vibroswarm.recordings.assemble_recording import recording_of
from vibroswarm.recordings.read import read_log

EXAMPLE = ROOT / "examples" / "inspection"
LAW = Law(preset("paper").sensor, "preset paper")


def swapped(path: Path) -> Path:
    text = (EXAMPLE / "reference.csv").read_text()
    text = text.replace("still", "?").replace("vibrating", "still").replace("?", "vibrating")
    (path / "swapped.csv").write_text(text)
    return path / "swapped.csv"


def outcomes(samples: Samples, others: Others | None = None) -> dict[str, str]:
    checks = law_checks(samples, others or by_tiles(samples), drawn=199)
    return dict(zip(checks["check"], checks["outcome"], strict=True))


@pytest.mark.usefixtures("few_draws")
def test_swapped_laws_are_not_certified(tmp_path: Path) -> None:
    """Nearly everything is called, so that the law of still places cannot be checked: nothing is certified."""
    given = {"size_m": (1.0, 1.0), "question": Question(contrasts=(1.0,)), "replicates": 39}
    made = inspect(EXAMPLE / "plate.csv", laws=str(swapped(tmp_path)), **given)
    assert "where they are smaller (are the kinds exchanged?)" in made.samples.law.origin
    found = made.assessment
    assert found is not None
    assert found.verdict == "damage"
    assert set(found.checks["outcome"]) & {"not made", "refused"}
    assert any("could not be checked" in why for why in found.refusals)
    # Joined by commas and "and", reasons with a colon of their own ran into each other.
    assert not_certified(found) == f"Not certified: {'; '.join(found.refusals)}."
    assert len(found.refusals) > 1
    # The control: with the right law there is no reason.
    made = inspect(EXAMPLE / "plate.csv", laws=str(EXAMPLE / "reference.csv"), **given)
    assert "exchanged" not in made.samples.law.origin
    right = made.assessment
    assert right is not None
    assert right.refusals == ()


def test_a_drift_that_all_robots_share_is_found_by_all_together() -> None:
    """Robot by robot it was noticed in fewer than half."""
    samples = replace(drawn_samples(1, count=600, spread_m=0.0), law=LAW)
    samples = samples.with_columns(robot=np.arange(600.0) % 20)
    nothing = Others(samples, {robot: np.zeros(9) for robot in range(20)}, np.zeros(600))
    gain, noticed = 0.8 + 0.4 * np.arange(600) / 600, {"steady": 0, "drifting": 0}
    for seed in range(8):
        value = values_at(LAW, np.random.default_rng(seed).random(600), False)
        for what, factor in (("steady", 1.0), ("drifting", gain)):
            noticed[what] += (
                outcomes(samples.with_columns(value=factor * value), nothing)["drift"] == "refused"
            )
    assert noticed["steady"] <= 1  # the control
    assert noticed["drifting"] >= 7


def test_statistics_of_the_checks_are_those_of_their_definitions() -> None:
    """Robots with unequal numbers of samples at unequal times, on three still and two vibrating tiles."""
    samples, random = replace(drawn_samples(1, count=400, spread_m=0.0), law=LAW), np.random.default_rng(3)
    robot, time_s = (
        random.choice(6, 400, p=[0.5, 0.3, 0.13, 0.05, 0.01, 0.01]),
        np.sort(random.gamma(2.0, 99.0, 400)),
    )
    samples = samples.with_columns(robot=robot.astype(float), time_s=time_s)
    tile = tiles_below(samples)
    vibrates, rank = tile % 3 == 0, random.beta(1.2, 0.8, 400)
    found = _statistics(samples, rank[:, None], vibrates)[:, 0]
    score = ndtri(rank)
    for place in [~vibrates, *(vibrates & (tile == one) for one in range(9))]:  # still tiles are alike
        score[place] -= score[place].mean() if place.any() else 0.0
    for own in (vibrates, ~vibrates):
        score[own] /= score[own].std()
    between, drift, slopes, squares = [], [], 0.0, 0.0
    for one in range(6):
        own = robot == one
        if own.sum() >= 10:
            between.append(abs(score[own].mean()) * np.sqrt(own.sum()))
            when = time_s[own] - time_s[own].mean()
            drift.append(abs(when @ score[own]) / np.sqrt(when @ when))
            slopes, squares = slopes + when @ score[own], squares + when @ when
    assert len(drift) == 4
    largest = max(abs(np.sort(rank[~vibrates]) - (np.arange((~vibrates).sum()) + 0.5) / (~vibrates).sum()))
    assert found == pytest.approx([largest, max(between), max(*drift, abs(slopes) / np.sqrt(squares))])


def test_robots_and_times_are_compared_on_the_same_tile_where_the_law_says_that_tiles_differ() -> None:
    samples = drawn_samples(1, count=400, spread_m=0.0)
    score, vibrates = np.random.default_rng(1).normal(size=(400, 1)), np.zeros(400, dtype=bool)
    higher = 0.5 * tiles_below(samples)[:, None] / 9
    for name, alike in {"calibrated": True, "paper": False}.items():
        some = replace(samples, law=Law(preset(name).sensor, ""))
        found = [_statistics(some, ndtr(each), vibrates)[1:, 0] for each in (score, score + higher)]
        assert (found[0] == pytest.approx(found[1], rel=1e-6)) == alike


def test_a_robot_of_twice_the_gain_is_found_where_tiles_have_a_sample_or_two() -> None:
    """Less the mean of its tile, a sample that is alone there says nothing."""
    samples = replace(drawn_samples(1, count=300, spread_m=0.0), law=Law(preset("calibrated").sensor, ""))
    score = np.random.default_rng(1).normal(size=(300, 1)) + (samples.frame["robot"].to_numpy()[:, None] == 0)
    few = np.arange(300) // 2  # tiles of two samples
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("vibroswarm.inspection.checks.tiles_below", lambda some: few)
        between = _statistics(samples, ndtr(score), np.zeros(300, dtype=bool))[1, 0]
    assert between > 5.0


@pytest.mark.parametrize("reach_m", [0.0, 0.03])
def test_samples_feel_what_is_drawn(reach_m: float) -> None:
    samples = drawn_samples(3, count=60, spread_m=0.04).with_columns(spread_y_m=np.full(60, 0.01))
    sensor = samples.law.sensor.model_copy(update={"edge_reach_m": reach_m})
    samples = replace(samples, law=replace(samples.law, sensor=sensor))
    p = np.random.default_rng(2).random(9)
    felt = felt_on(samples, p)
    others = Others(samples, dict.fromkeys(range(5), p), felt)
    drawn = others.drawn(np.random.default_rng(1), 4000).mean(axis=1)
    within = (
        np.hypot(samples.column("x_m") - 0.3, samples.column("y_m") - 0.3) < 0.2
    )  # places beyond the grid are off it
    assert drawn[within] == pytest.approx(felt[within], abs=0.04)
    assert felt_on(samples, np.ones(9)) == pytest.approx(np.ones(60))


def test_a_gain_that_shows_on_vibrating_places_only_is_found_there() -> None:
    samples, nine = replace(drawn_samples(7, count=600, spread_m=0.0), law=LAW), np.arange(9)
    vibrates = tiles_below(samples) % 2 == 1
    right = values_at(LAW, np.random.default_rng(5).random(600), vibrates)
    louder = np.where(vibrates & (samples.frame["robot"].to_numpy() == 0), 2.0, 1.0) * right
    for value, outcome in ((right, "not refused"), (louder, "refused")):
        read = with_values(samples, value)
        others = Others(read, dict.fromkeys(range(5), (nine % 2).astype(float)), vibrates.astype(float))
        checks = law_checks(read, others, drawn=199)
        assert checks["outcome"][1] == outcome
        assert checks["samples"].to_list() == [(~vibrates).sum(), 600, 600, 600]
        known = checks.drop_nulls("p_value").sort("p_value")
        assert known.height == 4
        holm = np.maximum.accumulate(known["p_value"].to_numpy() * [4, 3, 2, 1])
        assert known["corrected"].to_list() == pytest.approx(np.minimum(holm, 1.0))


def test_what_a_robot_measures_does_not_change_the_map_of_the_others() -> None:
    samples = drawn_samples(7, count=300, spread_m=0.02)
    own, ratio = samples.frame["robot"].to_numpy() == 0, samples.column("log_ratio")
    patches = declared(samples.size_m, (0.2,))
    shares, maps = shares_of(samples, patches), []
    for one in (ratio, np.where(own, -ratio, ratio)):
        read = samples.with_columns(log_ratio=one)
        maps += [by_tiles(read).maps, by_patches(read, patches, shares, critical=0.3, prior=0.5).maps]
    for before, after in (maps[::2], maps[1::2]):
        assert (before[0] == after[0]).all()
        assert before[0].max() > 0.5
        assert abs(before[1] - after[1]).max() > 0.1


def test_places_that_say_little_have_little_power() -> None:
    """A single sure tile that nobody visits; of the others each vibrates nearly as likely as not."""
    samples = replace(drawn_samples(7, count=600, spread_m=0.0), law=LAW)
    power = []
    for p in (np.tile([0.49, 0.51], 5)[:9], np.tile([0.05, 0.95], 5)[:9]):
        away = with_values(samples, values_at(LAW, np.random.default_rng(5).random(600), True))
        others = Others(away, dict.fromkeys(range(5), np.append(p[:8], 0.95)), p[tiles_below(away)])
        power.append(law_checks(away, others, drawn=199).row(3, named=True))
    assert power[0]["power"] < 0.15 < 0.9 < power[1]["power"]
    assert power[0]["outcome"] == "not testable"


def test_a_robot_whose_places_are_mirrored_is_found_where_something_vibrates_only() -> None:
    samples = replace(drawn_samples(7, count=900, spread_m=0.02), law=LAW)
    assert samples.floor is not None
    vibrates = samples.floor.tiles.ravel()[
        samples.floor.tile_at(samples.column("true_x_m"), samples.column("true_y_m"))
    ]
    robot = samples.frame["robot"].to_numpy()
    for damaged in (True, False):
        value = values_at(LAW, np.random.default_rng(5).random(900), (vibrates == 1) & damaged)
        right = with_values(samples, value)
        x_m = np.where(robot == 0, 0.6 - samples.column("x_m"), samples.column("x_m"))
        assert outcomes(right)[PLACES] == ("not refused" if damaged else "not testable")
        assert outcomes(right.with_columns(x_m=x_m))[PLACES] == ("refused" if damaged else "not testable")


def test_right_places_pass_though_damage_lies_between_the_declared_places_and_sizes() -> None:
    """The map of the others took the edges of called patches as exact: right places were refused in 4 of these 6."""
    refused = {"right": 0, "mirrored": 0}
    for seed in range(6):
        samples = replace(drawn_samples(seed, count=900, spread_m=0.0, rows=5), law=LAW, floor=None)
        x_m, y_m, robot = samples.column("x_m"), samples.column("y_m"), samples.frame["robot"].to_numpy()
        on_damage = (np.abs(x_m - 0.23) < 0.12) & (np.abs(y_m - 0.62) < 0.12)
        right = with_values(samples, values_at(LAW, np.random.default_rng(seed).random(900), on_damage))
        mirrored = right.with_columns(x_m=np.where(robot == 0, 1.0 - x_m, x_m))
        for name, seen in {"right": right, "mirrored": mirrored}.items():
            patches = declared(seen.size_m, (0.14, 0.28))
            others = by_patches(seen, patches, shares_of(seen, patches), critical=0.3, prior=0.5)
            refused[name] += outcomes(seen, others)[PLACES] == "refused"
    assert refused["right"] == 0
    assert refused["mirrored"] >= 4  # the control


def with_values(samples: Samples, value: np.ndarray) -> Samples:
    from vibroswarm.inspection.samples import ratios_of_values

    return samples.with_columns(value=value, log_ratio=ratios_of_values(samples.law, value))


def test_bits_are_checked_and_told_by_their_own_law() -> None:
    """Readings were taken for energies: the told risk of an intact surface was 100 %, and nothing was checked."""
    scenario = preset("optimised-places").with_values({"run.t_end_s": 300.0, "floor.source": "random:0.0"})
    found = inspect(scenario, question=Question(0.2, (1.0,)), replicates=19, bits=True)
    assert found.assessment is not None
    assert found.assessment.verdict == "clear"
    assert set(found.assessment.checks["outcome"][:3]) == {"not refused"}
    samples = found.samples
    often = samples.with_columns(
        value=np.maximum(samples.column("value"), np.arange(samples.frame.height) % 3 == 0)
    )
    assert "refused" in law_checks(often, by_tiles(samples), drawn=199)["outcome"]
    assert set(np.unique(drawn_values(np.random.default_rng(1), samples, 3))) == {0.0, 1.0}


def test_bits_are_weighed_by_claimed_rates_also_where_tiles_differ() -> None:
    """With true rates instead of claimed ones, the told risk was 12 % instead of 62 % where tiles differ."""
    stated = {
        "run.t_end_s": 30.0,
        "floor.source": "random:0.0",
        "sensor.claimed_rates": ((0.9, 0.1), (0.2, 0.8)),
    }
    samples = inspect(preset("optimised-places").with_values(stated), bits=True).samples
    law = replace(samples.law, sensor=samples.law.sensor.model_copy(update={"tile_spread": 0.3}))
    alike, differ = (
        inspect(one, question=Question(0.2, (1.0,)), replicates=19).assessment
        for one in (samples, replace(samples, law=law))
    )
    assert alike is not None
    assert differ is not None
    assert differ.stopping.told == pytest.approx(alike.stopping.told)


def test_a_gain_that_is_not_in_the_reference_is_noticed_by_100_values() -> None:
    """Surfaces were drawn by the third that each judge had not seen: a gain of 1.2 was noticed on 18 % of surfaces."""
    random = np.random.default_rng(1)
    refused: dict[float, list[bool]] = {1.0: [], 1.2: []}
    for seed in range(8):
        law = law_of_measured(random.gamma(6.0, 2.0, 100), random.gamma(6.0, 1.0, 100), "measured")
        samples = replace(drawn_samples(seed, count=800, spread_m=0.0), law=law)
        nothing = Others(samples, {robot: np.zeros(9) for robot in range(5)}, np.zeros(800))
        value = random.gamma(6.0, 1.0, 800)
        for gain, of_gain in refused.items():
            found = outcomes(samples.with_columns(value=gain * value), nothing)
            of_gain.append(found["law of still places"] == "refused")
    assert sum(refused[1.0]) <= 1
    assert sum(refused[1.2]) >= 6


def test_bits_of_a_right_law_are_not_refused() -> None:
    """Their rates are those of the law: surfaces that it draws itself leave its error out, and 1 of 5 was refused."""
    random = np.random.default_rng(2)
    refused = 0
    for seed in range(12):
        law = law_of_measured(random.gamma(6.0, 0.3, 100), random.gamma(6.0, 0.15, 100), "measured")
        samples = replace(drawn_samples(seed, count=800, spread_m=0.0), law=replace(law, bits=True))
        nothing = Others(samples, {robot: np.zeros(9) for robot in range(5)}, np.zeros(800))
        bits = random.gamma(6.0, 0.15, 800) > law.sensor.rms_threshold
        refused += (
            outcomes(samples.with_columns(value=1.0 * bits), nothing)["law of still places"] == "refused"
        )
    assert refused == 0


def test_readings_are_compared_with_the_rates_of_the_floors_own_grid() -> None:
    """On 10 x 10 tiles the physics reads 1 on still tiles more often than on the study's: .15 in place of .08."""
    grid = {
        "floor.rows": 10,
        "floor.columns": 10,
        "floor.source": "random:0.5",
        "sensor.model": "acceleration",
    }
    scenario = preset("paper").with_values(grid)
    place = grid_of(scenario)
    read, vibrates = np.full((40, 1), error_rates(scenario.sensor, place)[0]), np.zeros(40, dtype=bool)
    laws = [Law(scenario.sensor, "", bits=True, place=known) for known in (place, None)]
    samples = drawn_samples(1, count=40, spread_m=0.0)
    apart = [_statistics(replace(samples, law=law), read, vibrates)[0, 0] for law in laws]
    assert apart[0] == pytest.approx(0.0, abs=1e-12)
    assert apart[1] > 0.05


def test_what_is_read_of_energies_of_the_physics_has_their_shape() -> None:
    """Samples by replicates are not samples by numbers; a sensor of several numbers is refused, not read from one."""
    sensor = preset("paper").with_values({"sensor.model": "acceleration"}).sensor
    energy = np.array([[0.5, 3.0, 1.0], [2.0, 0.1, 5.0]])
    assert read_by(Law(sensor, "", bits=True), energy).tolist() == (energy > sensor.rms_threshold).tolist()
    features = {"sensor.model": "acceleration", "sensor.acceleration.features": ["variance"]}
    with pytest.raises(InputError, match="several numbers"):
        read_by(Law(preset("paper").with_values(features).sensor, "", bits=True), energy)


def test_a_session_is_judged_by_the_law_of_the_others_alone() -> None:
    lab = ROOT / "examples" / "lab"
    logs = [read_log(lab / f"session-{number}.csv") for number in (1, 2)]
    recording = recording_of(logs, Floor.filling(read_tiles(lab / "floor.txt", (5, 5))), preset("paper"))
    for run in (0, 1):
        assert law_for_session(recording, run, draws=0).sessions == (hash_of_run(recording, 1 - run),)
