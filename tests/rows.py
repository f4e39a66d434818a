"""A table of cheap rows is one test: pytest and xdist take 4 ms for each of theirs."""

import inspect
import reprlib
from collections.abc import Callable, Iterable

import pytest

SHORT = reprlib.Repr()
SHORT.maxstring = SHORT.maxother = 90


def each(names: str | tuple[str, ...], rows: Iterable) -> Callable:
    """Have a test look at every row, as `pytest.mark.parametrize` does, in one test.

    All rows are looked at; one that fails is named by what it holds, and of several
    each is told. Where none fails and one is skipped, the test says so. Fixtures are
    those of the one test: the rows share them.
    """
    rows = list(rows)
    assert rows, "a table of no rows tests nothing"
    if isinstance(names, str) and "," in names:
        names = tuple(name.strip() for name in names.split(","))

    def of(test: Callable) -> Callable:
        def run(**fixtures) -> None:
            failed, skipped = [], []
            for number, row in enumerate(rows):
                given = {names: row} if isinstance(names, str) else _named(names, row)
                try:
                    test(**fixtures, **given)
                except pytest.skip.Exception as left_out:
                    skipped.append(left_out)
                except (Exception, pytest.fail.Exception) as error:
                    told = ", ".join(f"{k}={SHORT.repr(v)}" for k, v in given.items())
                    error.add_note(f"in row {number} of {len(rows)}: {told}")
                    failed.append(error)
            if len(failed) == 1:
                raise failed[0]
            if failed:
                raise BaseExceptionGroup(f"{len(failed)} of {len(rows)} rows", failed)
            if skipped:
                pytest.skip(f"{len(skipped)} of {len(rows)} rows: {skipped[0]}")

        of_row = {names} if isinstance(names, str) else set(names)
        asked = inspect.signature(test).parameters
        assert of_row <= set(asked), f"no parameter {of_row - set(asked)}"
        run.__signature__ = inspect.Signature(
            [p for name, p in asked.items() if name not in of_row]
        )
        run.__name__, run.__doc__ = test.__name__, test.__doc__
        run.__module__, run.__qualname__ = test.__module__, test.__qualname__
        return run

    return of


def _named(names: tuple[str, ...], row: Iterable) -> dict:
    return dict(zip(names, row, strict=True))
