"""Tables of rows in one test: all are looked at, and what fails names its row."""

import inspect

import pytest
from rows import each


def test_all_rows_are_looked_at_with_the_fixtures_of_the_test():
    seen = []

    @each("a", [1, 2])
    @each(("b", "c"), [(3, 4), (5, 6)])
    def test(tmp_path, a, b, c):
        seen.append((tmp_path, a, b, c))

    assert list(inspect.signature(test).parameters) == ["tmp_path"]
    test(tmp_path="here")
    assert seen == [("here", a, *bc) for a in (1, 2) for bc in ((3, 4), (5, 6))]


def test_a_row_that_fails_is_named():
    @each("wrong", ["far", "near"])
    @each(("kind", "field"), [(int, "size"), (float, "speed")])
    def test(kind, field, wrong):
        assert (field, wrong) != ("speed", "near"), "it is refused"

    with pytest.raises(AssertionError, match="it is refused") as told:
        test()
    assert told.value.__notes__ == [
        "in row 1 of 2: kind=<class 'float'>, field='speed'",
        "in row 1 of 2: wrong='near'",
    ]


def test_each_of_several_rows_that_fail_is_told():
    @each("number", range(5))
    def test(number):
        assert number % 2

    with pytest.raises(ExceptionGroup, match="3 of 5 rows") as told:
        test()
    notes = [error.__notes__ for error in told.value.exceptions]
    assert notes == [[f"in row {k} of 5: number={k}"] for k in (0, 2, 4)]


def test_a_row_that_raises_nothing_where_it_must_is_named_too():
    @each("value", [1, 0, 2])
    def test(value):
        with pytest.raises(ZeroDivisionError):
            1 / value

    with pytest.raises(BaseExceptionGroup, match="2 of 3 rows") as told:
        test()
    notes = [error.__notes__ for error in told.value.exceptions]
    assert notes == [["in row 0 of 3: value=1"], ["in row 2 of 3: value=2"]]


def test_a_table_of_nothing_and_one_of_other_names_are_mistakes():
    with pytest.raises(AssertionError, match="no rows"):
        each("number", [])
    with pytest.raises(AssertionError, match="no parameter"):
        each("count", [1])(lambda number: None)
    with pytest.raises(ValueError, match="argument 2"):
        each(("a", "b"), [(1,)])(lambda a, b: None)()


def test_a_row_that_is_skipped_leaves_the_others_to_be_looked_at():
    seen = []

    @each("a, b", [(1, 2), (3, 4), (5, 6)])
    def test(a, b):
        if a == 1:
            pytest.skip("it is not here")
        seen.append((a, b))

    with pytest.raises(pytest.skip.Exception, match="1 of 3 rows: it is not here"):
        test()
    assert seen == [(3, 4), (5, 6)]
