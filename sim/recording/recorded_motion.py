"""The motion of a recorded arm: what was commanded, and so position, velocity, acceleration, jerk.

A kinematic simulation follows its commands to the bit, so where a move was recorded its exact cubic
gives all four. Elsewhere, as in a recording of a real robot, central differences of the recorded
positions do.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from baxter_kin import IKResult
from baxter_kin.display import count, phrase, quoted, seconds, side_of
from baxter_kin.fields import array, field, frozen, scalar
from baxter_kin.ik.result import checked_result
from baxter_kin.kinematics.arm import LIMBS, arm_joints
from baxter_kin.validation import FloatArray, expect_all
from planner import Move, Trajectory
from planner.scene.contact import Contact
from sim.errors import RecordingError
from sim.events import Event

AGREEMENT_RAD = 1e-6
"""Maximum distance of recorded positions from a recorded move that explains them: rounding."""

ROUNDING_S = 1e-9
"""Maximum time of a tick outside a move: rounding."""


def _contacts(given: tuple[Contact, ...] | None) -> tuple[Contact, ...] | None:
    return None if given is None else expect_all(given, Contact, "contacts", RecordingError)


@frozen(error=RecordingError)
class RecordedMove:
    """A move of an arm as it was commanded.

    Attributes:
        start_s: when it began, in the recording's time.
        label: what it was for, such as "cycle 1, pick: approach".
        trajectory: the exact motion; its limits name the joints.
        ik: the result of inverse kinematics for its end; None for a move in joint angles.
        contacts: intended contacts; None if unknown.

    Raises:
        RecordingError: when a part is of another type, or the joints are not those of one arm.
    """

    start_s: float = scalar()
    label: str
    trajectory: Trajectory
    ik: IKResult | None = field(default=None, converter=checked_result)
    contacts: tuple[Contact, ...] | None = field(default=None, converter=_contacts)

    def __attrs_post_init__(self) -> None:
        if _limb_of(self.trajectory) is None:
            names = ", ".join(self.joint_names)
            raise RecordingError(f"a move must be of the joints of one arm, got {names}")

    @property
    def limb(self) -> str:
        """The arm's side, "left" or "right"."""
        return str(_limb_of(self.trajectory))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints that it moves."""
        return self.trajectory.limits.names

    @property
    def move(self) -> Move:
        """As in a plan; without the pose where it ends."""
        return Move(self.label, self.trajectory, ik=self.ik)

    @property
    def end_s(self) -> float:
        """When it ends, in the recording's time."""
        return self.start_s + self.trajectory.duration

    def _facts(self) -> tuple[str, ...]:
        side = side_of(self.joint_names)
        return phrase(self.label), side, f"{self.start_s:.2f} .. {seconds(self.end_s)}"


def _flags(given: object) -> NDArray[np.bool_]:
    if not isinstance(given, np.ndarray) or given.dtype != np.bool_:
        raise RecordingError(f"is_exact must be an array of bools, got {quoted(given)}")
    flags = given.copy()
    flags.setflags(write=False)
    return flags


@frozen(error=RecordingError)
class ArmMotion:
    """An arm at n times.

    Attributes:
        joint_names: its seven joints.
        times_s: shape (n,), not decreasing.
        q: positions, shape (n, 7), rad.
        v: velocities, shape (n, 7), rad/s.
        a: accelerations, shape (n, 7), rad/s^2.
        j: jerks from each time to the next, shape (n, 7), rad/s^3.
        is_exact: whether v, a and j are those of a recorded move, shape (n,); else differences.

    Raises:
        RecordingError: when a value has the wrong type, an array of another shape or not finite.
    """

    joint_names: tuple[str, ...]
    times_s: FloatArray = array(None)
    q: FloatArray = array(None, None)
    v: FloatArray = array(None, None)
    a: FloatArray = array(None, None)
    j: FloatArray = array(None, None)
    is_exact: NDArray[np.bool_] = field(converter=_flags)

    def __attrs_post_init__(self) -> None:
        n = len(self.times_s)
        shapes = {"is_exact": (n,)} | dict.fromkeys("qvaj", (n, len(self.joint_names)))
        for name, shape in shapes.items():
            actual = getattr(self, name).shape
            if actual != shape:
                raise RecordingError(f"{name} has shape {actual}; it must have shape {shape}")

    def _facts(self) -> tuple[str, ...]:
        times_s = self.times_s.tolist() or [0.0]
        period = f"{times_s[0]:.2f} .. {seconds(times_s[-1])}"
        return side_of(self.joint_names), count(len(self.times_s), "sample"), period


def recorded_move(event: Event) -> RecordedMove | None:
    """The move that began; None for other events, and for moves that name no arm's joints."""
    move = event.move
    if move is None or _limb_of(move.trajectory) is None:
        return None
    contacts = None if move.state is None else move.contacts
    return RecordedMove(event.time_s, event.text, move.trajectory, move.ik, contacts)


def _limb_of(trajectory: Trajectory) -> str | None:
    """The arm that a trajectory moves, by the names of its joints; None when it is of no arm."""
    names = sorted(trajectory.limits.names)
    return next((side for side in LIMBS if names == sorted(arm_joints(side))), None)


def arm_motion(
    joint_names: tuple[str, ...],
    times_s: FloatArray,
    q: FloatArray,
    moves: Sequence[RecordedMove],
    *,
    with_knots: bool = False,
) -> ArmMotion:
    """The motion of an arm at the recorded times.

    Args:
        joint_names: its seven joints.
        times_s: shape (n,), increasing.
        q: shape (n, 7), rad.
        moves: all moves of that arm, as they were recorded.
        with_knots: whether to add the times where the jerk of a move changes, so that every
            extreme of the acceleration is there.

    Raises:
        RecordingError: when there are no samples.
    """
    if not len(times_s):
        raise RecordingError("times_s must have at least one sample")
    pieces, is_left = [], np.ones(len(times_s), dtype=bool)
    for move in moves:
        rows = _explained_rows(move, joint_names, times_s, q)
        rows = rows[is_left[rows]]  # at the time where two moves meet, the first has it
        if rows.size:
            is_left[rows] = False
            times = _knotted(move, times_s, rows) if with_knots else times_s[rows]
            pieces.append(_of_move(move, joint_names, times))
    pieces += [_of_samples(joint_names, times_s[run], q[run]) for run in _runs(is_left)]
    pieces.sort(key=lambda piece: float(piece.times_s[0]))
    return _joined(joint_names, pieces)


def _joined(joint_names: tuple[str, ...], pieces: Sequence[ArmMotion]) -> ArmMotion:
    times_s = np.concatenate([piece.times_s for piece in pieces])
    order = np.argsort(times_s, kind="stable")  # knots of two moves can meet between two samples
    return ArmMotion(
        joint_names,
        times_s=times_s[order],
        q=np.concatenate([piece.q for piece in pieces])[order],
        v=np.concatenate([piece.v for piece in pieces])[order],
        a=np.concatenate([piece.a for piece in pieces])[order],
        j=np.concatenate([piece.j for piece in pieces])[order],
        is_exact=np.concatenate([piece.is_exact for piece in pieces])[order],
    )


def _explained_rows(
    move: RecordedMove, joint_names: tuple[str, ...], times_s: FloatArray, q: FloatArray
) -> NDArray[np.intp]:
    """The rows that the move explains, up to the first that it does not: it was cut short there."""
    inside = (times_s >= move.start_s - ROUNDING_S) & (times_s <= move.end_s + ROUNDING_S)
    rows = np.flatnonzero(inside)
    off = np.abs(_of_move(move, joint_names, times_s[rows]).q - q[rows]).max(axis=1, initial=0.0)
    wrong = np.flatnonzero(off > AGREEMENT_RAD)
    return rows[: wrong[0]] if wrong.size else rows


def _knotted(move: RecordedMove, times_s: FloatArray, rows: NDArray[np.intp]) -> FloatArray:
    """The times of the rows, and the knots between them and their neighbours.

    A row within the move that it does not explain shows that the move was cut short, so knots
    after the last explained row were perhaps never reached.
    """
    before = times_s[max(rows[0] - 1, 0)]
    after = times_s[min(rows[-1] + 1, len(times_s) - 1)]
    if after <= move.end_s + ROUNDING_S:
        after = times_s[rows[-1]]
    knots = move.start_s + move.trajectory.knots_s
    reached = (knots >= before - ROUNDING_S) & (knots <= after + ROUNDING_S)
    return np.union1d(times_s[rows], np.clip(knots[reached], before, after))


def _of_move(move: RecordedMove, joint_names: tuple[str, ...], times: FloatArray) -> ArmMotion:
    trajectory = move.trajectory
    order = [move.joint_names.index(name) for name in joint_names]
    t = np.clip(times - move.start_s, 0.0, trajectory.duration)
    q, v, a = (x[:, order] for x in trajectory.sample(t))
    jerks = np.concatenate([trajectory.j, np.zeros((1, len(order)))])
    j = jerks[np.searchsorted(trajectory.knots_s, t, side="right") - 1][:, order]
    return ArmMotion(joint_names, times, q, v, a, j, np.ones(len(times), dtype=bool))


def _of_samples(joint_names: tuple[str, ...], times: FloatArray, q: FloatArray) -> ArmMotion:
    v = _differences(times, q)
    a = _differences(times, v)
    exact = np.zeros(len(times), dtype=bool)
    return ArmMotion(joint_names, times, q, v, a, _differences(times, a), exact)


def _differences(times: FloatArray, values: FloatArray) -> FloatArray:
    """Central differences by time; zero for a single sample."""
    if len(times) < 2:
        return np.zeros_like(values)
    moved = values - values[0]  # exactly zero, and so are its slopes, where nothing moves
    slopes: FloatArray = np.gradient(moved, times, axis=0)
    return slopes


def _runs(chosen: NDArray[np.bool_]) -> Iterator[slice]:
    """Where `chosen` holds without a break."""
    edges = np.flatnonzero(np.diff(chosen, prepend=False, append=False))
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        yield slice(int(start), int(end))
