"""Kernels are compiled with one of three sets of options, all of them said."""

import ast
import re
from pathlib import Path

import pytest
from numba import njit
from numba.core.errors import NumbaError

import handover
import roadmap.jit_options as kernels
from handover.reach._reach_mark import mark_positions
from roadmap.kinematics import _chain, _inverse, _seven, _six

SHARED = [Path(module.__file__) for module in (_chain, _inverse, _six, _seven)]
FILES = SHARED + sorted(Path(handover.__file__).parent.rglob("_[!_]*.py"))

SAY_ALL = {m.__name__ for m in (_chain, _inverse, _six, _seven, kernels)}


def test_every_kernel_says_all_of_its_options():
    assert len(FILES) > 10
    for file in FILES:
        found = re.findall(r"@njit(.*)\ndef", file.read_text(encoding="utf-8"))
        assert found, file.name
        assert set(found) <= {"(**BARE)", "(**WITHIN)", "(**FULL)"}, file.name
    sets = kernels.BARE, kernels.WITHIN, kernels.FULL
    assert len({tuple(sorted(options)) for options in sets}) == 1


def test_kernels_that_call_other_packages_do_not_hand_down_their_options():
    """What is compiled for a caller is cached, and keeps what it took over."""
    callers = []
    for file in FILES:
        tree = ast.parse(file.read_text(encoding="utf-8"))
        foreign = {
            alias.asname or alias.name
            for node in tree.body
            if isinstance(node, ast.ImportFrom)
            and node.module.split(".")[0] in ("roadmap", "odm")
            and node.module not in SAY_ALL
            for alias in node.names
        }
        for node in tree.body:
            if not isinstance(node, ast.FunctionDef) or not node.decorator_list:
                continue
            called = {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
            if called & foreign:
                callers.append(node.name)
                options = ast.unparse(node.decorator_list[0])
                assert options == "njit(**FULL)", (file.name, node.name)
    assert "_near" in callers


def test_a_bare_kernel_cannot_make_an_array():
    import numpy as np

    options = {k: v for k, v in kernels.BARE.items() if k != "cache"}

    @njit(**options)
    def leaks(n):
        return np.zeros(n).sum()

    with pytest.raises(NumbaError):
        leaks(3)
    assert mark_positions.targetoptions["_nrt"] is False
