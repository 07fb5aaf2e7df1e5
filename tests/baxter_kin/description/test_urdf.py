from __future__ import annotations

import math
import random
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Baxter
from baxter_kin.description.urdf import (
    JointKind,
    JointRange,
    ShapeKind,
    Urdf,
    UrdfJoint,
    UrdfShape,
    below,
    origin_of,
    with_unique_names,
)
from baxter_kin.errors import DescriptionError


def fixed(name: str, parent: str, child: str) -> UrdfJoint:
    return UrdfJoint(name, JointKind.FIXED, parent, child)


@pytest.mark.parametrize(
    "changes",
    [
        {"kind": ShapeKind.BOX, "size_m": (0.1, 0.1)},
        {"size_m": (0.0,)},
        {"kind": ShapeKind.CYLINDER, "size_m": (0.1, math.inf)},
        {"size_m": (math.nan,)},
        {"size_m": 0.1},
        {"size_m": "0.1"},
        {"kind": "ball"},
        {"xyz": (0.0, math.inf, 0.0)},
        {"rpy": (0.0, 0.0)},
        {"mesh": 5},
    ],
    ids=str,
)
def test_invalid_shapes_are_refused(changes: dict[str, Any]) -> None:
    arguments: dict[str, Any] = {"kind": ShapeKind.SPHERE, "size_m": (0.1,)}
    assert UrdfShape(**arguments)
    with pytest.raises(DescriptionError):
        UrdfShape(**(arguments | changes))


@pytest.mark.parametrize(
    "joints",
    [
        (fixed("j", "a", "b"), fixed("k", "b", "a")),
        (fixed("j", "base", "a"), fixed("j", "a", "b")),
        (fixed("j", "base", "a"), fixed("k", "base", "a")),
        (fixed("j", "base", "base"),),
    ],
    ids=["a circle", "a joint twice", "a link twice", "the root twice"],
)
def test_what_is_no_tree_of_unique_names_is_refused(joints: tuple[UrdfJoint, ...]) -> None:
    with pytest.raises(DescriptionError):
        Urdf("base", joints)


@given(st.randoms(use_true_random=False))
def test_joints_in_any_order_are_put_from_the_root_outwards(
    robot: Baxter, rng: random.Random
) -> None:
    tree = robot.description.tree
    ordered = below(tree.root, rng.sample(tree.joints, len(tree.joints)))
    assert set(ordered) == set(tree.joints)
    reached = {tree.root}
    for joint in ordered:
        assert joint.parent in reached
        reached.add(joint.child)


def test_a_chain_leads_from_the_root_to_its_link(robot: Baxter) -> None:
    tree = robot.description.tree
    chain = tree.chain("left_gripper")
    assert chain[0].parent == tree.root
    assert chain[-1].child == "left_gripper"
    assert [joint.child for joint in chain[:-1]] == [joint.parent for joint in chain[1:]]
    assert tree.chain(tree.root) == ()


numbers = st.floats(-10.0, 10.0)


@given(st.tuples(numbers, numbers, numbers), st.tuples(numbers, numbers, numbers))
def test_pinocchio_reads_a_joint_where_it_is(
    xyz: tuple[float, float, float], rpy: tuple[float, float, float]
) -> None:
    limits = JointRange(-1.0, 2.0, 3.0, 4.0)
    axis = (0.0, 0.0, 1.0)
    joint = UrdfJoint("j", JointKind.REVOLUTE, "base", "a", xyz, rpy, axis, limits)
    model = pin.buildModelFromXML(Urdf("base", (joint,)).text)
    expected = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz))
    rounding = 1e-14
    assert np.abs(model.jointPlacements[1].homogeneous - expected.homogeneous).max() < rounding
    assert (model.lowerPositionLimit[0], model.upperPositionLimit[0]) == (-1.0, 2.0)
    assert (model.velocityLimit[0], model.effortLimit[0]) == (3.0, 4.0)


names = st.sampled_from(
    [
        "left_w2",
        "left_w2_link",
        "left_w2_joint",
        "universe",
        "cam",
        "cam_link",
        "cam_joint",
        "torso",
    ]
)


@settings(max_examples=25)
@given(st.lists(st.tuples(names, names), max_size=6, unique_by=(lambda n: n[0], lambda n: n[1])))
def test_names_of_what_is_mounted_never_matter(robot: Baxter, added: list[tuple[str, str]]) -> None:
    """Each is mounted on the one before; Pinocchio finds every frame by its name alone."""
    tree = robot.description.tree
    parent = "left_hand_link"
    joints, taken = list(tree.joints), {tree.root, *tree.by_child, *tree.by_name}
    for name, child in added:
        if child not in tree.by_child and name not in tree.by_name:
            joints.append(UrdfJoint(name, JointKind.FIXED, parent, child, xyz=(0.0, 0.0, 0.01)))
            parent = child
    unique = with_unique_names(Urdf(tree.root, tuple(joints)))
    assert with_unique_names(unique) == unique
    loaded = Baxter.load(Urdf(tree.root, tuple(joints)).text)
    frames = [str(frame.name) for frame in loaded.model.frames]
    assert len(set(frames)) == len(frames)
    assert len(unique.joints) == len(joints)
    assert taken <= {unique.root, *unique.by_child, *unique.by_name}


@given(st.integers(0, 2**32 - 1))
def test_an_origin_is_that_of_its_pose(seed: int) -> None:
    rng = np.random.default_rng(seed)
    T = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
    xyz, rpy = origin_of(T)
    again = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz))
    assert np.abs(again.homogeneous - T.homogeneous).max() < 1e-14
