"""`--slow-share K/N` runs each slow test in exactly one of N shares, and all others in each."""

from __future__ import annotations

import pytest

pytest_plugins = ["pytester"]

TESTS = """
import pytest

@pytest.mark.slow
@pytest.mark.parametrize("number", range(30))
def test_slow(number): pass

@pytest.mark.campaign
@pytest.mark.parametrize("number", range(9))
def test_campaign(number): pass

def test_quick(): pass
"""


def test_each_slow_test_is_in_one_share(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_some=TESTS)
    pytester.makeini("[pytest]\nmarkers =\n  slow\n  campaign")

    def collected(*words: str) -> list[str]:
        said = pytester.runpytest_inprocess("-p", "tests.shares", "--collect-only", "-q", *words)
        return [line for line in said.outlines if "::" in line]

    shares = [collected(f"--slow-share={k}/3") for k in (7, 8, 9)]
    assert all(share.pop().endswith("::test_quick") for share in shares)
    assert all(shares)
    every = [test for test in collected() if not test.endswith("::test_quick")]
    assert sorted(test for share in shares for test in share) == sorted(every)
