"""Public names and where they are; ``__init__.py`` imports each on first use."""

from .errors import InputError as InputError
from .errors import RunError as RunError
from .floors.design import make_floor as make_floor
from .floors.difficulty import measure as measure
from .floors.floor import Floor as Floor
from .inspection.inspection import inspect as inspect
from .motion.pose import pose as pose
from .result import Result as Result
from .run_page.write import write_run_page as write_run_page
from .scenario.plugins import load_code as load_code
from .scenario.scenario import Scenario as Scenario
from .scenario.scenario import preset as preset
from .simulation import replay as replay
from .simulation import simulate as simulate
from .statistics.verdict import verdict as verdict
from .study.runs import Runs as Runs
from .study.spec import Study as Study
from .study.summary import outcome_of as outcome_of
