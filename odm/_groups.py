"""Groups of arrays for compiled loops: each array is declared once, beside its name.

A group is a NamedTuple whose defaults say what its arrays are: `array("f8", "n dof")`.
From that its arrays are made (`new`), checked (`check`) and, in the planner's table,
viewed (`odm/search/_state.py`).
"""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from roadmap.errors import BadInput

LIFE = "life"  # holds as long as map, hand and scenery stay
GOAL = "goal"  # is remembered from frame to frame
FRAME = "frame"  # belongs to one frame, or is scratch
BLOCK = "block"  # ids of blocks: uint16, in grids of more than 65535 of them uint32


def block_type(n_blocks: int) -> type[np.unsignedinteger]:
    """Return the type of ids of blocks in a grid of so many; see `BLOCK`."""
    return np.uint16 if n_blocks <= 65535 else np.uint32


class Declared(NamedTuple):
    """What is known of an array before it is made.

    Attributes:
        dtype: numpy's code of it, or BLOCK.
        axes: The length of each axis: a number, a name, or a sum of names ("2*m+1").
            No axis at all: a single number that the group holds itself.
        life: LIFE, GOAL or FRAME.
        fill: What it holds at first.
    """

    dtype: str
    axes: tuple[str, ...]
    life: str
    fill: float


def array(dtype: str, axes: str = "1", life: str = LIFE, fill: float = 0) -> Any:  # noqa: ANN401
    """Declare an array of a group; see `Declared`."""
    return Declared(dtype, tuple(axes.split()), life, fill)


def declared(kind: type) -> dict[str, Declared]:
    """Return what a group's class declares, by name and in order."""
    return kind._field_defaults


def length(axis: str, sizes: dict[str, int]) -> int:
    """Return the length of an axis where the names in it have these sizes."""
    if axis in sizes:
        return sizes[axis]
    return sum(n * sizes[name] if name else n for n, name in _terms(axis))


@lru_cache(maxsize=256)
def _terms(axis: str) -> tuple[tuple[int, str], ...]:
    """Return factor and name of each term of an axis; a number has no name."""
    terms = []
    for term in axis.split("+"):
        factor, _, name = term.rpartition("*")
        n = int(factor or 1)
        terms.append((n * int(name), "") if name.isdigit() else (n, name))
    return tuple(terms)


def new(kind: type, sizes: dict[str, int], **given: object) -> Any:  # noqa: ANN401
    """Return a group of this class: what is not given is made and filled."""
    for name, field in declared(kind).items():
        if name not in given:
            made = np.empty([length(axis, sizes) for axis in field.axes], field.dtype)
            made.fill(field.fill)  # by `zeros` its pages would come in a frame
            given[name] = made
    return kind(**given)


@lru_cache(maxsize=256)
def named_in(kind: type) -> frozenset[str]:
    """Return the names that the axes of a group's class are made of."""
    axes = (axis for field in declared(kind).values() for axis in field.axes)
    return frozenset(name for axis in axes for _, name in _terms(axis) if name)


def check(
    groups: dict[str, tuple[type, tuple]], block: np.dtype, kept: dict[str, int]
) -> dict[str, int]:
    """Refuse groups that compiled loops would read as something else than they are.

    Args:
        groups: The class that is declared and the group, by name.
        block: The type of ids of blocks.
        kept: Lengths of axes that other groups have, by name.

    Returns:
        The lengths of all axes, by name.

    Raises:
        BadInput: Another class, type, rank or length than declared, or an array that is
            not contiguous.
    """
    sizes = dict(kept)
    for name, (kind, group) in groups.items():
        if type(group) is not kind:
            raise BadInput(
                f"{name} is a {type(group).__name__}, but the table holds a "
                f"{kind.__name__} there"
            )
        for (key, field), value in zip(declared(kind).items(), group, strict=True):
            _check_type(f"{name}.{key}", field, value, block)
            for axis, n in zip(field.axes, getattr(value, "shape", ()), strict=True):
                if axis.isidentifier():
                    sizes.setdefault(axis, n)
    for name, (kind, group) in groups.items():
        for (key, field), value in zip(declared(kind).items(), group, strict=True):
            shape = tuple([length(axis, sizes) for axis in field.axes])
            if field.axes and value.shape != shape:
                raise BadInput(
                    f"{name}.{key} has shape {value.shape}, but {shape} is "
                    f"declared ({', '.join(field.axes)})"
                )
    return sizes


def _check_type(name: str, field: Declared, value: object, block: np.dtype) -> None:
    if not field.axes:
        if not isinstance(value, float):
            raise BadInput(f"{name} is {value!r}, but a float is declared")
        return
    dtype = np.dtype(block if field.dtype == BLOCK else field.dtype)
    what = value.dtype if isinstance(value, np.ndarray) else type(value).__name__
    if what != dtype or value.ndim != len(field.axes):
        rank = f" of rank {value.ndim}" if isinstance(value, np.ndarray) else ""
        raise BadInput(
            f"{name} is {what}{rank}, but {dtype} of rank {len(field.axes)} is declared"
        )
    if not value.flags.c_contiguous:
        raise BadInput(f"{name} is not contiguous; make a copy of it")
