"""Recording: what happened, as data.

Files: npz by `save_recording` and `load_recording`, the RSDK's CSV by `write_csv`, MCAP by
`write_mcap`, bags by `write_bag`; while the simulation runs, `LogRecorder`, `CsvRecorder`,
`McapRecorder` and `BagRecorder` write to disk as they go. `read_recording` reads all of them.
`plot_recording` draws it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin.description import RobotIdentity
from baxter_kin.display import count, line, listing, quoted, seconds
from baxter_kin.errors import UnknownNameError
from baxter_kin.fields import FrozenMapping, array, field, frozen, mapping, sequence, shown
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray, expect, float_array
from planner import Body, Scene
from sim.errors import RecordingError
from sim.events import Event
from sim.recording.recorded_motion import ArmMotion, RecordedMove, arm_joints, arm_motion


def _bodies(given: Mapping[str, Body]) -> Mapping[str, Body]:
    return Scene(given).bodies


def _tracks(given: Mapping[str, ArrayLike]) -> Mapping[str, FloatArray]:
    """Read-only copies of pose tracks, which are NaN while a body is not in the world."""
    if not isinstance(given, Mapping):
        raise RecordingError(f"body_poses must be a mapping, got {type(given).__name__}")
    tracks = {}
    for name, track in given.items():
        tracks[name] = float_array(track, f"the poses of {quoted(name)}", RecordingError)
        tracks[name].setflags(write=False)
    return FrozenMapping(tracks)


@frozen(error=RecordingError)
class Commands:
    """The set-points that an arm was sent, and what was measured at these times.

    Attributes:
        times_s: shape (k,), in the recording's time.
        q_sent: set-points, each in force until the next, shape (k, 7), rad.
        q_measured: positions measured last at these times, shape (k, 7), rad.

    Raises:
        RecordingError: when an array has another shape or is not finite.
    """

    times_s: FloatArray = array(None)
    q_sent: FloatArray = array(None, 7)
    q_measured: FloatArray = array(None, 7)

    def __attrs_post_init__(self) -> None:
        for name in ("q_sent", "q_measured"):
            if len(getattr(self, name)) != len(self.times_s):
                raise RecordingError(
                    f"{name} has {len(getattr(self, name))} rows for {len(self.times_s)} times"
                )

    def _facts(self) -> tuple[str, ...]:
        return (count(len(self.times_s), "set-point"),)


@frozen(error=RecordingError)
class Recording:
    """A finished recording of n snapshots.

    Attributes:
        joint_names: the joints of the robot, 19 with both grippers.
        times_s: shape (n,), increasing.
        q: full configurations, shape (n, joints), rad and m.
        gripper_percent: left and right gripper, shape (n, 2), 0 closed .. 100 open.
        bodies: every body that ever was in the world, by name.
        body_poses: for each, shape (n, 7): x, y, z, then quaternion x, y, z, w, seen from base; NaN
            while it is not in the world.
        captions: (time in s, text) wherever the caption changed.
        events: everything that happened.
        moves: the commands: every move of an arm with its exact motion, in order.
        robot: which robot it was; None where nobody said.
        limbs: the arms that were recorded, in the order left, right. A file of a real robot may
            have one alone; the other stands still in `q` then.
        commands: by limb, the set-points that were sent to a robot; empty of a simulation.

    Raises:
        RecordingError: when shapes do not fit, times do not increase, there is no snapshot, or no
            arm.
    """

    joint_names: tuple[str, ...] = sequence()
    times_s: FloatArray = array(None)
    q: FloatArray = array(None, None)
    gripper_percent: FloatArray = array(None, 2)
    bodies: Mapping[str, Body] = field(converter=_bodies)
    body_poses: Mapping[str, FloatArray] = field(converter=_tracks)
    captions: tuple[tuple[float, str], ...] = sequence()
    events: tuple[Event, ...] = sequence()
    moves: tuple[RecordedMove, ...] = sequence(default=())
    robot: RobotIdentity | None = None
    limbs: tuple[str, ...] = sequence(default=LIMBS)
    commands: Mapping[str, Commands] = mapping(factory=dict)

    def __attrs_post_init__(self) -> None:
        count = len(self.times_s)
        if count == 0:
            raise RecordingError("the recording is empty: nothing was simulated")
        if not (np.diff(self.times_s) > 0.0).all():
            raise RecordingError("times_s must increase from one snapshot to the next")
        if self.limbs not in (LIMBS, *((side,) for side in LIMBS)):
            raise RecordingError(
                f"limbs must be {quoted(LIMBS)}, or one of them alone, got {quoted(self.limbs)}"
            )
        arrays = {"q": (self.q, (count, len(self.joint_names)))}
        arrays["gripper_percent"] = (self.gripper_percent, (count, len(LIMBS)))
        for name, track in self.body_poses.items():
            arrays[f"the poses of {quoted(name)}"] = (track, (count, 7))
        for name, (values, shape) in arrays.items():
            if values.shape != shape:
                raise RecordingError(f"{name} has shape {values.shape}; it must have shape {shape}")
        for limb in self.commands:
            if limb not in LIMBS:
                raise UnknownNameError("limb", limb, LIMBS)

    @property
    def duration_s(self) -> float:
        """From the first snapshot to the last."""
        return float(self.times_s[-1] - self.times_s[0])

    def motion(self, limb: str, *, with_knots: bool = False) -> ArmMotion:
        """Position, velocity, acceleration and jerk of an arm.

        The positions are those of `q`: of a simulation where the arm was commanded to be, of a
        robot what was measured. Velocity, acceleration and jerk are those of the commands where a
        recorded move explains the positions, and differences of the positions elsewhere. What a
        robot was sent is in `commands`.

        Args:
            limb: "left" or "right".
            with_knots: whether to add the times where the jerk of a move changes.

        Raises:
            UnknownNameError: when there is no such limb.
            RecordingError: when its joints were not recorded, or `with_knots` is no truth value.
        """
        expect(with_knots, bool, "with_knots", RecordingError)
        if not isinstance(limb, str) or limb not in LIMBS:
            raise UnknownNameError("limb", limb, LIMBS)
        names = arm_joints(limb)
        missing = [name for name in names if name not in self.joint_names]
        if missing:
            raise RecordingError(f"the recording lacks {', '.join(missing)}")
        q = self.q[:, [self.joint_names.index(name) for name in names]]
        moves = [move for move in self.moves if move.limb == limb]
        return arm_motion(names, self.times_s, q, moves, with_knots=with_knots)

    def _facts(self) -> tuple[str, ...]:
        rows, bodies = count(len(self.times_s), "snapshot"), listing(self.bodies, "body")
        arms = "" if self.limbs == LIMBS else f"{self.limbs[0]} arm alone"
        return rows, seconds(self.duration_s), arms, count(len(self.events), "event"), bodies


class NotedRecording(NamedTuple):
    """A recording read from a file that may be damaged or odd, and what was odd about it.

    Attributes:
        recording: what was read.
        notes: a sentence for each oddity; empty when there was none.
    """

    recording: Recording
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        is_known = isinstance(self.notes, tuple)  # a named tuple takes anything
        notes = count(len(self.notes), "note") if is_known else shown(self.notes)
        return line("NotedRecording", (notes, quoted(self.recording)))
