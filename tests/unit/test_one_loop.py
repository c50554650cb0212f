"""One loop over runs: who simulates runs, and who shares work among workers, by the names that modules import.

Everything else lists cells and gives them to ``study.run``; a module that needs more is named here, with why.
"""

from __future__ import annotations

from pathlib import Path

from helpers.sources import called, imported, modules

SIMULATE = {
    "vibroswarm.simulation": {"simulate", "replay"},
    "vibroswarm.motion.source": {"source"},
    "vibroswarm.inference.closed_loop": {"ClosedLoop", "advance_loops"},
    "vibroswarm.inference.motion_feedback": {"steered_motion", "until_all_decided"},
    "vibroswarm.optimize.outcomes": {"outcomes_of"},
    "vibroswarm.study.batch": {"do_batch", "simulate_batch"},
}
"""What simulates runs, by module."""
SHARE = {
    "concurrent.futures": {"ThreadPoolExecutor", "ProcessPoolExecutor"},
    "vibroswarm.study.work": {"do_all", "results_of"},
}
"""What shares work among workers, by module."""

LOOP = {
    "simulation.py": "simulate and replay",
    "inference/motion_feedback.py": "motion that depends on decisions, for simulate",
    "study/batch.py": "a batch of runs, as tables",
    "optimize/outcomes.py": "a batch of runs, as what a cost needs: it ends with the last decision",
    "optimize/evaluate.py": "calls outcomes_of in a worker",
    "study/runner.py": "submits batches, and saves what they return",
    "study/executors.py": "calls do_batch in a worker",
}
WHOLE_RESULTS = {
    "cli/run.py": "one run",
    "inspection/inspection.py": "one run",
    "inspection/missed.py": "samples, in which damage is drawn",
    "paper/items/example_run.py": "one run, drawn",
    "calibrate/cross_validation.py": "sessions as recordings have them",
    "paper/items/calibration.py": "sessions as recordings have them",
    "paper/items/side_claims.py": "places of samples",
    "analysis/oracle_posterior.py": "the same result on mirrored floors",
    "study/baselines.py": "the same result with another strategy",
    "study/study_result.py": "runs of a study again, with their samples",
    "optimize/verify.py": "runs of a study again, to compare them",
}
"""Those who need samples or paths of a few runs, which a study does not keep."""
OTHERS = {
    "study/spec.py": "refuses unknown sources of motion",
    **dict.fromkeys(f"testing/{kind}.py" for kind in ("motion", "network", "runs", "strategy")),
}
SHARING = {
    "study/executors.py": "the workers",
    "study/runner.py": "gives batches to the loop, and saves what they return",
    "optimize/evaluate.py": "gives pieces of candidates to the loop",
    "paper/cells.py": "summarises cells while the next study runs",
    "inspection/stopping.py": "judges drawn surfaces",
}


FILES = {"read_parquet", "scan_parquet", "write_parquet", "read_parquet_metadata"}
"""Functions of polars that read or write tables."""


def test_only_these_simulate_runs() -> None:
    assert {name for name, path in modules() if imported(path, SIMULATE)} == {*LOOP, *WHOLE_RESULTS, *OTHERS}


def test_only_these_share_work() -> None:
    assert {name for name, path in modules() if imported(path, SHARE)} == set(SHARING)


def test_one_module_reads_and_writes_tables() -> None:
    assert [name for name, path in modules() if called(path, FILES)] == ["core/tables.py"]


def test_one_module_knows_the_manifest() -> None:
    """The name of the manifest, and the number of the format, stand in one place; an archive names the same format."""
    assert [name for name, path in modules() if '"vibroswarm.json"' in path.read_text()] == [
        "core/atomic_io.py"
    ]
    named = {name for name, path in modules() if imported(path, {"vibroswarm.core.folders": {"FORMAT"}})}
    assert named == {"paper/archive.py"}


def test_a_loop_of_its_own_is_seen(tmp_path: Path) -> None:
    """Negative control: an import within a function, under another name."""
    file = tmp_path / "own.py"
    file.write_text("def curve():\n    from vibroswarm.simulation import simulate as s, versions\n")
    assert imported(file, SIMULATE) == {"simulate"}
    file.write_text("import polars as pl\nshow = pl.read_parquet\n")
    assert called(file, FILES)
    file.write_text("from vibroswarm.study.run import run\n")
    assert imported(file, SIMULATE) == set()
