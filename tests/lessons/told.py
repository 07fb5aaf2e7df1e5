"""What tests of checks share."""

from __future__ import annotations

import re

from lessons.answers import Feedback, Verdict


def assert_told(said: Feedback, pattern: str) -> None:
    """The answer is wrong, and one sentence says what the pattern finds in it."""
    assert said.verdict is Verdict.WRONG, said
    assert re.search(pattern, said.text), said
    assert said.text.endswith(".")
    assert "\n" not in said.text
