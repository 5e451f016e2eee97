"""Skills judged over thousands of starts: how each rollout ends, where else it rests, and whether energy falls."""

from ._distribution import join_processes as join_processes
from ._distribution import map_over_processes as map_over_processes
from ._ends import Ends as Ends
from ._ends import classify_ends as classify_ends
from ._evaluate import Evaluation as Evaluation
from ._evaluate import Replay as Replay
from ._evaluate import evaluate as evaluate
from ._evaluate import limit_leaf as limit_leaf
from ._evaluate import replay as replay
from ._evaluate import skill_problem as skill_problem
from ._page import write_page as write_page
from ._regions import regions as regions
from ._report import KINDS as KINDS
from ._report import report as report
from ._rest_points import rest_points as rest_points
from ._scene_problem import scene_problem as scene_problem
from ._scene_problem import scene_world as scene_world
from ._stability import goal_hessians as goal_hessians
from ._stability import learned_metrics as learned_metrics
from ._stability import stationary_points as stationary_points
from ._starts import check_starts as check_starts
from ._starts import sample_starts as sample_starts
from ._starts import starts_around as starts_around
