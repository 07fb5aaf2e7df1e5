"""Pose log: what was seen, written to a file and replayed from it.

A text file with a header and one line per look, comma-separated: the time of the look in s, the
name of the body, the time that it was seen at in s, and its pose seen from base as x, y, z in m and
a quaternion x, y, z, w; the last eight are empty where nothing was seen. Names hold no comma.
"""

from __future__ import annotations

from collections.abc import Iterable
from os import PathLike

import numpy as np
import pinocchio as pin

from baxter_kin import pose_from_quaternion, quaternion_xyzw
from baxter_kin.display import OneLine, count, phrase, position, quoted, seconds, shown_path
from baxter_kin.errors import BaxterError
from baxter_kin.fields import NotCopied, frozen, scalar
from baxter_kin.validation import expect, expect_all, finite_scalar
from planner import Scene
from sim.errors import RecordingError, SimulationError
from sim.files import Line, LineFile, read_lines
from sim.perception.pose_source import PoseSource, Sighting, checked_source

HEADER = "look_s,name,seen_s,x,y,z,qx,qy,qz,qw"

_FIELDS = HEADER.count(",") + 1


@frozen(error=SimulationError)
class Look:
    """One look.

    Attributes:
        time_s: when.
        name: at which body.
        seen_s: the time that it was seen at; None when it was not seen.
        T_base_body: where it seemed to be; None when it was not seen.

    Raises:
        SimulationError: when a value has the wrong type, or the time is not finite.
    """

    time_s: float = scalar()
    name: str
    seen_s: float | None = None
    T_base_body: pin.SE3 | None = None

    def _facts(self) -> tuple[str, ...]:
        where = "not seen" if self.T_base_body is None else f"at {position(self.T_base_body)}"
        return seconds(self.time_s), phrase(self.name), where


class LoggedPoses(NotCopied, OneLine):
    """A pose source that writes down what another one sees; close it, or use it in `with`."""

    def __init__(self, source: PoseSource, path: str | PathLike[str]) -> None:
        """Open the file, in place of an older one.

        Raises:
            RecordingError: when it cannot be opened.
            SimulationError: when `source` has the wrong type.
        """
        self._source = checked_source(source, "source")
        self._file = LineFile(path)
        self._file.write(HEADER)

    def __enter__(self) -> LoggedPoses:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def look(self, name: str, time_s: float) -> Sighting | None:
        """What the other source sees.

        Raises:
            RecordingError: when it cannot be written down, or is no look.
        """
        expect(name, str, "name", RecordingError)
        time_s = finite_scalar(time_s, "time_s", RecordingError)
        if "," in name or not name.isprintable():
            raise RecordingError(
                f"a body named {quoted(name)} cannot be logged: no comma, no line end"
            )
        sighting = self._source.look(name, time_s)
        seen = [""] * (_FIELDS - 2)
        if sighting is not None:
            T = sighting.body.T_base_body
            numbers = (sighting.time_s, *T.translation, *quaternion_xyzw(T))
            seen = [repr(float(number)) for number in numbers]
        self._file.write(",".join([repr(float(time_s)), name, *seen]))
        return sighting

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _facts(self) -> tuple[str, ...]:
        return repr(self._source), *self._file._facts()


class ReplayedPoses(OneLine):
    """A pose source that sees again what was seen before: each look answers as the one of its time.

    Of the looks at a body, the last that was not later than asked for answers; before the first,
    nothing is seen.
    """

    def __init__(self, looks: Iterable[Look], scene: Scene) -> None:
        """Replay looks.

        Args:
            looks: in the order of their times.
            scene: has the shapes of the bodies; its poses count for nothing.

        Raises:
            SimulationError: when a look has the wrong type, or their times go backwards.
            SceneError: when a body is not in the scene.
        """
        bodies = expect(scene, Scene, "scene", SimulationError)
        self._times: dict[str, list[float]] = {}
        self._seen: dict[str, list[Sighting | None]] = {}
        for look in expect_all(looks, Look, "looks", SimulationError):
            times = self._times.setdefault(look.name, [])
            if times and look.time_s < times[-1]:
                raise SimulationError(f"the looks go back in time, to {look.time_s:g} s")
            body, sighting = bodies[look.name], None
            if look.T_base_body is not None and look.seen_s is not None:
                sighting = Sighting(body.at(look.T_base_body), look.seen_s)
            times.append(look.time_s)
            self._seen.setdefault(look.name, []).append(sighting)

    def look(self, name: str, time_s: float) -> Sighting | None:
        """What was seen at that time; None when nothing was, or the body never was looked at.

        Raises:
            SimulationError: when the name is not text, or the time not a number.
        """
        expect(name, str, "name", SimulationError)
        time_s = finite_scalar(time_s, "time_s", SimulationError)
        number = int(np.searchsorted(self._times.get(name, []), time_s, side="right"))
        return self._seen[name][number - 1] if number else None

    def _facts(self) -> tuple[str, ...]:
        return tuple(
            f"{count(len(times), 'look')} at {name}" for name, times in self._times.items()
        )


def read_looks(path: str | PathLike[str]) -> tuple[Look, ...]:
    """The looks in a file; a half-written last line is left out.

    Raises:
        RecordingError: when the file cannot be read or holds no looks; says in which line.
    """
    lines = iter(read_lines(path))
    first = next(lines, None)
    if first is None or first.text != HEADER:
        raise RecordingError(f"{shown_path(path)} is no pose log: its first line is not {HEADER!r}")
    looks = (_read(line, path) for line in lines)
    return tuple(look for look in looks if look is not None)


def _read(line: Line, path: str | PathLike[str]) -> Look | None:
    """The look in a line; None where it was cut short."""
    try:
        return _look(line.text)
    except (ValueError, BaxterError) as cause:
        if not line.is_complete:
            return None
        raise RecordingError(f"{shown_path(path)}, line {line.number}: {cause}") from cause


def _look(text: str) -> Look:
    fields = text.split(",")
    if len(fields) != _FIELDS:
        raise RecordingError(f"has {len(fields)} fields; it must have {_FIELDS}")
    time_s, name, seen_s, *pose = fields
    if not name:
        raise RecordingError("names no body")
    if not seen_s and not any(pose):
        return Look(float(time_s), name)
    numbers = np.array([float(number) for number in pose])
    T = pose_from_quaternion(numbers[:3], numbers[3:])  # an array: the header states its order
    return Look(float(time_s), name, float(seen_s), T)
