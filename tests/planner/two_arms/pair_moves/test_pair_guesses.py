"""Guesses for bodies in both hands that end in other solutions of the goal."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.validation import FloatArray
from planner import Manipulator, State, context_of_both, limits_of_both
from planner.collision.mover import Mover
from planner.motion.paths.straight_line import DEFAULT_TOLERANCE
from planner.two_arms.pair_moves.pair_guesses import PairGuesses, PairTask, goal_solutions
from tests.conftest import at
from tests.planner.two_arms.pair_moves import carries

EASED = np.linspace(0.0, 1.0, 25)


@pytest.fixture(scope="module")
def guesses(manipulators: dict[str, Manipulator]) -> PairGuesses:
    """Those of a tray that both hands hold, 10 cm up."""
    _, state = carries.tray(manipulators)
    return guesses_of(manipulators, state)


def guesses_of(manipulators: dict[str, Manipulator], state: State) -> PairGuesses:
    limits = limits_of_both(manipulators)
    arms = tuple(manipulators[side].arm for side in ("left", "right"))
    q = np.concatenate([each.start for each in arms])
    half = pin.SE3(arms[0].T_base_tip(q[:7]))
    tips = tuple(
        arm.T_base_tip(own).actInv(half) for arm, own in zip(arms, np.split(q, 2), strict=True)
    )
    goal = at(0.0, 0.0, 0.05) * half
    task = PairTask(context_of_both(manipulators, state), limits, Mover(arms), q, tips, goal)
    return PairGuesses(task, DEFAULT_TOLERANCE, goal_solutions(task.mover, tips, goal))


def relative(robot: Baxter, q: FloatArray) -> pin.SE3:
    return robot.arm("left").T_base_tip(q[:7]).actInv(robot.arm("right").T_base_tip(q[7:]))


def test_the_way_to_another_goal_keeps_the_relative_pose(
    robot: Baxter, guesses: PairGuesses
) -> None:
    wanted = relative(robot, guesses.task.q_start)
    q_goal = np.concatenate(
        [
            found[np.abs(found - q).max(axis=1).argmin()]
            for found, q in zip(guesses.goals, np.split(guesses.task.q_start, 2), strict=True)
        ]
    )
    qs = guesses.held_together(q_goal, EASED)
    assert qs is not None
    np.testing.assert_allclose(qs[-1], q_goal, atol=1e-5)
    for q in qs:
        assert relative(robot, q).isApprox(wanted, 1e-5)
