"""Which pairs of the robot's own links are checked.

Every pair is, with one shape on the arm that moves, but

- links that are rigid to each other: both before or both behind the same joints;
- links one joint apart, which are mounted on each other: most of them touch in their bearing, and
  the rest keep the same distance at every angle;
- links two joints apart, where these joints are as the stock robot has them: then they never touch
  at any two angles of those joints. It was measured on the meshes over the whole range of both, and
  is tested (`test_links.py`): the upper elbow comes nearest, to 1.7 mm from the upper
  forearm when the elbow is bent to its end. On a calibrated robot this is not known, so there such
  pairs are checked, as are those of fingers in other slots or of other meshes than either hand has
  in the drawing; only what is one joint apart is taken to be mounted as it is drawn;
- both fingers of a hand, with their tips, in the slots that are drawn or farther out: they never
  touch at any opening, of whatever kind they are; so is tested for every kind and slot.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from baxter_kin.validation import FloatArray
from planner.verification.body.solid import Solid

MOUNTED = 2
"""Links fewer joints apart are left out, and those so many apart where they are as drawn."""

_BODY = pin.FrameType.BODY

ROUNDING = 1e-9
"""How far from the drawings, m and of rotations, a joint may be and still count as drawn."""


class OwnPairs:
    """The pairs of a robot's own links."""

    def __init__(
        self, model: pin.Model, stock: pin.Model, reshaped: frozenset[str] = frozenset()
    ) -> None:
        self._model = model
        names = enumerate(model.names)
        self._same = tuple(
            (j, stock.getJointId(name)) for j, name in names if stock.existJointName(name)
        )
        axes = _axes(model), _axes(stock)
        self._as_drawn = frozenset(
            own
            for own, drawn in self._same
            if own
            and np.abs(axes[0][own] - axes[1][drawn]).max() <= ROUNDING
            and _is_near(model.jointPlacements[own], stock.jointPlacements[drawn])
            and _lower(stock, drawn) <= _lower(model, own)
            and _upper(model, own) <= _upper(stock, drawn)
        )
        self._farther_out = frozenset(
            own for own, drawn in self._same if own and _is_farther_out(model, stock, own, drawn)
        )
        self._mounted_as_drawn = frozenset(
            str(frame.name)
            for frame in model.frames
            if frame.type == _BODY
            and frame.name not in reshaped
            and stock.existFrame(frame.name, _BODY)
            and _is_near(
                frame.placement, stock.frames[stock.getFrameId(frame.name, _BODY)].placement
            )
        )

    def is_checked(self, first: Solid, second: Solid) -> bool:
        """Whether two shapes of the robot could meet."""
        between = set(_chain(self._model, first.joint)) ^ set(_chain(self._model, second.joint))
        if len(between) != MOUNTED:
            return len(between) > MOUNTED
        if between <= self._farther_out:
            return False
        links = {first.name, second.name}
        return not (between <= self._as_drawn and links <= self._mounted_as_drawn)


def _is_farther_out(model: pin.Model, stock: pin.Model, own: int, drawn: int) -> bool:
    """Whether a joint slides from where it is drawn, or from farther along the way it opens."""
    along = np.asarray(model.createData().joints[own].S).ravel()
    if along[3:].any() or model.parents[own] != stock.parents[drawn]:
        return False
    opens = along[:3] if _upper(model, own) > 0.0 else -along[:3]
    T = stock.jointPlacements[drawn].actInv(model.jointPlacements[own])
    out_m = float(opens @ T.translation)
    inner_m = out_m + _inner_end(model, own) - _inner_end(stock, drawn)
    return inner_m >= -ROUNDING and _is_near(T, pin.SE3(np.eye(3), out_m * opens))


def _inner_end(model: pin.Model, joint: int) -> float:
    """How far a sliding joint is open at the least, m."""
    low, high = _lower(model, joint), _upper(model, joint)
    return low if high > 0.0 else -high


def _is_near(own: pin.SE3, drawn: pin.SE3) -> bool:
    return bool(np.abs(own.homogeneous - drawn.homogeneous).max() <= ROUNDING)


def _axes(model: pin.Model) -> list[FloatArray]:
    """Of all joints; zeros for the one that stands for base."""
    joints = model.createData().joints
    return [np.zeros(6), *(np.asarray(joints[j].S).ravel() for j in range(1, model.njoints))]


def _lower(model: pin.Model, joint: int) -> float:
    return float(model.lowerPositionLimit[model.joints[joint].idx_q])


def _upper(model: pin.Model, joint: int) -> float:
    return float(model.upperPositionLimit[model.joints[joint].idx_q])


def _chain(model: pin.Model, joint: int) -> list[int]:
    """The joints from base to a joint."""
    return [int(parent) for parent in model.supports[joint]][1:]
