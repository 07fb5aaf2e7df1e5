"""`--share K/N` runs each test in exactly one of N shares."""

from __future__ import annotations

import pytest

pytest_plugins = ["pytester"]

TESTS = """
import pytest

@pytest.mark.parametrize("number", range(30))
def test(number): pass
"""


def test_each_test_is_in_one_share(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_some=TESTS)

    def collected(*words: str) -> list[str]:
        said = pytester.runpytest_inprocess("-p", "tests.shares", "--collect-only", "-q", *words)
        return [line for line in said.outlines if "::" in line]

    shares = [collected(f"--share={k}/3") for k in (7, 8, 9)]
    assert all(shares)
    assert sorted(test for share in shares for test in share) == sorted(collected())
