"""Scores schemes of integration by the reference suite: twelve frozen scenes, and what is measured in them as the step goes to 0."""

from .quantities import QUANTITIES as QUANTITIES
from .runs import BlockMeans as BlockMeans, State as State, run_frames as run_frames, run_states as run_states, run_word as run_word
from .scoring import Judged as Judged, Score as Score, judge as judge, score_word as score_word
from .suite import SuiteScene as SuiteScene, load_suite as load_suite
