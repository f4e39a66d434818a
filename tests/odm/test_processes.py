"""Jobs in processes of their own: in order, and what ends one is told."""

import operator
import os

import pytest

from odm.processes import in_processes
from roadmap.errors import PlanningError


def test_processes_give_results_in_the_order_of_their_jobs():
    with in_processes(2, operator.neg, [20, 3, 9, "x"]) as found:
        assert [next(found) for _ in range(3)] == [-20, -3, -9]
        with pytest.raises(TypeError, match="unary"):
            next(found)


def test_a_process_that_was_killed_is_told_in_a_sentence():
    with in_processes(1, os._exit, [9]) as found:
        with pytest.raises(PlanningError, match=r"it was killed.*take fewer processes"):
            next(found)
