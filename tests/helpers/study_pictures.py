"""Fewer pictures in the documents of studies, for tests of all but them."""

from __future__ import annotations

from itertools import islice

import pytest

from vibroswarm.documents import study


def keep_first_picture(patch: pytest.MonkeyPatch) -> None:
    """Leave out all pictures of a study but the first."""
    whole = study.outcome_figures
    patch.setattr(study, "outcome_figures", lambda outcome: islice(whole(outcome), 1))
    for name in ("time_figures", "comparison_figures", "front_figures", "sampling_figures"):
        patch.setattr(study, name, lambda outcome: ())
