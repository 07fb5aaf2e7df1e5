"""Tests that are skipped are counted, explained, and refused where none may be."""

from __future__ import annotations

from collections.abc import Callable

import pytest

pytest_plugins = ["pytester"]

TESTS = """
import pytest

@pytest.fixture(scope="session")
def browser():
    pytest.skip("no browser")

def test_one(browser): pass
def test_two(browser): pass

@pytest.mark.skip(reason="no compiler")
def test_three(): pass

def test_four(): pass

def test_five(): raise AssertionError
"""

Run = Callable[..., pytest.RunResult]


@pytest.fixture
def run(pytester: pytest.Pytester) -> Run:
    """Runs pytest in a folder of its own, with the hooks of `tests.skips`."""
    pytester.makepyfile(test_some=TESTS)
    return lambda words: pytester.runpytest_inprocess("-p", "tests.skips", *words.split())


def test_skipped_tests_are_counted_and_explained_in_one_line_a_reason(run: Run) -> None:
    done = run("--deselect test_some.py::test_five")
    told = [line for line in done.outlines if line.startswith("skipped ")]
    assert sorted(told) == ["skipped 1: no compiler", "skipped 2: no browser"]
    assert done.ret == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "status"),
    [
        ("--no-skips -k three", 1),
        ("--no-skips -k four", 0),
        ("--no-skips -n 1", 1),  # in the processes of pytest-xdist, too
        ("-k five", 1),
    ],
)
def test_where_none_may_be_skipped_the_run_fails(run: Run, words: str, status: int) -> None:
    assert run(words).ret == status
