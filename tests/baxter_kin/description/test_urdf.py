from __future__ import annotations

import math
import random
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
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
)
from baxter_kin.errors import DescriptionError


def fixed(name: str, parent: str, child: str) -> UrdfJoint:
    return UrdfJoint(name, JointKind.FIXED, parent, child)


@pytest.mark.parametrize(
    "given",
    [
        (ShapeKind.BOX, (0.1, 0.1)),
        (ShapeKind.SPHERE, (0.0,)),
        (ShapeKind.CYLINDER, (0.1, float("inf"))),
        (ShapeKind.SPHERE, (float("nan"),)),
        ("ball", (0.1,)),
    ],
)
def test_a_shape_that_cannot_be_is_refused(given: Any) -> None:
    with pytest.raises(DescriptionError):
        UrdfShape(*given)


def test_a_shape_that_is_nowhere_is_refused_by_what_is_not_finite() -> None:
    with pytest.raises(DescriptionError, match="xyz of a sphere is not finite"):
        UrdfShape(ShapeKind.SPHERE, (0.1,), xyz=(0.0, math.inf, 0.0))


def test_a_tree_has_every_joint_on_its_root() -> None:
    circle = (
        UrdfJoint("j", JointKind.FIXED, "a", "b"),
        UrdfJoint("k", JointKind.FIXED, "b", "a"),
    )
    with pytest.raises(DescriptionError, match="joint j is not on 'base'"):
        Urdf("base", circle)


@pytest.mark.parametrize(
    ("joints", "reason"),
    [
        ((fixed("j", "base", "a"), fixed("j", "a", "b")), "its joint j is there more than once"),
        ((fixed("j", "base", "a"), fixed("k", "base", "a")), "its link a is there more than once"),
        ((fixed("j", "base", "base"),), "its link base is there more than once"),
    ],
)
def test_a_name_that_is_there_twice_is_refused(joints: tuple[UrdfJoint, ...], reason: str) -> None:
    with pytest.raises(DescriptionError, match=reason):
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
