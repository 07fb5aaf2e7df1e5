"""Simulation: executes plans in a world, step by step, and notifies observers.

Time is exact: moves and finger travels take what they take, and snapshots are taken at whole ticks,
so nothing is rounded to the tick and the same plans give the same snapshots every time. There are
no blind waits: after a grasp the next step begins as soon as the pads are on the body, plus the
dwell that was requested.

Moves and opening fingers are checked for contacts (`sim.world.contacts`), whatever a plan states of
itself. A plan is not checked where a certificate of this very plan is given (`planner.verify`), as
long as the world is as each of its steps states it.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator

import numpy as np

from baxter_kin.display import OneLine, count, millimetres, phrase, seconds
from baxter_kin.fields import array, field, frozen, scalar
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray, expect, finite_scalar
from planner import (
    Body,
    Certificate,
    Grip,
    GripperAction,
    Move,
    Plan,
    TwoArmCertificate,
    TwoArmPlan,
)
from planner.collision.robot.robot_body import identity_of
from planner.grasping.finger_travel import FINGER_SPEED_M_S
from planner.plan import Step
from planner.two_arms.plan import SAME_TIME_S
from sim.errors import SimulationError
from sim.events import EventKind, Observer, stop_text
from sim.streams import Activities, Activity, Stream, run_streams
from sim.timeline import DEFAULT_TICK_S, Timeline
from sim.world.contacts import Contact, ContactWatch, is_as_stated, left_out
from sim.world.gripper import Gripper
from sim.world.world import World

MAX_WAIT_S = 86_400.0

START_TOLERANCE_RAD = 1e-6
"""How far an arm may stand from where a plan starts."""

ROBOT_DWELL_S = 1.0
"""Pause of a real arm before and after its gripper acts, as in the original demo. At speed ratio
0.3 it settles within 0.8 s, and the script that plays files back commands grippers at 20 Hz."""

MAX_DWELL_S = 60.0
"""Longer ones are mistakes."""

WAITS = "waits"
"""What the caption says of an arm that stands still while the other one works."""

_LOG = logging.getLogger(__name__)


@frozen(error=SimulationError, eq=True)
class Dwell:
    """Pauses after gripper actions; none by default, where the original waits a second.

    Attributes:
        after_grasp_s: once both pads are on the body.
        after_release_s: once the fingers are open.
    """

    after_grasp_s: float = scalar(least=0.0, default=0.0)
    after_release_s: float = scalar(least=0.0, default=0.0)


@frozen(error=SimulationError, eq=True)
class Outcome:
    """How the execution of a plan ended.

    Attributes:
        failure: None, or why it stopped early, as one sentence.
        duration_s: its simulated duration.
        hits: what the arm, its hand or what it held ran into, in order, each at the depth at which
            it was first found. Bodies that give way stop no move, so a success may have some.
    """

    failure: str | None
    duration_s: float
    hits: tuple[Contact, ...] = field(default=(), kw_only=True)

    @property
    def is_success(self) -> bool:
        """Whether every step was executed."""
        return self.failure is None

    def _facts(self) -> tuple[str, ...]:
        failure = "success" if self.failure is None else f"failed: {self.failure}"
        return seconds(self.duration_s), failure, self._phrase_of_hits()

    def _phrase_of_hits(self) -> str:
        """The hits as a phrase, the deepest by name; empty without any."""
        if not self.hits:
            return ""
        worst = max(self.hits, key=lambda hit: hit.depth_m)
        names = f"{phrase(worst.mover)} {millimetres(worst.depth_m)} inside {phrase(worst.other)}"
        return f"{count(len(self.hits), 'hit')}: {names}"


@frozen(error=SimulationError)
class Strokes:
    """What a pen in the hand draws while a plan is executed.

    Attributes:
        on: name of the body that it draws on.
        times_s: from when to when it touches, increasing, shape (k, 2), s from the plan's start.

    Raises:
        SimulationError: when the times do not increase.
    """

    on: str
    times_s: FloatArray = array(None, 2)

    def __attrs_post_init__(self) -> None:
        if (np.diff(self.times_s.reshape(-1), prepend=0.0) < 0.0).any():
            raise SimulationError("the times of strokes must increase, from 0 on")

    def _facts(self) -> tuple[str, ...]:
        return count(len(self.times_s), "stroke"), f"on {phrase(self.on)}"


class Simulation(OneLine):
    """A world in time.

    Attributes:
        world: robot and bodies.
        grippers: the grippers by side; a side without fingers has none.
    """

    def __init__(
        self,
        world: World,
        observers: Iterable[Observer] = (),
        *,
        tick_s: float = DEFAULT_TICK_S,
        dwell: Dwell | None = None,
        check_contacts: bool = True,
    ) -> None:
        """Start at time zero.

        Args:
            world: robot and bodies.
            observers: notified in this order, first of the initial state.
            tick_s: time between snapshots, at least `MIN_TICK_S`.
            dwell: pauses after gripper actions.
            check_contacts: whether steps without a certificate are checked for contacts; without,
                the arm passes through everything.

        Raises:
            SimulationError: when `tick_s` is not such a number, or another argument has the wrong
                type.
        """
        self.world = expect(world, World, "world", SimulationError)
        self.grippers = {side: Gripper(world, side) for side in world.hands}
        self._timeline = Timeline(world, self.grippers, observers, tick_s)
        self._watch = ContactWatch(world)
        self._checks_contacts = expect(check_contacts, bool, "check_contacts", SimulationError)
        self._is_proven = False  # of this execution: whether the certificate counts so far
        self._dwell = Dwell() if dwell is None else expect(dwell, Dwell, "dwell", SimulationError)
        self._hits: list[Contact] = []  # of this execution
        self._pen: deque[tuple[float, EventKind, str, Body]] = deque()  # likewise, still to come
        self._labels: dict[str, str] = {}  # of both arms; empty while one arm executes a plan
        self._title = ""
        self._timeline.begin()

    @property
    def time_s(self) -> float:
        """Simulated time since the start."""
        return self._timeline.time_s

    def enable(self) -> None:
        """Enable the robot, as the original does before it moves."""
        self._timeline.notify(EventKind.ENABLED, "robot enabled")

    def spawn(self, body: Body) -> None:
        """Add a body; a movable one falls on what is below it.

        Raises:
            SceneError: when the name is taken; of a movable body also when it would be inside
                another, or what is below it is too steep.
        """
        self._timeline.spawn(body)

    def delete(self, name: str) -> None:
        """Remove a body."""
        self._timeline.delete(name)

    def wait(self, duration_s: float) -> None:
        """Let time pass."""
        if finite_scalar(duration_s, "duration_s", SimulationError) < 0.0:
            raise SimulationError(f"time only goes forward; cannot wait {duration_s} s")
        if duration_s > MAX_WAIT_S:
            raise SimulationError(f"wait at most {MAX_WAIT_S:g} s at once, got {duration_s:g}")
        self._timeline.pass_s(duration_s)

    def execute(
        self,
        plan: Plan | TwoArmPlan,
        title: str = "",
        *,
        certificate: Certificate | TwoArmCertificate | None = None,
        unverified: bool = False,
        strokes: Strokes | None = None,
    ) -> Outcome:
        """Execute every step of a plan, or stop at the first that fails.

        A plan without a certificate, or with one that is not valid or of another plan, is executed
        after a warning in the log, and its steps are checked for contacts.

        The steps of a plan of both arms begin when its clock says. A gripper action takes `grip_s`
        on the clock, whatever the fingers' travel, so no `Dwell` is added. When a step of one arm
        fails, both arms stop where they are at that instant, in the middle of a move, too: this is
        kinematics, and braking along the way is not simulated. The other hand's fingers end what
        they do.

        Args:
            plan: a valid plan that starts where its arm stands, or both arms.
            title: put before each caption.
            certificate: the result of `verify`, or of `verify_both`, for this very plan; it is not
                checked for contacts as long as the world is as its steps state it.
            unverified: whether the certificate is missing on purpose, so that nothing is logged.
            strokes: what a pen in the hand draws meanwhile, which observers are notified of.

        Raises:
            SimulationError: when the plan is invalid, is for another robot or starts elsewhere;
                nothing has moved then.
        """
        expect(title, str, "title", SimulationError)
        self._check_start(plan)
        is_meant = expect(unverified, bool, "unverified", SimulationError)
        fault = _certificate_fault(plan, certificate)
        if fault and not is_meant:
            _LOG.warning("%s", fault)
        if strokes is not None and isinstance(plan, TwoArmPlan):
            raise SimulationError("strokes are of one arm; leave them out for a plan of both")
        started_s = self.time_s
        self._hits, self._title, self._is_proven = [], title, not fault
        self._pen = deque(self._pen_events(strokes))
        if isinstance(plan, TwoArmPlan):
            streams = [Stream(side, self._on_clock(plan, side)) for side in LIMBS]
            self._labels = dict.fromkeys(LIMBS, WAITS)
        else:
            streams = [Stream(plan.limb, self._all_of(plan))]
            self._labels = {}
        failure = run_streams(streams, self._timeline, self._needed_watch, self._hit)
        self._lift_pen(streams[0].limb)
        return Outcome(failure, self.time_s - started_s, hits=tuple(self._hits))

    def finish(self) -> None:
        """Show the world as it is now, unless that was done; a run ends between two ticks."""
        self._timeline.finish()

    def _facts(self) -> tuple[str, ...]:
        return seconds(self.time_s), repr(self.world)

    def _check_start(self, plan: Plan | TwoArmPlan) -> None:
        if not isinstance(plan, TwoArmPlan):
            expect(plan, Plan, "plan", SimulationError)
        if plan.failure is not None:
            raise SimulationError(f"an invalid plan cannot be executed: {plan.failure}")
        for each in plan.plans.values() if isinstance(plan, TwoArmPlan) else (plan,):
            self._check_robot(each)
            offset = float(np.abs(self.world.arm_q(each.limb) - each.q_start).max())
            if offset > START_TOLERANCE_RAD:
                raise SimulationError(
                    f"the plan starts {offset:.3g} rad from where the {each.limb} arm stands; plan "
                    "from there"
                )

    def _check_robot(self, plan: Plan) -> None:
        """The plan must be for this very robot, as far as it says for which it is."""
        own = identity_of(self.world.robot, self.world.shapes.body)
        difference = "" if plan.robot is None else own.difference(plan.robot)
        if difference:
            raise SimulationError(f"the plan is for another robot: {difference}; plan for this one")
        if any(isinstance(step, Grip) for step in plan):
            self.world.hand(plan.limb)

    def _needed_watch(self) -> ContactWatch | None:
        """What finds contacts; None where they are not checked now."""
        return self._watch if self._checks_contacts and not self._is_proven else None

    def _compare(self, step: Step, others: Collection[str] | None = None) -> None:
        """Let the certificate count no longer where the world is not as a step states it."""
        self._is_proven = self._is_proven and is_as_stated(self.world, step, others)

    def _all_of(self, plan: Plan) -> Activities:
        """All steps of a plan, one right after the other."""
        for step in plan:
            self._show_step(plan.limb, step.label)
            self._compare(step)
            failure = yield from self._do(step)
            if failure is not None:
                return failure
        return None

    def _on_clock(self, plan: TwoArmPlan, side: str) -> Activities:
        """The steps of one arm at their times on the clock.

        Before each, the world is compared with it twice: as soon as the previous step has ended,
        as the other arm moves on past what that has left, and when it begins.
        """
        zero_s = end_s = self.time_s
        for timed, others in zip(plan.steps_of(side), left_out(plan, side), strict=True):
            begin_s, end_s = zero_s + timed.begin_s, zero_s + timed.end_s
            self._compare(timed.step, others)
            yield Activity(
                0.0
            )  # the other arm, whose step ends now, too, compares before this acts
            yield from self._wait_until(begin_s, side)
            self._compare(timed.step, others)
            self._show_step(side, timed.step.label)
            failure = yield from self._do(timed.step)
            if failure is not None:
                return f"{side} arm, {failure}"
            if self.time_s > end_s + SAME_TIME_S:
                took_s, given_s = self.time_s - begin_s, end_s - begin_s
                return (
                    f"{side} arm, {timed.step.label}: took {took_s:.2f} s, longer than the "
                    f"{given_s:.2f} s on the clock"
                )
        yield from self._wait_until(end_s, side)
        self._show_step(side, WAITS)
        return None

    def _wait_until(self, time_s: float, side: str) -> Activities:
        """Let an arm stand until a time."""
        if time_s > self.time_s + SAME_TIME_S:
            self._show_step(side, WAITS)
            yield Activity(time_s - self.time_s)
        return None

    def _show_step(self, side: str, label: str) -> None:
        """Put what an arm does into the caption; of two arms, what each of them does."""
        if self._labels:
            self._labels[side] = label
            label = ", ".join(f"{each} arm: {own}" for each, own in self._labels.items())
        self._timeline.caption = f"{self._title}{label}"

    def _do(self, step: Step) -> Activities:
        """What an arm does in one step."""
        if isinstance(step, Move):
            return self._move(step)
        return self._close(step) if step.action is GripperAction.CLOSE else self._open(step)

    def _move(self, move: Move) -> Activities:
        """Follow a move; the pen may draw meanwhile."""
        begin_s, text = self.time_s, f"{self._title}{move.label}"
        self._timeline.notify(EventKind.MOVE_STARTED, text, move.limb, move=move)
        while self._pen and self._pen[0][0] <= begin_s + move.trajectory.duration:
            time_s, kind, text, body = self._pen.popleft()
            yield self._part(move, self.time_s - begin_s, time_s - begin_s)
            self._timeline.notify(kind, text, move.limb, body=body)
        first_s = self.time_s - begin_s
        yield self._part(move, first_s, move.trajectory.duration)
        return None

    def _part(self, move: Move, first_s: float, end_s: float) -> Activity:
        """A move from a time since its beginning to another."""

        def path(times_s: FloatArray) -> FloatArray:
            q: FloatArray = move.trajectory.sample(np.clip(first_s + times_s, 0.0, end_s)).q
            return q

        duration_s = end_s - first_s
        ticks_s = self._timeline.ticks_until(self.time_s + duration_s) - self.time_s
        at_ticks = dict(zip(ticks_s.tolist(), path(ticks_s), strict=True))  # sampled all at once

        def follow(time_s: float) -> None:
            q = at_ticks.get(time_s)
            self.world.move_arm(move.limb, path(np.array(time_s)) if q is None else q)

        return Activity(duration_s, follow, label=move.label, path=path)

    def _pen_events(self, strokes: Strokes | None) -> Iterator[tuple[float, EventKind, str, Body]]:
        """When the pen touches and leaves what it draws on, from now on."""
        if strokes is None:
            return
        body = self.world.body(expect(strokes, Strokes, "strokes", SimulationError).on)
        times_s = (self.time_s + strokes.times_s).tolist()
        for number, (down_s, up_s) in enumerate(times_s, 1):
            text = f"stroke {number} of {len(times_s)}"
            yield down_s, EventKind.PEN_DOWN, f"{text} begins", body
            yield up_s, EventKind.PEN_UP, f"{text} ends", body

    def _lift_pen(self, limb: str) -> None:
        """End the stroke that a plan was stopped in."""
        if self._pen and self._pen[0][1] is EventKind.PEN_UP:
            _, kind, text, body = self._pen.popleft()
            self._timeline.notify(kind, text, limb, body=body)

    def _close(self, grip: Grip) -> Activities:
        """Close the fingers on what is between the pads, which push it on their way."""
        gripper, timeline, limb = self.grippers[grip.limb], self._timeline, grip.limb
        closing = gripper.closing(grip.body)
        yield self._slide(
            limb,
            closing.finger_m,
            lambda _: gripper.close_to(closing, self.world.finger_m(limb)),
        )
        gripper.finish(closing)
        timeline.pushed(limb, closing)
        if closing.grasp is None:
            return f"{grip.label}: {timeline.missed(limb, closing, grip.body)}"
        timeline.grasped(limb, closing)
        yield Activity(self._dwell.after_grasp_s)
        if grip.body is not None and closing.body != grip.body:
            return f"{grip.label}: grasped {closing.body} instead of {grip.body}"
        return None

    def _open(self, grip: Grip) -> Activities:
        """Open the fingers, while what they release falls to its rest."""
        timeline, world, limb = self._timeline, self.world, grip.limb
        name = self.grippers[limb].release()
        finger_m, failure = self._opening(grip)
        if name is None:
            yield self._slide(limb, finger_m)
            timeline.opened(limb)
        elif world.is_held(name):  # by the other hand
            timeline.released(limb, name)
            yield self._slide(limb, finger_m)
        else:
            timeline.released(limb, name)
            rest = world.rest(name)
            yield self._slide(
                limb, finger_m, lambda t: world.carry(name, rest.pose(t)), least_s=rest.duration_s
            )
            world.put_to_rest(name, rest)
            timeline.settled(name, rest)
        yield Activity(self._dwell.after_release_s)
        return failure

    def _opening(self, grip: Grip) -> tuple[float, str | None]:
        """Finger position after opening, and why it is less than planned, or None."""
        limb, begin_m = grip.limb, self.world.finger_m(grip.limb)
        end_m = self.grippers[limb].open_m if grip.opening_m is None else grip.opening_m
        watch = self._needed_watch()
        for contact in watch.of_fingers(limb, end_m, FINGER_SPEED_M_S) if watch else ():
            self._hit(limb, contact)
            if contact.stops:
                way_m = contact.free_s * FINGER_SPEED_M_S
                stop_m = begin_m + way_m if end_m > begin_m else begin_m - way_m
                return stop_m, f"{grip.label}: {stop_text(contact, limb)}"
        return end_m, None

    def _slide(
        self,
        limb: str,
        finger_m: float,
        meanwhile: Callable[[float], None] = lambda _: None,
        *,
        least_s: float = 0.0,
    ) -> Activity:
        """Move the fingers to a position at their speed; wait until `least_s` have passed."""
        begin_m = self.world.finger_m(limb)
        travel_s = abs(finger_m - begin_m) / FINGER_SPEED_M_S

        def update(time_s: float) -> None:
            share = 1.0 if time_s >= travel_s else time_s / travel_s
            self.world.set_fingers(limb, begin_m + share * (finger_m - begin_m))
            meanwhile(time_s)

        return Activity(max(travel_s, least_s), update, can_stop=False)

    def _hit(self, limb: str, contact: Contact) -> None:
        self._hits.append(contact)
        self._timeline.hit(limb, contact)


def _certificate_fault(
    plan: Plan | TwoArmPlan, certificate: Certificate | TwoArmCertificate | None
) -> str:
    """Why the certificate of a plan that is about to be executed does not count, or ""."""
    made_by = "verify_both(plan)" if isinstance(plan, TwoArmPlan) else "verify(plan)"
    if certificate is None:
        what = "both arms" if isinstance(plan, TwoArmPlan) else f"the {plan.limb} arm"
        return (
            f"the plan for {what} is executed without a certificate; give certificate={made_by}, "
            "or unverified=True if that is meant"
        )
    if isinstance(plan, TwoArmPlan):
        is_of = expect(certificate, TwoArmCertificate, "certificate", SimulationError).is_of(plan)
    else:
        is_of = expect(certificate, Certificate, "certificate", SimulationError).is_of(plan)
    if not certificate.is_valid:
        return f"the plan is executed although its certificate is {certificate.verdict}"
    if not is_of:
        return (
            "the plan is executed with the certificate of another plan, world or tolerances, which "
            f"does not count; give certificate={made_by}"
        )
    return ""
