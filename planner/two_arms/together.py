"""plan_together: both arms pick and place at the same time."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray
from planner.clearance import ContinuousContact
from planner.manipulator import Manipulator
from planner.motion.program.motion_program import Track
from planner.pick_place.cycle_search import CycleSearch
from planner.pick_place.cycles import Cycle, with_intervals
from planner.pick_place.planning import searched
from planner.pick_place.task import PickAndPlace, PlanRequest
from planner.plan import Grip, Plan
from planner.scene.bodies import Scene
from planner.splines import Sketch
from planner.state import State
from planner.two_arms.across import Across, episodes_of
from planner.two_arms.plan import TwoArmPlan, begins_of
from planner.two_arms.program import (
    SCAN_STEP_S,
    ArmTrack,
    JointProgram,
    Solution,
    Timed,
    TrackStep,
    track_program,
)

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class Own:
    """One arm's task in a world without the other arm, and its fastest cycle there."""

    search: CycleSearch
    plan: Plan

    @property
    def cycle(self) -> Cycle:
        return Cycle(self.search.task.legs, tuple(m.trajectory for m in self.plan.moves))


def own_of(
    task: PickAndPlace, manipulator: Manipulator, state: State, others: frozenset[str], margin_m: float
) -> Own:
    side = manipulator.arm.side
    other = next(each for each in LIMBS if each != side)
    alone = evolve(
        manipulator,
        shapes=manipulator.shapes.without(other),
        q_others=manipulator.robot.configuration(dict(state.joints)),
    )
    scene = Scene({b.name: b for b in state.scene if b.name not in others})
    request = PlanRequest(alone, scene, state.q(alone.arm.joint_names), margin_m)
    plan, search = searched(request, task)
    return Own(search, plan)


class Pair:
    def __init__(self, manipulators, owns, state, grip_s, margin_m):
        self.manipulators, self.owns, self.state = manipulators, owns, state
        self.grip_s, self.margin_m = grip_s, margin_m
        self.q_others = manipulators["left"].robot.configuration(dict(state.joints))

    def across(self, plans):
        episodes = {s: episodes_of(plans[s], self.manipulators[s]) for s in LIMBS}
        return Across(self.manipulators, episodes, self.q_others, self.margin_m)

    def track(self, side):
        own = self.owns[side]
        led = own.search.program.led(own.cycle, own.search.contexts)
        if led is None:
            return None
        phases, task = own.search.program.problem()
        phases = with_intervals(phases, led.sketches)
        m = self.manipulators[side]
        track = Track(track_program(phases, 7), task, m.arm, m.limits)
        episodes = episodes_of(own.plan, m)
        steps, phase = [], 0
        for number, step in enumerate(own.plan):
            episode = next(k for k, e in enumerate(episodes) if e.first <= number <= e.last)
            if isinstance(step, Grip):
                steps.append(TrackStep(None, episode))
            else:
                steps.append(TrackStep(phase, episode))
                phase += 1
        return ArmTrack(track, led.obstacles, tuple(steps), self.grip_s), led.sketches

    def timed_plan(self, plans, waits):
        begins = {}
        for side in LIMBS:
            moves = [n for n, step in enumerate(plans[side]) if not isinstance(step, Grip)]
            rests = self.rests[side]
            at = {moves[k]: w for k, w in zip(rests, waits[side], strict=True)}
            begins[side] = begins_of(plans[side], self.grip_s, at)
        return begins
