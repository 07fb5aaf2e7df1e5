from __future__ import annotations

import math
import random
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Baxter
from baxter_kin.description.urdf import (
    LARGEST_NUMBER,
    MAX_LINKS,
    JointKind,
    JointRange,
    ShapeKind,
    Urdf,
    UrdfJoint,
    UrdfShape,
    below,
    read_urdf,
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


# Reading

LIMIT = "<limit lower='-1' upper='2' velocity='3' effort='4'/>"


def text_of(joint: str = "", *, links: str = "<link name='base'/><link name='arm'/>") -> str:
    return f"<robot name='x'>{links}{joint}</robot>"


def joint_of(inside: str = LIMIT, *, name: str = "j", kind: str = "revolute") -> str:
    ends = "<parent link='base'/><child link='arm'/>"
    return f"<joint name='{name}' type='{kind}'>{ends}{inside}</joint>"


def read(joint: str) -> UrdfJoint:
    (found,) = read_urdf(text_of(joint), "base").joints
    return found


def test_what_is_not_said_is_as_urdf_has_it() -> None:
    found = read(joint_of("<limit velocity='1'/>".replace("/>", " upper='1'/>")))
    assert (found.xyz, found.rpy, found.axis) == ((0, 0, 0), (0, 0, 0), (1, 0, 0))
    assert found.range == JointRange(0.0, 1.0, 1.0, 0.0)


def test_every_number_is_kept_as_it_is_written() -> None:
    origin = "<origin xyz='.1 -2e-1 +3.' rpy='0.30000000000000004 1e-300 -0.0'/>"
    found = read(joint_of(f"{origin}<axis xyz='0 0 1'/>{LIMIT}"))
    assert found.xyz == (0.1, -0.2, 3.0)
    assert found.rpy == (0.30000000000000004, 1e-300, 0.0)
    assert math.copysign(1.0, found.rpy[2]) == 1.0


def test_a_long_axis_is_made_a_unit_one() -> None:
    assert read(joint_of(f"<axis xyz='0 3 4'/>{LIMIT}")).axis == (0.0, 0.6, 0.8)


def test_what_else_a_text_says_is_passed_over() -> None:
    visual = "<visual><geometry><mesh filename='package://nowhere/x.DAE'/></geometry></visual>"
    links = f"<link name='base'>{visual}</link><link name='arm'><inertial/></link>"
    more = "<gazebo><plugin/></gazebo><transmission><joint name='j'/></transmission><material/>"
    plain = read_urdf(text_of(joint_of()), "base")
    assert read_urdf(text_of(joint_of() + more, links=links), "base") == plain


def test_links_that_are_not_on_the_root_are_left_out() -> None:
    links = "".join(f"<link name='{name}'/>" for name in ("world", "base", "arm", "table"))
    fixed = "<joint name='{0}' type='fixed'><parent link='world'/><child link='{1}'/></joint>"
    above = fixed.format("a", "base") + fixed.format("b", "table")
    found = read_urdf(text_of(above + joint_of(), links=links), "base")
    assert [joint.child for joint in found.joints] == ["arm"]


large_numbers = st.floats(-LARGEST_NUMBER, LARGEST_NUMBER)
ranges = st.tuples(large_numbers, large_numbers).filter(lambda pair: pair[0] < pair[1])


@given(
    st.tuples(large_numbers, large_numbers, large_numbers),
    st.tuples(large_numbers, large_numbers, large_numbers),
    ranges,
)
def test_a_text_that_is_written_reads_back_the_same(
    xyz: tuple[float, float, float], rpy: tuple[float, float, float], limits: tuple[float, float]
) -> None:
    joint = UrdfJoint(
        "a<b>&'\"", JointKind.PRISMATIC, "base", "c&", xyz, rpy, range=JointRange(*limits, 1.0, 0.0)
    )
    fixed = replace(joint, name="d", kind=JointKind.FIXED, parent="c&", child="e", range=None)
    tree = Urdf("base", (joint, fixed))
    again = read_urdf(tree.text, "base")
    assert again == tree
    assert again.text == read_urdf(again.text, "base").text


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("<sdf/>", "its root is <sdf>"),
        (text_of("<xacro:include filename='x'/>"), "run xacro first"),
        (text_of(joint_of(f"<origin xyz='${{a}} 0 0'/>{LIMIT}")), "run xacro first"),
        (text_of(joint_of(name="${side}_s0")), "run xacro first"),
        (text_of(links="<link name='arm'/>"), "lacks the link 'base'"),
        (text_of(links="<link name='base'/><link name='base'/>"), "link base is there more than"),
        (text_of(links="<link/>"), "of the name ''"),
        (text_of(links="<link name='a\tb'/>"), None),
        (text_of(joint_of() + joint_of()), "joint j is there more than once"),
        (text_of(joint_of() + joint_of(name="k")), "link arm is there more than once"),
        (text_of(joint_of(), links="<link name='base'/>"), "names a link 'arm'"),
        (text_of(joint_of(kind="continuous")), "j is of type 'continuous'"),
        (text_of(joint_of(kind="floating")), "j is of type 'floating'"),
        (text_of(joint_of("")), "j has no <limit>"),
        (text_of(joint_of("<limit lower='0' upper='1'/>")), "without velocity"),
        (text_of(joint_of(LIMIT.replace("'2'", "'-1'"))), "empty range"),
        (text_of(joint_of(LIMIT.replace("'2'", "'nan'"))), "upper 'nan'"),
        (text_of(joint_of(LIMIT.replace("'2'", "'inf'"))), "upper 'inf'"),
        (text_of(joint_of(LIMIT.replace("'2'", "'1e7'"))), "upper '1e7'"),
        (text_of(joint_of(LIMIT.replace("'2'", "'1_0'"))), "upper '1_0'"),
        (text_of(joint_of(LIMIT.replace("'2'", "'\u0661'"))), "upper"),
        (text_of(joint_of(LIMIT.replace("'3'", "'0'"))), "velocity 0"),
        (text_of(joint_of(LIMIT.replace("'4'", "'-1'"))), "effort -1"),
        (text_of(joint_of(f"<origin xyz='0 0'/>{LIMIT}")), "three numbers"),
        (text_of(joint_of(f"<origin xyz=''/>{LIMIT}")), "three numbers"),
        (text_of(joint_of(f"<axis xyz='0 0 0'/>{LIMIT}")), "points nowhere"),
        (text_of(joint_of(f"<parent link='arm'/>{LIMIT}")), "2 links as parent"),
        (text_of(joint_of().replace("<child link='arm'/>", "")), "0 links as child"),
        (text_of(joint_of().replace("'arm'", "'base'")), "link base is there more than once"),
        (
            text_of(links="".join(f"<link name='{i}'/>" for i in range(MAX_LINKS + 1))),
            "1001 links",
        ),
    ],
)
def test_what_makes_no_sense_is_refused_in_a_sentence(text: str, reason: str | None) -> None:
    with pytest.raises(DescriptionError, match=reason) as refused:
        read_urdf(text, "base")
    assert str(refused.value).startswith(("it ", "its "))
    assert "\n" not in str(refused.value)


def test_a_circle_beside_the_root_is_left_out() -> None:
    links = "".join(f"<link name='{name}'/>" for name in ("base", "a", "b"))
    circle = "".join(
        f"<joint name='{p}' type='fixed'><parent link='{p}'/><child link='{c}'/></joint>"
        for p, c in (("a", "b"), ("b", "a"))
    )
    assert read_urdf(text_of(circle, links=links), "base").joints == ()
