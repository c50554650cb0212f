"""A method of search: points near the best candidate so far. ``vibroswarm optimize --method near.py:near``."""

import numpy as np
from optuna.samplers import RandomSampler

from vibroswarm.search import optuna_method


class Near(RandomSampler):
    def __init__(self, seed):
        super().__init__(seed)
        self.random = np.random.default_rng(seed)

    def sample_independent(self, study, trial, name, distribution):
        known = [one for one in study.trials if one.values]
        if not known:
            return super().sample_independent(study, trial, name, distribution)
        best = min(known, key=lambda one: one.values[0])  # a range is 0 to 1 here, a choice ordered
        return float(np.clip(best.params[name] + 0.2 * self.random.normal(), 0.0, 1.0))


near = optuna_method("near", lambda samplers, seed: Near(seed), orders_choices=True)
