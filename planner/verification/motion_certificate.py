"""Certificates of motions that something else planned or recorded.

A motion is certified like a move of a plan, with the same pairs and rows and by the same checker
(`planner.certificate`). A plan's intended contacts follow from its grips; here the caller states
them, and the certificate repeats them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import factorial
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin.description import RobotDescription
from baxter_kin.display import clear, count, quoted, seconds, shown_path
from baxter_kin.errors import FileError, UnknownNameError
from baxter_kin.fields import array, evolve, frozen, sequence
from baxter_kin.files import PathLike, replace_file
from baxter_kin.files.json_data import to_json
from baxter_kin.files.json_text import Json, as_lines
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import (
    FloatArray,
    expect,
    expect_all,
    finite_array,
    float_array,
)
from planner.certificate.checking import MOTION_FORMAT, MOTION_VERSION, Certified, Witness, check
from planner.certificate.errors import NotCertifiedError
from planner.certificate.motion import MAX_DEGREE, MAX_JUMP, MAX_PIECES
from planner.certificate.robot import ARM_JOINTS, Robot
from planner.certificate.timeline import MOTION, STATE_TOLERANCE, StepWitness, Timeline
from planner.errors import PlanFileError, TaskError, TrajectoryError
from planner.prover.kernel import rows_kernel
from planner.prover.problem import SHARES, NotShownError
from planner.state import State
from planner.trajectory import Trajectory
from planner.verification.witness import body_of, witness_of

MARGINS_M = (0.001, 0.005, 0.02)
"""Without a C compiler, the greatest of these that can be proven is certified, or 0."""


@frozen(error=TrajectoryError)
class PolynomialMotion:
    """A motion of the seven joints of an arm: polynomials of time between knots.

    Attributes:
        knots_s: times where the polynomial changes, shape (n + 1,), from 0, increasing, s.
        derivatives: position, velocity, acceleration and so on at the start of each piece, shape
            (n, k, 7) with k of 2 to 6, rad/s^i. Higher derivatives are 0, so the degree is k - 1.
        joint_names: the joints of the columns; those of the arm from shoulder to wrist when empty.
        is_timed: whether the knots are real times. They are not in a path without times; then
            velocities are not judged.

    Raises:
        TrajectoryError: when shapes do not fit, a number is not finite, knots do not increase from
            zero, or the position jumps by more than 1e-8 rad.
    """

    knots_s: FloatArray = array(None)
    derivatives: FloatArray = array(None, None, ARM_JOINTS)
    joint_names: tuple[str, ...] = sequence(default=())
    is_timed: bool = True

    if TYPE_CHECKING:  # converters take more than the fields hold

        def __init__(
            self,
            knots_s: ArrayLike,
            derivatives: ArrayLike,
            joint_names: Iterable[str] = (),
            is_timed: bool = True,
        ) -> None: ...

    def __attrs_post_init__(self) -> None:
        pieces, orders, _ = self.derivatives.shape
        if not 2 <= orders <= MAX_DEGREE + 1:
            raise TrajectoryError(
                f"the motion is of degree {orders - 1}; it may be of degree 1 to {MAX_DEGREE}"
            )
        if not 1 <= pieces <= MAX_PIECES:
            raise TrajectoryError(f"the motion has {pieces} pieces; 1 to {MAX_PIECES} are allowed")
        if len(self.knots_s) != pieces + 1:
            raise TrajectoryError(
                f"knots_s has {len(self.knots_s)} times; a motion of {pieces} pieces has "
                f"{pieces + 1}"
            )
        names = self.joint_names
        if names and not len(names) == len(set(names)) == ARM_JOINTS:
            raise TrajectoryError(f"joint_names must be {ARM_JOINTS} names, got {quoted(names)}")
        if self.knots_s[0] != 0.0 or not (np.diff(self.knots_s) > 0.0).all():
            raise TrajectoryError(
                f"times must increase from 0, got {quoted(self.knots_s.tolist())}; the first point "
                "must be the initial position of the arm, at time 0"
            )
        jumps = np.abs(self._ends()[:-1] - self.derivatives[1:, 0])
        if not (jumps <= MAX_JUMP).all():
            at_s = float(self.knots_s[1 + int(jumps.max(axis=1).argmax())])
            raise TrajectoryError(f"the position jumps by {jumps.max():.3g} rad at {at_s:g} s")

    @classmethod
    def through(
        cls,
        times_s: ArrayLike,
        q: ArrayLike,
        v: ArrayLike | None = None,
        a: ArrayLike | None = None,
        *,
        joint_names: Iterable[str] = (),
    ) -> PolynomialMotion:
        """The motion through points, interpolated as `joint_trajectory_controller` does.

        Quintic where velocities and accelerations are given, cubic with velocities alone, linear
        otherwise.

        Args:
            times_s: from 0, increasing, shape (n,), s.
            q: positions, shape (n, 7), rad.
            v: velocities, shape (n, 7), rad/s.
            a: accelerations, shape (n, 7), rad/s^2; they need velocities.
            joint_names: the joints of the columns; those of the arm from shoulder to wrist when
                empty.

        Raises:
            TrajectoryError: when shapes do not fit, a number is not finite, or the times do not
                increase from 0.
        """
        q = finite_array(q, (None, ARM_JOINTS), "q", TrajectoryError)
        times_s = finite_array(times_s, (len(q),), "times_s", TrajectoryError)
        if len(q) < 2 or not (np.diff(times_s) > 0.0).all():
            raise TrajectoryError("a motion needs at least two points, at increasing times")
        if a is not None and v is None:
            raise TrajectoryError("accelerations need velocities as well")
        points = [q] + [
            finite_array(x, q.shape, name, TrajectoryError)
            for x, name in ((v, "v"), (a, "a"))
            if x is not None
        ]
        return cls(times_s, _hermite(np.diff(times_s)[:, None], points), joint_names)

    @classmethod
    def waypoints(cls, q: ArrayLike, *, joint_names: Iterable[str] = ()) -> PolynomialMotion:
        """Straight lines from each configuration to the next, without times.

        The parameter increases by 1 from each to the next, so 2.5 is halfway between the third and
        the fourth.

        Args:
            q: at least two configurations, shape (n, 7), rad.
            joint_names: the joints of the columns; those of the arm from shoulder to wrist when
                empty.

        Raises:
            TrajectoryError: when the shape does not fit or a number is not finite.
        """
        q = finite_array(q, (None, ARM_JOINTS), "waypoints", TrajectoryError)
        if len(q) < 2:
            raise TrajectoryError("a path needs at least two waypoints")
        derivatives = np.stack([q[:-1], np.diff(q, axis=0)], axis=1)
        return cls(np.arange(float(len(q))), derivatives, joint_names, is_timed=False)

    @classmethod
    def of_coefficients(
        cls,
        knots_s: ArrayLike,
        coefficients: ArrayLike,
        *,
        joint_names: Iterable[str] = (),
    ) -> PolynomialMotion:
        """Polynomials given by their coefficients.

        Args:
            knots_s: shape (n + 1,), from 0, s.
            coefficients: of increasing powers of the time since the start of each piece, shape
                (n, k, 7), k of 2 to 6. For SciPy's `PPoly`: `c[::-1].swapaxes(0, 1)`.
            joint_names: the joints of the columns; those of the arm from shoulder to wrist when
                empty.

        Raises:
            TrajectoryError: as the class.
        """
        given = float_array(coefficients, "coefficients", TrajectoryError)
        if given.ndim == 3:
            given = given * np.array([factorial(i) for i in range(given.shape[1])])[:, None]
        return cls(knots_s, given, joint_names)

    @property
    def duration_s(self) -> float:
        """Time of the last knot, s."""
        return float(self.knots_s[-1])

    def _ends(self) -> FloatArray:
        """Positions at the ends of the pieces, shape (n, 7)."""
        length = np.diff(self.knots_s)[:, None]
        value = self.derivatives[:, -1]
        for k in range(self.derivatives.shape[1] - 1, 0, -1):
            value = self.derivatives[:, k - 1] + length / k * value
        return value

    def _facts(self) -> tuple[str, ...]:
        degree, pieces = self.derivatives.shape[1] - 1, count(len(self.derivatives), "piece")
        return pieces, f"degree {degree}", seconds(self.duration_s) if self.is_timed else ""


AnyMotion: TypeAlias = Trajectory | PolynomialMotion | ArrayLike


@frozen(error=TaskError)
class MotionCertificate:
    """The certificate of a motion, or why it has none.

    Attributes:
        document: the content of the motion's file: motion, state and, where found, certificate.
        certified: the result of `planner.certificate`; None where the motion is not certified.
        reason: why the motion is not certified, as a sentence; empty where it is.
        pair: the two things that come too near; None where the reason is another one.
        distance_m: their distance, 0 or less where they touch; None likewise.
        time_s: when; None likewise. In waypoints without times, 2.5 is halfway between the third
            and the fourth.

    Raises:
        TaskError: when a value has the wrong type.
    """

    document: Mapping[str, object]
    certified: Certified | None
    reason: str = ""
    pair: tuple[str, str] | None = None
    distance_m: float | None = None
    time_s: float | None = None

    @property
    def is_certified(self) -> bool:
        """Whether the motion is certified."""
        return self.certified is not None

    @property
    def clearance_m(self) -> float:
        """Proven clearance at every instant, m; 0 without a certificate."""
        return 0.0 if self.certified is None else self.certified.clearance_m

    def save(self, path: PathLike) -> None:
        """Write motion, state and certificate to a file, replacing an existing one.

        `python -m planner.certificate FILE --urdf FILE` checks it with NumPy alone.

        Raises:
            PlanFileError: when there is no certificate, or the file cannot be written.
        """
        if not self.is_certified:
            raise PlanFileError(f"a motion without a certificate is not saved: {self.reason}")
        document: Any = dict(self.document)
        try:
            replace_file(path, as_lines(document).encode() + b"\n")
        except FileError as cause:
            raise PlanFileError(f"{shown_path(path)} cannot be written: {cause.reason}") from cause

    def __str__(self) -> str:
        found = self.certified
        if found is None:
            return f"not certified: {self.reason}"
        assumed = [f"assumed: {', '.join(found.assumed)}"] if found.assumed else []
        open_ = [f"limits not judged: {', '.join(found.not_judged)}"] if found.not_judged else []
        return "\n".join(
            [f"certified: {clear(found.clearance_m)} at every instant", *assumed, *open_]
        )

    def _facts(self) -> tuple[str, ...]:
        return tuple(str(self).splitlines()[:1])


def certify(
    motion: AnyMotion,
    limb: str,
    state: State,
    contacts: Iterable[tuple[str, str]] = (),
    *,
    description: RobotDescription | None = None,
    a_max: ArrayLike | None = None,
    j_max: ArrayLike | None = None,
) -> MotionCertificate:
    """Certify a motion that something else planned or recorded, or state where it fails.

    Everything that moves keeps clear of everything that it may not touch, at every instant of the
    motion, and the joints stay within the URDF's limits of position, and of velocity where the
    motion has times. As in a plan, links of the arm with one joint between them are not compared,
    and those with two must not touch.

    Args:
        motion: a trajectory of this toolkit, polynomials, or waypoints of shape (n, 7), rad, with
            straight lines between them and no times.
        limb: the arm that moves, "left" or "right".
        state: all joints, bodies and what the hands hold when the motion begins. What the hand of
            this arm holds moves with it.
        contacts: pairs that may touch all the time, at most 0.5 mm deep: a body and a hand,
            ("block", "left hand"), or the held body and another one, ("block", "table"). They are
            assumed, not checked; the certificate lists them.
        description: the robot; the stock robot when not given.
        a_max: maximum acceleration of each joint, one number or shape (7,), rad/s^2; not judged
            when not given; not allowed for motions without times.
        j_max: maximum jerk, likewise, rad/s^3.

    Raises:
        TrajectoryError: when the motion is malformed or of a degree above 5.
        TaskError: when another argument is malformed, or the motion is of other joints, or does not
            begin at the arm's position in the state.
        UnknownNameError: when there is no such limb.
    """
    if not isinstance(limb, str) or limb not in LIMBS:
        raise UnknownNameError("limb", limb, LIMBS)
    expect(state, State, "state", TaskError)
    known = RobotDescription.of() if description is None else description
    text = expect(known, RobotDescription, "description", TaskError).text
    robot, body = Robot(text, limb), body_of(text)
    given = _ordered(_polynomials(motion), robot, state)
    if not given.is_timed and not (a_max is None and j_max is None):
        raise TaskError("a path has no times, so it cannot be judged by acceleration or jerk")
    step: dict[str, Json] = {
        "type": MOTION,
        "label": "motion",
        "trajectory": {
            "knots_s": given.knots_s.tolist(),
            "derivatives": given.derivatives.tolist(),
        },
        "is_timed": given.is_timed,
        "a_max": _limit(a_max, "a_max"),
        "j_max": _limit(j_max, "j_max"),
        "contacts": _contacts(contacts, limb, state),
    }
    start = to_json(state, State, "state", TaskError)
    plan: dict[str, Any] = {"limb": limb, "start": start, "failure": None, "steps": [step]}
    document: dict[str, Any] = {
        "format": MOTION_FORMAT,
        "version": MOTION_VERSION,
        "plan": plan,
        "states": [],
    }
    try:
        timeline = Timeline(plan, (), robot, body, (StepWitness(),))
        document["certificate"] = _witness(timeline, body.digest).for_file()
        return MotionCertificate(document, check(document, text, body=body))
    except NotShownError as cause:
        return MotionCertificate(document, None, str(cause), *_nearest(cause))
    except NotCertifiedError as cause:
        return MotionCertificate(document, None, str(cause))


def _witness(timeline: Timeline, digest: str) -> Witness:
    """The certificate with the greatest clearance that can be proven.

    Of `SHARES` of the smallest distance found, or without a C compiler of `MARGINS_M`.
    """

    def found(**asked: Any) -> Witness | NotShownError:
        try:
            return witness_of(timeline, digest, (StepWitness(),), **asked)
        except NotShownError as cause:
            if cause.near is not None and cause.near.distance_m <= 0.0:
                raise  # a contact: asking for less does not help
            return cause

    if rows_kernel() is None:
        best = found(margins_m=[0.0])
        for margin_m in MARGINS_M:
            better = found(margins_m=[margin_m]) if isinstance(best, Witness) else best
            if not isinstance(better, Witness):
                break
            best = better
    else:
        shown = (found(share=share) for share in SHARES)
        best = next((each for each in shown if isinstance(each, Witness)), None) or found()
    if isinstance(best, NotShownError):
        raise best
    return best


def _nearest(cause: NotShownError) -> tuple[tuple[str, str], float, float] | tuple[()]:
    """The pair that comes too near, its distance, m, and the time in the motion, s."""
    near, step = cause.near, cause.step
    if near is None or step is None:
        return ()
    pair = step.pairs[near.pair]
    time_s = 0.0 if step.motion is None else near.time_s
    return (pair.first.name, pair.second.name), near.distance_m, time_s


def _polynomials(motion: AnyMotion) -> PolynomialMotion:
    if isinstance(motion, PolynomialMotion):
        return motion
    if not isinstance(motion, Trajectory):
        return PolynomialMotion.waypoints(motion)
    if not len(motion.j):
        raise TrajectoryError("a motion of zero duration has nothing to certify")
    derivatives = np.stack([motion.q[:-1], motion.v[:-1], motion.a[:-1], motion.j], axis=1)
    return PolynomialMotion(motion.knots_s, derivatives, motion.limits.names)


def _ordered(motion: PolynomialMotion, robot: Robot, state: State) -> PolynomialMotion:
    """The motion with its joints ordered from shoulder to wrist; it must begin at the state."""
    names = motion.joint_names or robot.names
    if set(names) != set(robot.names):
        raise TaskError(
            f"the motion is of {', '.join(names)}; it must be of the {robot.limb} arm's joints: "
            f"{', '.join(robot.names)}"
        )
    columns = [names.index(name) for name in robot.names]
    derivatives = motion.derivatives[:, :, columns]
    distance = np.abs(derivatives[0, 0] - state.q(robot.names))
    worst = int(distance.argmax())
    if not distance[worst] <= STATE_TOLERANCE:
        raise TaskError(
            f"the motion begins {distance[worst]:.3g} rad from the position of "
            f"{robot.names[worst]} in the state; give a state with the arm there, by `State.moved`"
        )
    return evolve(motion, derivatives=derivatives, joint_names=robot.names)


def _limit(given: ArrayLike | None, name: str) -> Json:
    if given is None:
        return None
    limits = float_array(given, name, TaskError)
    limits = np.full(ARM_JOINTS, limits) if limits.ndim == 0 else limits
    limit = finite_array(limits, (ARM_JOINTS,), name, TaskError)
    if not (limit > 0.0).all():
        raise TaskError(f"{name} must be above zero, got {quoted(limit.tolist())}")
    values: list[Json] = limit.tolist()
    return values


def _contacts(given: Iterable[tuple[str, str]], limb: str, state: State) -> list[Json]:
    """Contacts as a motion's file states them."""
    held, hands = state.holding(limb), (f"{limb} hand", f"{limb} pads")
    standing = {*state.scene.bodies} - {each.body for each in state.attachments}
    found: list[Json] = []
    for pair in expect_all(given, tuple, "contacts", TaskError):
        if len(pair) != 2:
            raise TaskError(f"a contact must be two names, got {quoted(pair)}")
        body, other = pair
        is_of_hand = other in hands and body in standing
        is_of_held = held is not None and body == held.body and other in standing
        if not (is_of_hand or is_of_held):
            carried = "nothing" if held is None else held.body
            raise TaskError(
                f"{quoted(body)} and {quoted(other)} cannot touch: give a body that stands and "
                f"{hands[0]!r}, or the body in that hand ({carried}) and one that stands"
            )
        found.append({"body": body, "other": other})
    return found


def _hermite(length: FloatArray, points: Sequence[FloatArray]) -> FloatArray:
    """Derivatives at the start of each of n polynomials through n + 1 points (Hermite).

    Args:
        length: durations of the pieces, shape (n, 1), s.
        points: positions, then velocities and accelerations where known, each (n + 1, 7).
    """
    order = len(points)
    starts, ends = [x[:-1] for x in points], [x[1:] for x in points]
    # derivatives at the end, minus those of the start's Taylor polynomial there
    beyond = []
    for k in range(order):
        reached = sum(
            (starts[i] * length ** (i - k) / factorial(i - k) for i in range(k + 1, order)),
            starts[k],
        )
        beyond.append((ends[k] - reached) * length**k)
    # d^k/dx^k of c_m x^m at x = 1, for the missing powers m
    powers = range(order, 2 * order)
    M = np.array([[factorial(m) / factorial(m - k) for m in powers] for k in range(order)])
    coefficients = np.einsum("mk,knj->mnj", np.linalg.inv(M), np.array(beyond))
    further = [coefficients[m - order] * factorial(m) / length**m for m in powers]
    found: FloatArray = np.stack([*starts, *further], axis=1)
    return found
