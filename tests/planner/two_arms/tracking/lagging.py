"""Simulated arms that follow a plan of both with a lag, each by another course."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from baxter_kin.validation import FloatArray
from planner import Grip, Response, TwoArmPlan
from planner.motion.tracking_tube import SETTLED_RAD
from planner.pick_place.tracking import START_RAD
from planner.trajectory import Trajectory
from tests.planner.two_arms.pairs import SIDES

STEP_S = 4e-3
TICK_STEPS = 3
"""Set-points come every 12 ms here: a tick, and as late as 2 ms."""

EXACT_STEP_S = 1e-3
"""Time between two set-points of an arm that follows exactly."""

RAMP_S = 0.2
"""How long the clock takes to slow to rest."""


def slowing_s(response: Response) -> float:
    """By how much the clock passes at most while it slows to rest, or begins again."""
    return response.speed * (0.5 * RAMP_S + 4.0 * STEP_S)


class Instant(NamedTuple):
    """What both arms do at one instant.

    Attributes:
        clock_s: on the common clock.
        acted: for each arm, the number of its last step that has ended; of a gripper action, only
            once its fingers have acted.
        q: joints of both arms, shape (7,), rad.
    """

    clock_s: float
    acted: dict[str, int]
    q: dict[str, FloatArray]


class _Act:
    """A gripper action, which takes a while from when its arm has settled."""

    def __init__(self, begin_s: float, due_s: float, number: int, takes_s: float) -> None:
        self.begin_s, self.due_s, self.number, self._takes_s = begin_s, due_s, number, takes_s
        self._settled_s = np.inf
        self.is_done = False

    def advance(self, now_s: float, off_rad: float) -> None:
        """Go on; `off_rad` is how far the arm is measured off its goal."""
        if self._settled_s == np.inf and off_rad <= SETTLED_RAD:
            self._settled_s = now_s
        self.is_done = self.is_done or now_s >= self._settled_s + self._takes_s


def followed(
    plan: TwoArmPlan,
    responses: Mapping[str, Response],
    rng: np.random.Generator,
    *,
    skew_s: float,
) -> Iterator[Instant]:
    """What both arms do from the beginning until they rest at the end.

    The clock waits for the grippers: it slows to rest before an action is due, and goes on when it
    is done. Both arms are sent set-points of one time on it; each arm has them a little later, one
    later than the other by the skew at most.
    """
    speed = responses["left"].speed
    motions = {side: plan.motion_of(side) for side in SIDES}
    delays = dict(zip(SIDES, rng.permutation([0.0, rng.uniform(0.0, skew_s)]), strict=True))
    y = {side: motions[side].q_start + rng.uniform(-START_RAD, START_RAD, 7) for side in SIDES}
    fixed = {
        side: rng.uniform(*of.lag_s.T) if rng.random() < 0.5 else None
        for side, of in responses.items()
    }
    acts = {
        side: [
            _Act(each.begin_s, each.end_s, number, rng.uniform(0.1, 2.0))
            for number, each in enumerate(plan.steps_of(side))
            if isinstance(each.step, Grip)
        ]
        for side in SIDES
    }
    clocks, rates, rate, clock_s = [0.0], [1.0], 1.0, 0.0
    aims = dict(y)
    for step in range(200_000):
        now_s = step * STEP_S
        pending = [act for own in acts.values() for act in own if not act.is_done]
        begun = [act for act in pending if act.begin_s <= clock_s]
        due_s = min((act.due_s for act in begun), default=np.inf)
        stopping_s = 0.5 * speed * RAMP_S * rate**2 + 2.0 * speed * STEP_S
        slows = due_s - clock_s <= stopping_s
        rate = min(max(rate + (-1.0 if slows else 1.0) * STEP_S / RAMP_S, 0.0), 1.0)
        clock_s = min(clock_s + speed * rate * STEP_S, due_s, plan.duration_s)
        clocks.append(clock_s)
        rates.append(rate)
        q, acted = {}, {}
        for side in SIDES:
            response, motion = responses[side], motions[side]
            if step % TICK_STEPS == 0:
                age = int((delays[side] + rng.uniform(0.0, 0.9 * response.late_s)) / STEP_S)
                sent = max(len(clocks) - 1 - age, 0)
                at = motion.sample(clocks[sent])
                lead = response.lead_s * speed * rates[sent] * at.v
                aims[side] = np.clip(at.q + lead, motion.limits.q_min, motion.limits.q_max)
            own = fixed[side]
            lag_s = rng.uniform(*response.lag_s.T) if own is None else own
            with np.errstate(divide="ignore"):
                y[side] = aims[side] + (y[side] - aims[side]) * np.exp(-STEP_S / lag_s)
            error = response.settled_error_rad
            q[side] = y[side] + rng.choice([-1.0, 1.0], 7) * error
            off = y[side] + rng.uniform(-1.0, 1.0, 7) * error - motion.sample(clock_s).q
            for act in acts[side]:
                if act.begin_s <= clock_s and not act.is_done:
                    act.advance(now_s, float(np.abs(off).max()))
                    break
            acted[side] = _acted(plan, side, acts[side], clock_s)
        yield Instant(clock_s, acted, q)
        if clock_s >= plan.duration_s and not pending:
            return


def _acted(plan: TwoArmPlan, side: str, acts: list[_Act], clock_s: float) -> int:
    """The number of the last step of an arm that has ended; -1 before the first."""
    ended = -1
    for number, each in enumerate(plan.steps_of(side)):
        of = next((act for act in acts if act.number == number), None)
        if each.end_s > clock_s if of is None else not of.is_done:
            return ended
        ended = number
    return ended


def exactly_followed(
    motion: Trajectory, lag_s: float, speed: float, clock_s: FloatArray
) -> FloatArray:
    """Positions of an arm of one lag that follows a motion from its start, shape (k, 7), rad.

    Args:
        motion: on the clock, which goes at an even rate and stands at its end.
        lag_s: of all joints.
        speed: of the clock.
        clock_s: increasing times, shape (k,), s; the clock is taken to go on after its end.
    """
    times_s = np.arange(0.0, clock_s[-1] / speed + EXACT_STEP_S, EXACT_STEP_S)
    aims = motion.sample(np.minimum(speed * times_s, motion.duration)).q
    y = np.array(aims)
    remains = np.exp(-EXACT_STEP_S / lag_s) if lag_s else 0.0
    for number in range(1, len(y)):
        y[number] = aims[number] + (y[number - 1] - aims[number]) * remains
    found: FloatArray = y[np.searchsorted(times_s, clock_s / speed).clip(max=len(y) - 1)]
    return found
