"""What a loop over steps knows: what is there after what, and what ends it."""

import ast
import inspect
from types import SimpleNamespace

import numpy as np
import pytest
from cases import cases

from openmm_dpd.kernels import steps
from openmm_dpd.kernels.columns import Totals
from openmm_dpd.kernels.layer import CONSERVATIVE, LAPLACIAN, STRESS
from openmm_dpd.kernels.moment import Moment
from openmm_dpd.kernels.validity import Computed, Recorded, Validity

TOTALS = Totals(1.0, 2.0, 3.0)


class Engine:
    """Numbers the lists that it makes; it holds those of one array of positions."""

    def __init__(self):
        self.number, self.held = 0, np.zeros((2, 3))

    def holds(self, x, box):
        return x is self.held

    def place(self):
        self.number += 1


def moment(x, acc=None) -> Moment:
    return Moment(x, np.zeros_like(x), None, 0.01, 1.0, 1, 0, acc=acc)


@pytest.fixture
def engine() -> Engine:
    return Engine()


@pytest.fixture
def valid(engine) -> Validity:
    """With lists and a force."""
    made = Validity(engine)
    made.begin(engine.held, None, False)
    made.summed(CONSERVATIVE, TOTALS)
    return made


def test_nothing_is_there_at_first(engine):
    made = Validity(engine)
    assert not (made.placed or made.given or made.forced) and made.moment is None and not made.take()


def test_a_run_begins_with_the_lists_that_the_engine_holds_and_no_moment(engine, valid):
    valid.begin(engine.held.copy(), None, False)
    assert not valid.placed
    valid.begin(engine.held, None, False)
    assert valid.placed
    valid.end(there := moment(engine.held))
    assert valid.moment is there
    valid.begin(engine.held, None, False)
    assert valid.moment is None


def test_a_drift_ends_lists_and_a_force_that_was_given(valid, engine):
    """... but leaves the force of the lists: ``mvv`` and words that end with a drift use it at the end of a run."""
    valid.drift()
    assert valid.forced and valid.totals is TOTALS
    valid.begin(engine.held, None, True)
    assert valid.given
    valid.drift()
    assert not valid.placed and not valid.given
    valid.listed()
    assert valid.placed and not valid.given


@pytest.mark.parametrize("more", [STRESS, LAPLACIAN, STRESS | LAPLACIAN])
def test_sums_that_were_not_asked_for_are_not_there(valid, more):
    assert valid.has(CONSERVATIVE) and not valid.has(more)
    valid.summed(CONSERVATIVE | more, TOTALS)
    assert valid.has(more) and valid.has(CONSERVATIVE)


def test_what_ends_the_force(valid, engine):
    """A sum that is not complete, and other lists."""
    valid.lose_force()
    assert not valid.forced
    valid.summed(CONSERVATIVE, TOTALS)
    assert valid.forced
    engine.place()
    assert not valid.forced and not valid.has(CONSERVATIVE)


def test_what_a_step_need_not_do_and_a_recorded_one_that_is_there_once(engine, valid):
    there = moment(engine.held)
    assert valid.computed(there) == Computed(placed=True, forced=True, accelerated=False, given=False)
    assert valid.computed(moment(engine.held, acc=np.zeros((2, 3)))).accelerated
    valid.drift()  # the force that is left is not that of the present positions
    assert valid.computed(there) == (False, False, False, False)
    recorded = Recorded(SimpleNamespace(), Computed(True, True, False, False), ())
    valid.record({False: recorded})
    assert valid.take() == {False: recorded} and not valid.take()


@cases("before", Computed(True, True, False, False), Computed(True, False, True, True), Computed(False, False, False, True), None)
def test_played_steps_leave_what_was_known_before_them(engine, valid, before):
    valid.begin(engine.held, None, True)
    valid.played(before)
    placed, forced = (False, False) if before is None else before[:2]
    assert (valid.placed, valid.forced, valid.given) == (placed, forced, False)


def test_the_loop_has_few_attributes():
    """What is valid has one place; a loop that needs more attributes has another thing to be split off."""
    (loop,) = ast.parse(inspect.getsource(steps.StepLoop)).body
    declared = {node.target.id for node in loop.body if isinstance(node, ast.AnnAssign)}
    attributes = [node for node in ast.walk(loop) if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store)]
    stored = {node.attr for node in attributes if ast.unparse(node.value) == "self"}
    assert len(declared | stored) <= 14, sorted(declared | stored)
