"""Recording: what happened, as data.

Files: npz by `save_recording` and `load_recording`, the RSDK's CSV by `write_csv`, MCAP by
`write_mcap`, bags by `write_bag`; while the simulation runs, `LogRecorder`, `CsvRecorder`,
`McapRecorder` and `BagRecorder` write to disk as they go. `read_recording` reads all of them.
`plot_recording` draws it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from baxter_kin.description import RobotIdentity
from baxter_kin.errors import UnknownNameError, expect, expect_all, quoted
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray, finite_array, float_array
from baxter_kin.value_objects import (
    Frozen,
    FrozenMapping,
    OneLine,
    count,
    line,
    listing,
    seconds,
    shown,
)
from planner import Body, Scene
from sim.errors import RecordingError
from sim.events import Event
from sim.recording.recorded_motion import ArmMotion, RecordedMove, arm_joints, arm_motion


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Commands(Frozen, OneLine):
    """The set-points that an arm was sent, and what was measured at these times.

    Attributes:
        times_s: shape (k,), in the recording's time.
        q_sent: set-points, each in force until the next, shape (k, 7), rad.
        q_measured: positions measured last at these times, shape (k, 7), rad.

    Raises:
        RecordingError: when an array has another shape or is not finite.
    """

    times_s: FloatArray
    q_sent: FloatArray
    q_measured: FloatArray

    def __post_init__(self) -> None:
        size = float_array(self.times_s, "times_s", RecordingError).size
        for name, shape in (("times_s", (size,)), ("q_sent", (size, 7)), ("q_measured", (size, 7))):
            array = finite_array(getattr(self, name), shape, name, RecordingError)
            object.__setattr__(self, name, array)

    def _facts(self) -> tuple[str, ...]:
        return (count(len(self.times_s), "set-point"),)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Recording(Frozen, OneLine):
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

    joint_names: tuple[str, ...]
    times_s: FloatArray
    q: FloatArray
    gripper_percent: FloatArray
    bodies: Mapping[str, Body]
    body_poses: Mapping[str, FloatArray]
    captions: tuple[tuple[float, str], ...]
    events: tuple[Event, ...]
    moves: tuple[RecordedMove, ...] = ()
    robot: RobotIdentity | None = None
    limbs: tuple[str, ...] = LIMBS
    commands: Mapping[str, Commands] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.robot is not None:
            expect(self.robot, RobotIdentity, "robot", RecordingError)
        self._check_limbs()
        count = float_array(self.times_s, "times_s", RecordingError).size
        if count == 0:
            raise RecordingError("the recording is empty: nothing was simulated")
        for name, kind in _PARTS.items():
            items = expect_all(getattr(self, name), kind, name, RecordingError)
            object.__setattr__(self, name, items)
        shapes = {
            "times_s": (count,),
            "q": (count, len(self.joint_names)),
            "gripper_percent": (count, len(LIMBS)),
        }
        for name, shape in shapes.items():
            array = finite_array(getattr(self, name), shape, name, RecordingError)
            object.__setattr__(self, name, array)
        if not (np.diff(self.times_s) > 0.0).all():
            raise RecordingError("times_s must increase from one snapshot to the next")
        object.__setattr__(self, "body_poses", self._frozen_poses())
        object.__setattr__(self, "bodies", Scene(self.bodies).bodies)
        for limb, commands in self.commands.items():
            if limb not in LIMBS:
                raise UnknownNameError("limb", limb, LIMBS)
            expect(commands, Commands, f"commands of the {limb} arm", RecordingError)
        object.__setattr__(self, "commands", FrozenMapping(self.commands))

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

    def _check_limbs(self) -> None:
        limbs = expect_all(self.limbs, str, "limbs", RecordingError)
        if limbs not in (LIMBS, *((side,) for side in LIMBS)):
            raise RecordingError(
                f"limbs must be {quoted(LIMBS)}, or one of them alone, got {quoted(limbs)}"
            )
        object.__setattr__(self, "limbs", limbs)

    def _frozen_poses(self) -> Mapping[str, FloatArray]:
        if not isinstance(self.body_poses, Mapping):
            raise RecordingError(
                f"body_poses must be a mapping, got {type(self.body_poses).__name__}"
            )
        poses = {}
        for name, track in self.body_poses.items():
            array = float_array(track, f"poses of {quoted(name)}", RecordingError)
            if array.shape != (len(self.times_s), 7):
                raise RecordingError(
                    f"poses of {quoted(name)} have shape {array.shape}; need "
                    f"{(len(self.times_s), 7)}"
                )
            array.setflags(write=False)
            poses[name] = array
        return FrozenMapping(poses)


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


_PARTS: Mapping[str, type[object]] = {
    "joint_names": str,
    "captions": tuple,
    "events": Event,
    "moves": RecordedMove,
}
