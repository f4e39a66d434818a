"""Our own source files as trees, read once for all tests that look at them."""

import ast
from functools import cache
from pathlib import Path


@cache
def tree(file: Path) -> ast.Module:
    """Return what a file says."""
    return ast.parse(file.read_text(encoding="utf-8"))


@cache
def nodes(file: Path) -> list[ast.AST]:
    """Return all that is written in a file."""
    return list(ast.walk(tree(file)))
