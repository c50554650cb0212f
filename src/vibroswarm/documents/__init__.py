"""The document of each kind of result: one function a kind, which terminal, page, notebook and JSON show.

Documents of several results side by side, such as floors or comparisons by folder, of plain tables and lists, and of
files and folders have no class of their own, so that they are not in ``DOCUMENTS``; commands call their functions.
"""

from __future__ import annotations

from importlib import import_module
from typing import Final

from vibroswarm.show.document import Document, Figure, Section, Table, Text

DOCUMENTS: Final = {
    "vibroswarm.result.Result": "run:result_document",
    "vibroswarm.analysis.verdict.Verdict": "run:verdict_document",
    "vibroswarm.analysis.verdict.RobotVerdict": "objects:robot_document",
    "vibroswarm.scenario.scenario.Scenario": "objects:scenario_document",
    "vibroswarm.scenario.scenario.FieldNames": "objects:field_names_document",
    "vibroswarm.floors.floor.Floor": "floor:floor_document",
    "vibroswarm.floors.design.FloorDesign": "floor:design_document",
    "vibroswarm.plots.picture.Picture": "objects:picture_document",
    "vibroswarm.study.spec.Study": "objects:study_document",
    "vibroswarm.study.evaluation.ReportFile": "objects:report_document",
    "vibroswarm.study.study_result.StudyResult": "objects:study_result_document",
    "vibroswarm.inspection.inspection.Inspection": "inspection:inspection_document",
    "vibroswarm.league.standings.League": "league:entries_document",
    "vibroswarm.league.standings.Standings": "league:league_document",
    "vibroswarm.league.tuning.Tuned": "league:tune_document",
    "vibroswarm.calibrate.fit.Fit": "fit:fit_document",
    "vibroswarm.calibrate.message_loss.LossFits": "calibration:message_loss_document",
    "vibroswarm.calibrate.real_vs_simulated.Comparison": "calibration:comparison_document",
    "vibroswarm.paper.claims.Claim": "reproduction:claim_document",
    "vibroswarm.paper.claims.Decided": "reproduction:verdict_document",
    "vibroswarm.paper.reproduce.Reproduction": "reproduction:reproduction_document",
    "vibroswarm.export.timing.Exported": "export:export_document",
    "vibroswarm.recordings.replay.Replays": "recording:replay_document",
    "vibroswarm.recordings.spectrum.Spectra": "spectrum:spectrum_document",
    "vibroswarm.recordings.threshold.Recommendation": "recording:threshold_document",
    "vibroswarm.study.detection.Detection": "detection:detection_document",
    "vibroswarm.study.evaluation.Comparison": "study:comparison_document",
    "vibroswarm.study.tradeoff.Tradeoff": "tradeoff:tradeoff_document",
    "vibroswarm.tracking.track.Tracking": "tracking:tracking_document",
    "vibroswarm.study.summary.Outcome": "study:study_document",
    "vibroswarm.optimize.verify.Verified": "verified:verified_document",
    "vibroswarm.optimize.grid.Nodes": "grid:grid_document",
    "vibroswarm.optimize.loop.Found": "search:search_document",
    "vibroswarm.optimize.scenario_comparison.Checked": "search:checked_document",
    "vibroswarm.optimize.sensitivity.Sensitivity": "search:sensitivity_document",
    "vibroswarm.optimize.validation.Front": "search:front_document",
    "vibroswarm.optimize.validation.Scored": "search:scored_document",
    "vibroswarm.optimize.validation.Truth": "search:truth_document",
}
"""Module and function, by module and name of the class. Packages of results take long to import, so that each module is
imported when a document is asked for."""


def document_of(value: object) -> Document | None:
    """Return the document of a result, by the function of its class or nearest base class; None without one."""
    if isinstance(value, Document):
        return value
    if isinstance(value, Text | Table | Figure | Section):
        return Document("", (), parts=(value,))
    for kind in type(value).__mro__:
        if found := DOCUMENTS.get(f"{kind.__module__}.{kind.__qualname__}"):
            module, _, function = found.partition(":")
            document: Document = getattr(import_module(f"{__name__}.{module}"), function)(value)
            return document
    return None
