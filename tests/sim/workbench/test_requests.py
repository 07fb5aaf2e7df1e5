"""Mistakes in a request are told in a sentence that says what to write instead."""

from __future__ import annotations

import re
from typing import Any

import pytest
from IPython.lib.pretty import pretty

from baxter_kin import Baxter
from planner.errors import SceneError
from sim import Workbench


@pytest.fixture
def bench(robot: Baxter) -> Workbench:
    """A red block before the left arm, and a blue one."""
    bench = Workbench(robot)
    bench.add_block("red", 0.70, 0.15)
    bench.add_block("blue", 0.70, -0.10)
    return bench


def test_a_block_as_place_is_asked_for_by_onto(bench: Workbench) -> None:
    with pytest.raises(SceneError, match="to put it on 'blue', write onto='blue'"):
        bench.carry("red", to="blue")


def test_a_place_as_block_is_asked_for_by_to(bench: Workbench) -> None:
    onto: Any = (0.7, 0.0)
    with pytest.raises(SceneError, match=r"name of a block, such as 'blue', got \(0.7, 0.0\)"):
        bench.carry("red", onto=onto)


@pytest.mark.parametrize(
    ("to", "hint"),
    [
        ((75.0, 0.0), "are these centimetres? Lengths are in metres: 75 cm is 0.75 m"),
        ((750.0, 0.0), "are these millimetres? Lengths are in metres: 750 mm is 0.75 m"),
    ],
)
def test_a_place_in_other_units_is_asked_about(
    bench: Workbench, to: tuple[float, float], hint: str
) -> None:
    assert str(bench.carry("red", to=to)).endswith(hint)


def test_a_place_beside_the_table_is_not_asked_about(bench: Workbench) -> None:
    assert "are these" not in str(bench.carry("red", to=(1.6, 0.0)))


def test_an_arm_in_the_way_of_the_other_is_named_with_what_to_do(bench: Workbench) -> None:
    assert bench.carry("blue", to=(0.75, 0.0), arm="right").is_done
    refused = bench.carry("blue", to=(0.75, 0.25), arm="left")
    assert "the right arm is in the way: withdraw('right') brings it back" in str(refused)
    assert bench.withdraw("right").is_done
    assert bench.carry("blue", to=(0.75, 0.25), arm="left").is_done


def test_an_arm_that_rests_is_in_nobodys_way(bench: Workbench) -> None:
    bench.add_obstacle("wall", 0.70, 0.30, size_m=(0.3, 0.02, 0.2))
    refused = str(bench.carry("red", to=(0.70, 0.30), arm="left"))
    assert "with wall" in refused
    assert not re.search("withdraw", refused)


def test_a_notebook_shows_the_whole_refusal(bench: Workbench) -> None:
    refused = bench.carry("red", to=(1.6, 0.0))
    assert len(str(refused)) > len(repr(refused))
    assert pretty(refused) == str(refused)  # type: ignore[no-untyped-call]
