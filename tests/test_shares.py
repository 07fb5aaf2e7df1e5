"""`--slow-share K/N` runs each slow test in exactly one of N shares, and all others in each."""

from __future__ import annotations

import pytest

pytest_plugins = ["pytester"]

TESTS = """
import pytest

@pytest.mark.slow
@pytest.mark.parametrize("number", range(30))
def test_slow(number): pass

def test_quick(): pass
"""


def test_each_slow_test_is_in_one_share(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_some=TESTS)
    pytester.makeini("[pytest]\nmarkers = slow")

    def collected(*words: str) -> list[str]:
        said = pytester.runpytest_inprocess("-p", "tests.shares", "--collect-only", "-q", *words)
        return [line for line in said.outlines if "::" in line]

    shares = [collected(f"--slow-share={k}/3") for k in (7, 8, 9)]
    assert all(share.pop().endswith("::test_quick") for share in shares)
    assert all(shares)
    assert sorted(test for share in shares for test in share) == sorted(collected())[1:]
