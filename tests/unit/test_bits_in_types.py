"""Which modules have a bit in their types: two kinds of tile, readings of 0 and 1, or answers no and yes."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "src" / "vibroswarm"
NAMES = {"bit", "bits", "ones", "vibrating", "vibrates", "still"}
"""Words in names of variables, fields, arguments, functions and columns."""
ONE_OF_TWO = {
    "decision", "decisions", "reading", "readings", "observation", "observations", "answer", "answers", "truth",
    "kind", "kinds", "tile", "tiles", "opinion",
}  # fmt: skip
"""Words in names of what is compared with 0 or 1."""
NUMBERS = {"kinds", "readings", "answers"}
"""Words in names of what is compared with 2."""

ALLOWED = {
    "rules of the paper and of others who count bits; kinds are refused": """strategies/asdf strategies/bayes
        strategies/bayes_bots strategies/bayes_cpf strategies/dbbs strategies/distrust strategies/field
        strategies/forget strategies/mcp strategies/none strategies/positive strategies/reset strategies/soft
        strategies/three_valued strategies/totals strategies/valentini""",
    "a strategy, sensor or task whose case of two is the paper's, and of more its own": """strategies/dirichlet
        strategies/dirichlet_soft strategies/kind_belief tasks/agree tasks/share sensors/claims""",
    "maps of two kinds, which have fewer numbers; tile_map has that of more kinds too (kind_map)": """
        strategies/place_evidence strategies/place_map strategies/place_samples strategies/place_share
        strategies/place_summaries strategies/place_trust strategies/places
        analysis/map_figures analysis/map_scores documents/cell_figures inspection/tile_map""",
    "a kind against kind 0, of any number of kinds": """strategies/place_kinds inspection/sources view/picture
        inspection/inspection documents/inspection documents/damage floors/changes
        sensors/acceleration""",
    "messages of one bit, counted without a list; other messages are read one by one": """inference/default_hooks
        inference/generated_kernels inference/replay inference/replay_arrays inference/replay_counts
        inference/replay_from_counts inference/replayer inference/agents strategies/base
        strategies/static_analysis export/assembly export/c_program export/robot_program testing/plain_reference
        testing/runs""",
    "a fill ratio against a boundary, which more kinds have not; refused": """analysis/centralised_baseline
        analysis/decidability analysis/detection documents/detection observation/decision_boundary
        observation/edge_response league/belief_calibration paper/item""",
    "the law of still and vibrating values": """scenario/fields sensors/energies sensors/gamma
        observation/measured_csv study/scenario_words testing/sensor floors/patches""",
    "likelihood ratios of two kinds, beside those of more": """observation/energy_model analysis/oracle_posterior
        analysis/tile_posterior""",
    "damage: patches that vibrate on a still surface; of kinds, any but kind 0 (any_but_still)": """
        inspection/checks inspection/damage inspection/factors inspection/laws
        inspection/others inspection/region inspection/samples cli/inspection""",
    "recordings of the study's robots; refuse_kinds": """recordings/export recordings/floor_fit
        recordings/infer_settings recordings/infer_strategy recordings/log_readers recordings/replay
        recordings/threshold calibrate/classifier calibrate/cross_validation calibrate/dataset calibrate/features
        calibrate/fit_camera calibrate/fit_sensor calibrate/fit_vibration calibrate/histograms
        calibrate/session_statistics calibrate/vibration_facts documents/recording paper/columns
        paper/items/calibration""",
    "floors of a given fill ratio and difficulty; kind 1 is what vibrates": """floors/anneal floors/design
        floors/difficulty floors/floor floors/grid_text floors/io floors/source documents/floor""",
    "asks for the number of kinds, to say or refuse what holds for two": """documents/league documents/run
        documents/study inference/outcomes league/entries league/standings league/words plots/run result_validation
        scenario/validation study/baselines tasks/mean view/server run_page/payload""",
    "the share read as kind 1, a figure": "analysis/sampling analysis/verdict core/tables run_page/write",
    "colours": "plots/style",
    "the task changed: told, or not": "analysis/answers_over_time",
    "false alarms and misses; task.costs has those of more answers": "optimize/costs",
    "bits of a number, or still in another sense": """calibrate/wall_approach core/atomic_io core/jit errors
        inference/deliveries optimize/sensitivity robot/features study/factors testing/task
        tracking/doubts tracking/marker_detection tracking/markers tracking/picture_quality tracking/track""",
}
"""Modules with a bit in their types, by the reason for which they may have it."""


def bits_in(program: str) -> Iterator[int]:
    """Lines with a bit: by a name, or by a comparison (== 1, != 0, kinds > 2)."""
    for node in ast.walk(ast.parse(program)):
        if any(words_of(name) & NAMES for name in names_of(node)):
            yield getattr(node, "lineno", 0)
        if isinstance(node, ast.Compare):
            sides = (node.left, *node.comparators)
            words = {word for side in sides for name in compared(side) for word in words_of(name)}
            numbers = {side.value for side in sides if isinstance(side, ast.Constant)}
            equals = isinstance(node.ops[0], ast.Eq | ast.NotEq)
            if (equals and words & ONE_OF_TWO and numbers & {0, 1}) or (words & NUMBERS and 2 in numbers):
                yield node.lineno


def names_of(node: ast.AST) -> Iterator[str]:
    """Names that a node has by itself; strings count if they may be columns, ``np.ones`` and constants do not."""
    if isinstance(node, ast.Constant):
        if isinstance(node.value, str) and re.fullmatch(r"[a-z_]+", node.value):
            yield node.value
    elif not (isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "np"):
        for field in ("id", "attr", "arg", "name"):
            name = getattr(node, field, None)
            if isinstance(name, str) and not name.isupper():
                yield name


def compared(side: ast.AST) -> Iterator[str]:
    """Names of one side of a comparison: those of x, s.x, x[k], s["x"], pl.col("x"), len(x) and max(x, y)."""
    yield from names_of(side)
    if isinstance(side, ast.Subscript):
        yield from compared(side.value)
        yield from names_of(side.slice) if isinstance(side.slice, ast.Constant) else ()
    if isinstance(side, ast.Call) and ast.unparse(side.func) in ("pl.col", "len", "max"):
        yield from (name for part in side.args for name in compared(part))


def words_of(name: str) -> set[str]:
    return set(re.split(r"[_.]", name.lower()))


def test_only_what_is_about_bits_has_them_in_its_types() -> None:
    found = {
        path.relative_to(PACKAGE).with_suffix("").as_posix(): lines
        for path in sorted(PACKAGE.rglob("*.py"))
        if (lines := sorted(set(bits_in(path.read_text(encoding="utf-8")))))
    }
    allowed = [module for modules in ALLOWED.values() for module in modules.split()]
    assert len(allowed) == len(set(allowed))
    assert {module: lines for module, lines in found.items() if module not in allowed} == {}
    assert set(allowed) <= set(found), "no exception is left over"


def test_a_module_with_a_bit_in_its_types_is_seen() -> None:
    """Negative control."""
    for line in (
        "def hear(bit: int): ...",
        "class Sample:\n    is_vibrating: bool",
        'right = pl.col("decision") == 1',
        "if max(sensor.kinds, sensor.readings) > 2: ...",
        "colour = RED if playback.readings[k] == 1 else BLUE",
        'row["truth"] != 0',
    ):
        assert list(bits_in(line)), line
    of_any_kind = (
        "n = counts[kind]; found = decision == truth; undecided = decision == -1; np.ones(3); KEY_BITS = 2"
    )
    assert not list(bits_in(of_any_kind))
