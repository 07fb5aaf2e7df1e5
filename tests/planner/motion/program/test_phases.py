"""What is asked for in a phase follows from where its tip is and where it ends."""

from __future__ import annotations

import pytest

from planner.motion.program.phases import Phase


@pytest.mark.parametrize(
    ("phase", "keeps_height"),
    [
        (Phase(4), True),
        (Phase(4, rests=True), True),
        (Phase(4, line=0), False),
        (Phase(4, line=1, enters=True), False),
        (Phase(4, rests=True, at_goal=True), False),
    ],
)
def test_the_tip_keeps_a_height_where_it_is_on_no_line_and_goes_to_no_configuration(
    phase: Phase, keeps_height: bool
) -> None:
    assert phase.keeps_height is keeps_height
