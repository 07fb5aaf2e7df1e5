"""What a page can draw over the scene: coordinate frames, goals, a ghost, and the nearest two.

Goals and the ghost are see-through copies of what is drawn anyway, and share its triangles.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from sim.recording.recorded_motion import RecordedMove
from sim.recording.recording import Recording
from sim.view.appearance import Appearance, RobotPart
from sim.view.drawn_bodies import body_commands
from sim.view.meshcat_commands import (
    Command,
    Rgb,
    compact,
    glowing,
    set_object,
    set_transform,
    translucent,
    triangles,
    tube,
)
from sim.view.scenegraph import RobotTree, part_command

NEAREST_PATH = "/nearest"
NEAREST_RGB: Rgb = (0.78, 0.10, 0.42)
"""The line between the nearest two: its node and its colour."""

GHOST_PATH = "/ghost"
GHOST_RGB: Rgb = (0.24, 0.33, 0.78)
GHOST_OPACITY = 0.34
"""The other recording: its node, and its colour."""

SAME_JOINT = 1e-4
"""Joints that stay within this, rad or m, are drawn once."""

GOALS_PATH = "/goals"
GOAL_RGB: Rgb = (0.05, 0.60, 0.55)
GOAL_OPACITY = 0.36
MOST_GOALS = 24
SAME_GOAL = 1e-3
"""Goals: their node and colour, how many are drawn, the first ones, and how close poses are, m and
parts of a quaternion, that count as one."""

AXES_RGB: tuple[Rgb, Rgb, Rgb] = ((0.85, 0.12, 0.12), (0.10, 0.60, 0.16), (0.12, 0.32, 0.90))
AXIS_RADIUS = 0.02
JOINT_AXES_M = 0.10
END_AXES_M = 0.16
"""Axes x, y and z of frames are red, green and blue, so thick for their length; so long at joints,
and at base and tips."""


_LAYERS = (
    ("robot", "Robot", True),
    ("body", "Collision body", False),
    ("paths", "Tip path", True),
    ("goals", "Goals", True),
    ("frames", "Frames", False),
    ("ghost", "Other recording", True),
    ("nearest", "Nearest pair", True),
)
"""Id, label, and whether it is shown at first."""


def layers(paths: Mapping[str, Iterable[str]]) -> list[Command]:
    """What a page can show or hide: id, label, nodes, and whether it is shown at first.

    Args:
        paths: the nodes of each layer, by its id; one that is absent or has none is left out.
    """
    there = {name: list(nodes) for name, nodes in paths.items()}
    return [
        {"id": name, "label": label, "paths": there[name], "shown": is_shown}
        for name, label, is_shown in _LAYERS
        if there.get(name)
    ]


def nearest_command() -> Command:
    """The line between the nearest two, as a cylinder of radius 1 and length 1 along its y.

    Its middle is at the node, whose matrix the page sets from two points.
    """
    cylinder = {"type": "CylinderGeometry", "radialSegments": 8, "height": 1.0}
    size = {"radiusTop": 1.0, "radiusBottom": 1.0}
    return set_object(NEAREST_PATH, cylinder | size, glowing(NEAREST_RGB))


def frame_commands(robot: Baxter, tree: RobotTree) -> Iterator[Command]:
    """Axes at base, at the joints of both arms and at both tips, which move with the robot.

    They are seen through what they are in. Their nodes are `frame_paths`.
    """
    model, ends = robot.model, _ends(robot)
    for path, frame in zip(frame_paths(robot, tree), [*ends, *_arm_joints(robot)], strict=True):
        length_m = END_AXES_M if frame in ends else JOINT_AXES_M
        placement = pin.SE3.Identity()
        if frame in ends and frame:
            placement = model.frames[model.getFrameId(frame)].placement
        yield set_object(path, _axes(), _AXES_SURFACE, _scaled(length_m))
        yield set_transform(path, placement)


def frame_paths(robot: Baxter, tree: RobotTree) -> list[str]:
    """The nodes of all frames: base, the tips, the joints of both arms."""
    model = robot.model
    tips = [model.frames[model.getFrameId(arm.tip_frame)] for arm in robot.arms.values()]
    on_tips = [f"{tree.moving_node(model.names[tip.parentJoint])}/tip frame" for tip in tips]
    on_joints = [f"{tree.moving_node(name)}/frame" for name in _arm_joints(robot)]
    return [f"{tree.moving_node('universe')}/frame", *on_tips, *on_joints]


def goal_commands(recording: Recording, robot: Baxter, appearance: Appearance) -> Iterator[Command]:
    """A hand wherever a recorded move was to end, the fingers as they were then.

    They are nodes `/goals/<number of the move>`; moves to the same pose share one.
    """
    data, drawn = robot.model.createData(), list[FloatArray]()
    for number, move in enumerate(sorted(recording.moves, key=lambda move: move.start_s)):
        q, limb = _at_goal(recording, robot, move), move.limb
        pin.forwardKinematics(robot.model, data, q)
        fingers = [i for i, n in enumerate(robot.joint_names) if n.startswith(f"{limb[0]}_gripper")]
        wrist = data.oMi[robot.model.getJointId(robot.arm(limb).joint_names[-1])]
        seen = np.array([*pin.SE3ToXYZQUAT(wrist), *q[fingers]])
        if len(drawn) == MOST_GOALS or any(_is_same(seen, one) for one in drawn):
            continue
        drawn.append(seen)
        yield from hand_commands(f"{GOALS_PATH}/{number}", robot, limb, data, appearance)


def hand_commands(
    path: str, robot: Baxter, side: str, data: pin.Data, appearance: Appearance
) -> Iterator[Command]:
    """A see-through hand where forward kinematics, done in `data`, have it."""
    surface = translucent(GOAL_RGB, GOAL_OPACITY)
    for index, part in enumerate(_hand_parts(robot, side, appearance)):
        T_base_mesh = data.oMi[robot.model.getJointId(part.joint)] * part.T_joint_mesh
        yield part_command(f"{path}/{index}", part, T_base_mesh, surface)


def ghost_of(other: Recording, recording: Recording) -> Recording:
    """Another recording less the bodies that only stand where they do in a recording, too."""
    kept = [
        name
        for name, poses in other.body_poses.items()
        if name not in recording.body_poses or not _stand_alike(poses, recording.body_poses[name])
    ]
    bodies = {name: body for name, body in other.bodies.items() if name in kept}
    return evolve(other, bodies=bodies, body_poses={n: other.body_poses[n] for n in kept})


def moving_parts(
    appearance: Appearance, robot: Baxter, one: Recording, other: Recording
) -> Appearance:
    """What looks the same in two recordings all the time left out: only the rest can differ."""
    q = np.concatenate([one.q, other.q])
    differing = {
        robot.model.getJointId(name)
        for name, spread in zip(robot.joint_names, np.ptp(q, axis=0), strict=True)
        if spread > SAME_JOINT
    }
    model, parts = robot.model, appearance.parts
    chains = {name: set(model.supports[joint]) for joint, name in enumerate(model.names)}
    kept = tuple(part for part in parts if not differing.isdisjoint(chains[part.joint]))
    return evolve(appearance, parts=kept)


def ghost_commands(other: Recording, tree: RobotTree) -> Iterator[Command]:
    """Robot and bodies of another recording, see-through; its tree stands below `GHOST_PATH`."""
    surface = translucent(GHOST_RGB, GHOST_OPACITY)
    yield from tree.commands(surface)
    for body in other.bodies.values():
        yield from body_commands(body, GHOST_PATH, surface)


def _ends(robot: Baxter) -> list[str]:
    """Base as "", and the tips' frames."""
    return ["", *(arm.tip_frame for arm in robot.arms.values())]


def _arm_joints(robot: Baxter) -> list[str]:
    return [name for arm in robot.arms.values() for name in arm.joint_names]


_AXES_SURFACE: Command = {
    "type": "MeshBasicMaterial",
    "vertexColors": True,
    "depthTest": False,
    "transparent": True,
}


def _axes() -> Command:
    """Three tubes of length 1 from the origin, each in its colour."""
    lines = [tube(np.array([np.zeros(3), axis]), AXIS_RADIUS) for axis in np.eye(3)]
    vertices = np.concatenate([points for points, _ in lines])
    starts = np.cumsum([0, *(len(points) for points, _ in lines[:-1])])
    faces = np.concatenate([own + start for (_, own), start in zip(lines, starts, strict=True)])
    colours = np.repeat([[*rgb, 1.0] for rgb in AXES_RGB], len(lines[0][0]), axis=0)
    return triangles(vertices, compact(faces), colours=colours.astype(np.float32), uuid="axes")


def _is_same(seen: FloatArray, drawn: FloatArray) -> bool:
    return seen.shape == drawn.shape and bool(np.abs(seen - drawn).max() < SAME_GOAL)


def _stand_alike(poses: FloatArray, others: FloatArray) -> bool:
    """Whether two tracks, shape (n, 7), are one and the same place, whenever they are anywhere."""
    there = np.concatenate([track[np.isfinite(track).all(axis=1)] for track in (poses, others)])
    return len(there) > 0 and bool(np.ptp(there, axis=0).max() < SAME_GOAL)


def _scaled(length_m: float) -> list[float]:
    scale: list[float] = np.diag([length_m, length_m, length_m, 1.0]).reshape(-1).tolist()
    return scale


def _at_goal(recording: Recording, robot: Baxter, move: RecordedMove) -> FloatArray:
    """The full configuration at the end of a planned move, shape (19,)."""
    row = int(np.searchsorted(recording.times_s, move.end_s, side="right")) - 1
    q = recording.q[min(max(row, 0), len(recording.q) - 1)].copy()
    q[list(robot.indices(move.joint_names))] = move.trajectory.q_goal
    return np.asarray(q, dtype=np.float64)


def _hand_parts(robot: Baxter, side: str, appearance: Appearance) -> list[RobotPart]:
    """What hangs on the last joint of an arm and on the fingers."""
    model = robot.model
    last = model.getJointId(robot.arm(side).joint_names[-1])
    names = {model.names[joint] for joint in model.subtrees[last]}
    return [part for part in appearance.parts if part.joint in names]
