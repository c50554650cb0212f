"""Public names and where they are; ``__init__.py`` imports each on first use."""

from .loop import Found as Found
from .loop import run_search as run_search
from .methods import Method as Method
from .methods import optuna_method as optuna_method
from .objective import Objective as Objective
from .outcomes import Outcomes as Outcomes
from .outcomes import outcomes_of as outcomes_of
from .pso import PsoSettings as PsoSettings
from .searched import best_scenario as best_scenario
from .searched import candidate_table as candidate_table
from .searched import history_table as history_table
from .searched import write_search as write_search
from .sensitivity import sobol_indices as sobol_indices
from .space import Space as Space
from .spec import Search as Search
from .spec import SearchSettings as SearchSettings
from .validation import Truth as Truth
from .validation import front_of as front_of
from .validation import paired_score as paired_score
from .validation import scores_of as scores_of
from .validation import truth_of as truth_of
