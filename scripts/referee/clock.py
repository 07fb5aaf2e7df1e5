"""What both arms do on their common clock: where all links and bodies are every millisecond.

An arm rests between its steps. Fingers travel at their speed from when a gripper action begins, and
what is pushed or let go moves meanwhile.

A body that both arms handle is where the hand has it that closes first, until that opens; then it
is where the other hand has it. That one closes on it where the first hand has it at that time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from referee.checker import FINGER_SPEED_M_S, MAX_FALL_M, STEP_S, closes, positions
from referee.pairs import Track
from referee.robot import Robot, arm_joints
from referee.solids import Array
from referee.stage import Stage, Thing, closing, openings_m

LIMBS = ("left", "right")

GRAVITY_M_S2 = 9.81

SAME_TIME_S = 1e-9
"""Largest difference of times that is rounding."""


def timed(plan: Any, side: str) -> Iterator[tuple[float, float, Any]]:
    """When each step of an arm begins and ends on the clock, and the step."""
    for begin_s, step in zip(plan.begins_s[side], plan.plans[side].steps, strict=True):
        took_s = float(step.trajectory.knots_s[-1]) if is_move(step) else float(plan.grip_s)
        yield float(begin_s), float(begin_s) + took_s, step


def duration_s(plan: Any) -> float:
    """When the last step of both arms ends, s."""
    return max((end_s for side in LIMBS for _, end_s, _ in timed(plan, side)), default=0.0)


def is_move(step: Any) -> bool:
    """Whether a step moves the arm; others move its fingers."""
    return hasattr(step, "trajectory")


def links_of(robot: Robot, side: str) -> set[str]:
    """The links of an arm and its hand."""
    return robot.below({arm_joints(side)[0]})


@dataclass(frozen=True)
class Hold:
    """When a hand holds a body that the other hand holds, too; times on the clock, s.

    It surely holds the body from `closed_s` to `opens_s`, and may touch it from `closes_s` to
    `open_s`.

    Attributes:
        side: the arm.
        closes_s: when it begins to close.
        closed_s: when it has closed.
        moves_s: when the arm moves for the first time after that.
        rests_s: when the arm rests for the last time before it opens.
        opens_s: when it begins to open.
        open_s: when it is open.
        near: beginnings and ends of the steps before and after that are stated to touch the body,
            rests after them included.
        receiver: the arm to which it hands the body over; empty when it does not.
    """

    side: str
    closes_s: float
    closed_s: float
    moves_s: float
    rests_s: float
    opens_s: float
    open_s: float
    near: tuple[tuple[float, float], ...]
    receiver: str

    @classmethod
    def of(cls, plan: Any, side: str, body: str) -> Hold:
        """From the gripper actions of an arm.

        Raises:
            ValueError: when the hand does not close on the body and open again, just once.
        """
        steps = list(timed(plan, side))
        grips = [n for n, (*_, step) in enumerate(steps) if not is_move(step) and step.body == body]
        if [closes(steps[n][2]) for n in grips] != [True, False]:
            reason = "does not close on it and open again just once, which is not judged"
            raise ValueError(f"both arms handle {body}; the {side} hand {reason}")
        first, last = grips
        closes_s, closed_s, _ = steps[first]
        opens_s, open_s, release = steps[last]
        moves = [steps[n] for n in range(first + 1, last) if is_move(steps[n][2])]
        ends_s = [*(begin_s for begin_s, _, _ in steps[1:]), np.inf]
        near = tuple(
            (begin_s, next_s)
            for n, ((begin_s, _, step), next_s) in enumerate(zip(steps, ends_s, strict=True))
            if (n < first or n >= last)
            and any(each.body == body and each.other == f"{side} hand" for each in step.contacts)
        )
        moves_s, rests_s = (moves[0][0], moves[-1][1]) if moves else (opens_s, closed_s)
        times_s = closes_s, closed_s, moves_s, rests_s, opens_s, open_s
        return cls(side, *times_s, near, release.receiver)


@dataclass(frozen=True)
class Motion:
    """One arm at all samples of the clock.

    Attributes:
        stage: after the last step.
        joints: of arm and fingers, shape (n,) each, by name.
        poses: of the bodies that the arm handles, shape (n, 4, 4), by name.
        missed: bodies on which the fingers close without meeting them.
    """

    stage: Stage
    joints: Mapping[str, Array]
    poses: Mapping[str, Array]
    missed: frozenset[str]


@dataclass(frozen=True)
class Clock:
    """Both arms at all samples of the clock.

    Attributes:
        plan: of both.
        times_s: shape (n,).
        things: the bodies at first, by name.
        motions: of each arm.
        links: the solids of the links of each arm.
        T_tips: poses of each tip, shape (n, 4, 4).
        shared: the body that both arms handle, if any.
        holds: of that body, the one first that closes first; else empty.
    """

    plan: Any
    times_s: Array
    things: Mapping[str, Thing]
    motions: Mapping[str, Motion]
    links: Mapping[str, Mapping[str, list[Track]]]
    T_tips: Mapping[str, Array]
    shared: str | None
    holds: tuple[Hold, ...]

    @classmethod
    def of(
        cls, plan: Any, robot: Robot, handled: Mapping[str, set[str]], shared: str | None
    ) -> Clock:
        """Both arms of a plan.

        Args:
            plan: of both.
            robot: all links.
            handled: names of the bodies that each arm handles.
            shared: the body that both do, if any.
        """
        end_s = duration_s(plan)
        times_s = np.append(np.arange(0.0, end_s, STEP_S), end_s)
        stages = {side: Stage.of(plan.plans[side], plan.start, robot) for side in LIMBS}
        holds = [] if shared is None else [Hold.of(plan, side, shared) for side in LIMBS]
        holds.sort(key=lambda hold: hold.closes_s)
        motions: dict[str, Motion] = {}
        for side in [hold.side for hold in holds] or LIMBS:
            stage = stages[side]
            if motions and shared is not None:
                (first,) = motions.values()
                T = first.poses[shared][_sample(times_s, holds[-1].closes_s)]
                stage = stage.with_thing(stage.things[shared].at(T))
            steps = list(timed(plan, side))
            motions[side] = _motion(stage, steps, handled[side], times_s)
        joints: dict[str, Any] = {name: float(value) for name, value in plan.start.joints.items()}
        T = robot.poses({**joints, **motions["left"].joints, **motions["right"].joints})
        links = {
            side: {
                link: [Track(solid, T[link]) for solid in robot.solids[link]]
                for link in sorted(links_of(robot, side))
            }
            for side in LIMBS
        }
        T_tips = {side: T[f"{side}_gripper"] for side in LIMBS}
        things = {body.name: Thing.of(body) for body in plan.start.scene}
        return cls(plan, times_s, things, motions, links, T_tips, shared, tuple(holds))

    def sample(self, time_s: float) -> int:
        """The last sample up to a time."""
        return _sample(self.times_s, time_s)

    def when(self, sample: int) -> tuple[str, float]:
        """What both arms do at a sample, and its time."""
        time_s = float(self.times_s[sample])
        begun = {
            side: [step.label for begin_s, _, step in timed(self.plan, side) if begin_s <= time_s]
            for side in LIMBS
        }
        return ", ".join(f"{side} arm: {labels[-1:]}" for side, labels in begun.items()), time_s

    def during(self, begin_s: float, end_s: float) -> Any:
        """Whether each sample is in an interval."""
        return (self.times_s >= begin_s - SAME_TIME_S) & (self.times_s < end_s - SAME_TIME_S)


def _sample(times_s: Array, time_s: float) -> int:
    return max(int(np.searchsorted(times_s, time_s + SAME_TIME_S, side="right")) - 1, 0)


def _motion(
    stage: Stage, steps: list[tuple[float, float, Any]], names: set[str], times_s: Array
) -> Motion:
    """One arm on the clock, step after step; after each it rests."""
    q = np.tile([stage.joints[name] for name in arm_joints(stage.limb)], (len(times_s), 1))
    opening_m = np.full(len(times_s), stage.opening_m)
    held = {} if stage.in_hand is None else {stage.in_hand.name: stage.in_hand}
    things = {name: thing for name, thing in {**stage.things, **held}.items() if name in names}
    T = {name: np.tile(thing.T, (len(times_s), 1, 1)) for name, thing in things.items()}
    missed = set()
    for begin_s, _, step in steps:
        first = int(np.searchsorted(times_s, begin_s))
        passed_s = times_s[first:] - begin_s
        if is_move(step):
            q[first:] = positions(step.trajectory, passed_s)
            if stage.held is not None and stage.T_tip_held is not None:
                T[stage.held.name][first:] = stage.tips(q[first:]) @ stage.T_tip_held
            stage = stage.moved(np.array(step.trajectory.q)[-1])
        elif closes(step):
            thing = None if step.body is None else stage.things[step.body]
            found = closing(stage, thing)
            at = _traveller(found.openings_m)
            opening_m[first:] = at(passed_s, found.openings_m)
            if thing is not None:
                for axis in range(3):
                    T[thing.name][first:, axis, 3] = at(passed_s, found.T_things[:, axis, 3])
                if not found.holds:
                    missed.add(thing.name)
            stage = stage.closed(thing, found)
        else:
            released, stage = stage.held, stage.released()
            openings = openings_m(stage.opening_m, stage.goal_of(step))
            opening_m[first:] = _traveller(openings)(passed_s, openings)
            stage = stage.opened(float(openings[-1]))
            if released is not None and not step.receiver:
                thing = stage.things[released.name]
                drop_m = stage.drop_m(thing, MAX_FALL_M)
                T[released.name][first:] = thing.T
                T[released.name][first:, 2, 3] -= np.minimum(
                    0.5 * GRAVITY_M_S2 * passed_s**2, drop_m
                )
                stage = stage.with_thing(thing.raised(-drop_m))
    joints = {**stage.arm(q), **stage.fingers(opening_m)}
    return Motion(stage, joints, T, frozenset(missed))


def _traveller(openings: Array) -> Callable[[Array, Array], Array]:
    """Values at times since fingers began to travel through some positions."""
    passed_s = np.append(0.0, np.abs(np.diff(openings)).cumsum()) / FINGER_SPEED_M_S
    return lambda times_s, values: np.interp(times_s, passed_s, values)
