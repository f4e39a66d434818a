"""Kernels are compiled with one of a few sets of options, all of them said."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
import sources
from numba import njit
from numba.core.errors import NumbaError

import roadmap.compiling.jit_options as options
from handover.reach._reach_mark import mark_positions
from odm.search._step import respond

TOP = Path(__file__).parent.parent
PACKAGES = ("roadmap", "odm", "handover", "sim")
FROM_PYTHON = {"BRIEF", "LEAN", "BARE", "WITHIN", "FULL"}
FROM_LOOPS = {"INNER", "BARE_INNER", "WITHIN_INNER", "FULL_INNER"}

Kernel = tuple[str, str]  # module and name


@cache
def _parsed() -> dict[str, ast.Module]:
    files = [f for p in (*PACKAGES, "tests") for f in (TOP / p).rglob("*.py")]
    return {
        ".".join(f.relative_to(TOP).with_suffix("").parts): sources.tree(f)
        for f in files
    }


@cache
def _walked(module: str) -> list[tuple[ast.stmt, list[ast.AST]]]:
    """Return each statement of a module with all that is in it; slow to find out."""
    return [(top, list(ast.walk(top))) for top in _parsed()[module].body]


@cache
def _imports(module: str) -> list[tuple[str, ast.alias]]:
    """Return what a module imports from others, anywhere."""
    return [
        (node.module, alias)
        for _, inside in _walked(module)
        for node in inside
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    ]


def _options(node: ast.stmt) -> str | None:
    """Return what stands in the `njit` of a function, None without one."""
    if isinstance(node, ast.FunctionDef):
        for decorator in node.decorator_list:
            text = ast.unparse(decorator)
            if text.startswith("njit"):
                return text.removeprefix("njit(**").removesuffix(")")
    return None


@cache
def _kernels() -> dict[Kernel, str]:
    return {
        (module, node.name): said
        for module, tree in _parsed().items()
        if module.split(".")[0] in PACKAGES
        for node in tree.body
        if (said := _options(node)) is not None
    }


@cache
def _names(module: str) -> dict[str, Kernel]:
    """Return the kernels that a module defines or imports, by their names there."""
    kernels = _kernels()
    found = {name: (m, name) for m, name in kernels if m == module}
    for other, alias in _imports(module):
        if other in _parsed() and alias.name in _names(other):
            found[alias.asname or alias.name] = _names(other)[alias.name]
    return found


@cache
def _called_from_python() -> frozenset[Kernel]:
    """Return the kernels that are named outside of kernels.

    Tests included, but for what they call by `with_wrapper`.
    """
    found: set[Kernel] = set()
    for module, tree in _parsed().items():
        opened = {n: ast.unparse(node) for n, node in _opened(tree)}
        names = {n: k for n, k in _names(module).items() if n not in opened}
        whole = {
            alias.asname or alias.name: f"{other}.{alias.name}"
            for other, alias in _imports(module)
            if f"{other}.{alias.name}" in _parsed()
        }
        for top, inside in _walked(module):
            if _options(top) is not None:
                continue
            for node in inside:
                if isinstance(node, ast.Name) and node.id in names:
                    found.add(names[node.id])
                if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                    if ast.unparse(node) in opened.values():
                        continue
                    there = whole.get(node.value.id)
                    if there is not None and node.attr in _names(there):
                        found.add(_names(there)[node.attr])
    return frozenset(found)


def _opened(tree: ast.Module) -> Iterator[tuple[str, ast.expr]]:
    """Yield name and loop of each line `name = with_wrapper(loop)`."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call):
            if ast.unparse(node.value.func) == "with_wrapper":
                yield ast.unparse(node.targets[0]), node.value.args[0]


def test_every_kernel_says_all_of_its_options():
    """What is compiled for a caller is cached: an option left open is the caller's."""
    assert len(_kernels()) > 400
    for kernel, said in _kernels().items():
        assert said in FROM_PYTHON | FROM_LOOPS, kernel
    sets = [getattr(options, name) for name in FROM_PYTHON | FROM_LOOPS]
    assert len({tuple(sorted(o)) for o in sets}) == 1


def test_only_a_kernel_with_a_wrapper_is_called_from_python():
    """Numba calls address 0 otherwise, and the process ends."""
    assert len(_called_from_python()) > 100
    for kernel in _called_from_python():
        assert _kernels()[kernel] in FROM_PYTHON, kernel
    for name in FROM_PYTHON | FROM_LOOPS:
        without = getattr(options, name)["no_cpython_wrapper"]
        assert without == (name in FROM_LOOPS), name


def test_no_wrapper_is_compiled_that_nobody_uses():
    for kernel, said in _kernels().items():
        assert (said in FROM_PYTHON) == (kernel in _called_from_python()), kernel


@pytest.mark.parametrize("name", ["LEAN", "BARE"])
def test_a_kernel_that_counts_no_references_cannot_make_an_array(name):
    import numpy as np

    said = {k: v for k, v in getattr(options, name).items() if k != "cache"}

    @njit(**said)
    def leaks(n):
        return np.zeros(n).sum()

    with pytest.raises(NumbaError):
        leaks(3)
    assert mark_positions.targetoptions["_nrt"] is False
    assert respond.targetoptions["_nrt"] is False


def test_no_kernel_that_makes_arrays_copies_slices():
    """Numba then compiles the words of "shapes differ": seven seconds in each process.

    A value that is no array has a literal, or a name in capitals (`copy_row` is there
    for the others).
    """
    seen = 0
    for module, tree in _parsed().items():
        for node in tree.body:
            if not (_options(node) or "").startswith("FULL"):
                continue
            seen += 1
            for one in ast.walk(node):
                if isinstance(one, ast.Assign) and _is_slice(one.targets[0]):
                    value = ast.unparse(one.value).lstrip("-")
                    plain = isinstance(one.value, ast.Constant) or value.isupper()
                    assert plain, f"{module}.{node.name}: {ast.unparse(one)}"
    assert seen > 30


def _is_slice(target: ast.expr) -> bool:
    if not isinstance(target, ast.Subscript):
        return False
    return any(isinstance(part, ast.Slice) for part in ast.walk(target.slice))
