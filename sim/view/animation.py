"""A recording as Meshcat animation: one track for each property that changes.

Samples are taken at no more than `FRAMES_PER_S`. Of these, keyframes are the ones from which linear
interpolation gives the others (Ramer 1972; Douglas and Peucker 1973, with the deviation measured at
equal time instead of across the line).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baxter_kin.validation import FloatArray
from sim.recording.recording import Recording
from sim.view.meshcat_commands import Command, set_property, short_numbers
from sim.view.scenegraph import RobotTree, body_path

JOINT_TOLERANCE = 2e-4
"""Maximum error of a replayed joint, rad or m: 0.2 mm for each metre of arm."""

POSE_TOLERANCE = 2e-4
"""Maximum error of a replayed body: metres, and parts of a unit quaternion."""

VALUE_STEP = 2.0**-15
"""Resolution of values, m or parts of a unit quaternion: a sixth of the tolerances."""

_TYPES = {"position": "vector", "quaternion": "quaternion", "visible": "bool"}
"""Names that three.js has for the values of a property."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """One property of one node over time.

    Attributes:
        path: the node.
        key: `position`, `quaternion` (x, y, z, w) or `visible`.
        times_s: shape (n,), increasing.
        values: shape (n, 3), (n, 4) or, for `visible`, (n, 1).
    """

    path: str
    key: str
    times_s: FloatArray
    values: FloatArray

    @property
    def is_constant(self) -> bool:
        """Whether its values are all equal."""
        return bool((self.values == self.values[0]).all())

    def first(self) -> Command:
        """The command that sets the first value."""
        value = self.values[0].tolist()
        return set_property(self.path, self.key, bool(value[0]) if self.key == "visible" else value)

    def for_three_js(self) -> Command:
        """The track as three.js reads it."""
        values = self.values.reshape(-1)
        return {
            "name": f".{self.key}",
            "type": _TYPES[self.key],
            "times": self.times_s.astype(np.float32),
            "values": [bool(value) for value in values]
            if self.key == "visible"
            else short_numbers(values, VALUE_STEP),
        }


def recorded_tracks(recording: Recording, tree: RobotTree, root: str = "") -> Iterator[Track]:
    """The tracks of everything that moves, appears or disappears, from time zero.

    Args:
        recording: what happened.
        tree: the robot.
        root: the node above the bodies.
    """
    times = recording.times_s - recording.times_s[0]
    for joint in range(len(tree.paths)):
        yield _joint_track(tree, joint, times, recording.q[:, joint])
    for name, poses in recording.body_poses.items():
        yield from _body_tracks(body_path(name, root), times, poses)


def animation_commands(tracks: Iterable[Track], duration_s: float) -> list[Command]:
    """Commands that set every node to its first state; the animation is the last of them."""
    tracks = list(tracks)
    by_path: dict[str, list[Command]] = {}
    for track in tracks:
        if not track.is_constant:
            by_path.setdefault(track.path, []).append(track.for_three_js())
    animations = [
        {
            "path": path,
            "clip": {"name": path, "fps": 1, "duration": duration_s, "tracks": for_three_js},
        }
        for path, for_three_js in by_path.items()
    ]
    options = {"play": False, "repetitions": 1}
    animation = {"type": "set_animation", "animations": animations, "options": options, "path": ""}
    return [*(track.first() for track in tracks), animation]


def _joint_track(tree: RobotTree, joint: int, times: FloatArray, q: FloatArray) -> Track:
    """Keyframes are at most a radian apart: between them, the browser turns the short way."""
    frames = frame_samples(times)
    times, q = times[frames], q[frames]
    chosen = key_samples(times, q[:, None], JOINT_TOLERANCE)
    chosen = np.union1d(chosen, np.flatnonzero(np.diff(np.floor(q))))
    key, values = tree.motions(joint, q[chosen])
    return Track(tree.paths[joint], key, times[chosen], values)


def _body_tracks(path: str, times: FloatArray, poses: FloatArray) -> Iterator[Track]:
    present = np.asarray(np.isfinite(poses).all(axis=1))
    changes = np.flatnonzero(np.diff(present)) + 1
    visible = np.concatenate([[0], changes])
    yield Track(path, "visible", times[visible], present[visible, None].astype(np.float64))
    if not present.any():
        return
    frames = np.union1d(frame_samples(times), np.concatenate([changes - 1, changes]))
    last = np.maximum.accumulate(np.where(present, np.arange(len(poses)), -1))
    poses = poses[np.where(last < 0, present.argmax(), last)][frames]  # where it was, if absent
    for key, values in (("position", poses[:, :3]), ("quaternion", _same_side(poses[:, 3:]))):
        chosen = key_samples(times[frames], values, POSE_TOLERANCE)
        yield Track(path, key, times[frames][chosen], values[chosen])


def _same_side(quats_xyzw: FloatArray) -> FloatArray:
    """Quaternions of the same rotations, each in the half of the sphere of the previous one."""
    dots = np.einsum("ij,ij->i", quats_xyzw[1:], quats_xyzw[:-1])
    signs = np.cumprod(np.concatenate([[1.0], np.where(dots < 0.0, -1.0, 1.0)]))
    return quats_xyzw * signs[:, None]


FRAMES_PER_S = 30.0


def frame_samples(times_s: FloatArray) -> NDArray[np.intp]:
    """Indices of at most `FRAMES_PER_S` samples a second, including the first and the last.

    Args:
        times_s: shape (n,), strictly increasing.
    """
    frames = np.floor((times_s - times_s[0]) * FRAMES_PER_S + 1e-6)
    first_of_frame = np.flatnonzero(np.diff(frames, prepend=-1.0) > 0)
    return np.union1d(first_of_frame, [len(times_s) - 1])


def key_samples(times_s: FloatArray, values: FloatArray, tolerance: float) -> NDArray[np.intp]:
    """Indices of the samples from which linear interpolation gives all others, in order.

    Args:
        times_s: shape (n,), strictly increasing.
        values: shape (n, k).
        tolerance: maximum error of an interpolated value, in the unit of `values`.
    """
    kept = np.zeros(len(times_s), dtype=bool)
    kept[[0, -1]] = True
    open_spans = [(0, len(times_s) - 1)]
    while open_spans:
        start, end = open_spans.pop()
        if end - start < 2:
            continue
        t, x = times_s[start : end + 1], values[start : end + 1]
        share = ((t - t[0]) / (t[-1] - t[0]))[:, None]
        errors = np.abs(x[0] + share * (x[-1] - x[0]) - x).max(axis=1)
        worst = int(errors.argmax())
        if errors[worst] > tolerance:
            kept[start + worst] = True
            open_spans += [(start, start + worst), (start + worst, end)]
    return np.flatnonzero(kept)
