"""Train a classifier of scikit-learn on some rows of two classes, and measure its accuracy on others.

All accuracies are balanced: the mean of the two classes' shares of correct predictions; 0.5 is chance.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from vibroswarm.core.arrays import Floats, Ints
from vibroswarm.core.optional_library import needed


def scikit_learn(module: str) -> Any:
    """Return a module of scikit-learn, such as "linear_model".

    Raises:
        InputError: scikit-learn is not installed.
    """
    return needed(f"sklearn.{module}", "lab", "calibrate")


def mean_accuracy(classifier: Any, rows: Floats, label: Ints, splits: Iterable[tuple[Ints, Ints]]) -> float:
    """Return the mean balanced accuracy over the splits, or NaN if there is none.

    A split that trains or tests a single class is left out.

    Args:
        classifier: of scikit-learn, untrained. rows: features, (rows, columns). label: class of each row, 0 or 1.
        splits: indices of the rows that are trained on, and of those that are tested.
    """
    whole = [split for split in splits if all(np.unique(label[part]).size == 2 for part in split)]
    if not whole:
        return np.nan
    # Threads cost more than they save with so few rows: fifty times as much on a busy machine.
    with threadpool_limits(1):
        shares = scikit_learn("model_selection").cross_val_score(
            classifier, rows, label, cv=whole, scoring="balanced_accuracy", error_score="raise"
        )
    return float(np.mean(shares))
