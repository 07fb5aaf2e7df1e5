"""Whether two situations are the same to the last bit."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from planner.mesh import Mesh
from planner.scene import Body, Shape
from planner.situation import Situation


def is_same(first: Situation, second: Situation, limb: str) -> bool:
    """The same bodies, joints and held bodies; the joints of the arm of a limb do not count."""
    return first is second or (
        _joints(first, limb) == _joints(second, limb)
        and list(first.scene.bodies) == list(second.scene.bodies)
        and all(map(_is_same_body, first.scene, second.scene))
        and _is_same_hold(first, second)
    )


def _joints(situation: Situation, limb: str) -> dict[str, float]:
    return {n: at for n, at in situation.joints.items() if not n.startswith(f"{limb}_")}


def _is_same_hold(first: Situation, second: Situation) -> bool:
    names, others = ([(h.side, h.body) for h in each.held] for each in (first, second))
    poses = zip(first.held, second.held, strict=False)
    return names == others and all(_is_same_pose(a.T_tip_body, b.T_tip_body) for a, b in poses)


def _is_same_body(first: Body, second: Body) -> bool:
    return first is second or (
        (first.name, first.is_movable, len(first.parts))
        == (second.name, second.is_movable, len(second.parts))
        and _is_same_pose(first.T_base_body, second.T_base_body)
        and all(
            _is_same_shape(a.shape, b.shape) and _is_same_pose(a.T_body_part, b.T_body_part)
            for a, b in zip(first.parts, second.parts, strict=True)
        )
    )


def _is_same_shape(first: Shape, second: Shape) -> bool:
    if isinstance(first, Mesh) and isinstance(second, Mesh):
        return np.array_equal(first.vertices, second.vertices) and np.array_equal(
            first.triangles, second.triangles
        )
    return first == second


def _is_same_pose(first: pin.SE3, second: pin.SE3) -> bool:
    return np.array_equal(first.homogeneous, second.homogeneous)
