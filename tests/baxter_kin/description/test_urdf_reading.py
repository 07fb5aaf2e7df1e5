from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.description.urdf import JointKind, JointRange, Urdf, UrdfJoint
from baxter_kin.description.urdf_reading import (
    MAX_ELEMENTS,
    MAX_LINKS,
    MAX_NESTING,
    MAX_NUMBER,
    MAX_TEXT_BYTES,
    Element,
    read_urdf,
    read_xml,
)
from baxter_kin.errors import DescriptionError


def test_elements_and_attributes_keep_their_order() -> None:
    root = read_xml("<a x='1'><b/>words<c y='2'/><b z='3'/></a>")
    assert (root.name, root.attributes) == ("a", {"x": "1"})
    assert [child.name for child in root.children] == ["b", "c", "b"]
    assert [child.attributes for child in root.all("b")] == [{}, {"z": "3"}]
    assert root.first("c") == Element("c", {"y": "2"})
    assert root.first("d") is None


def test_text_is_kept_up_to_the_first_child() -> None:
    root = read_xml("<a> one\ntwo &amp; three<b>four</b>five</a>")
    assert (root.text, root.children[0].text) == (" one\ntwo & three", "four")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "latin-1"])
def test_bytes_are_decoded_as_their_first_line_states(encoding: str) -> None:
    text = f"<?xml version='1.0' encoding='{encoding}'?><a x='\xe9'/>"
    assert read_xml(text.encode(encoding)).attributes == {"x": "\xe9"}


def test_encoding_in_the_first_line_of_a_str_is_ignored() -> None:
    assert (
        read_xml("<?xml version='1.0' encoding='latin-1'?><a x='\xe9'/>").attributes["x"] == "\xe9"
    )


LAUGHS = "".join(f"<!ENTITY l{i} '{f'&l{i - 1};' * 10}'>" for i in range(1, 30))


@pytest.mark.parametrize(
    "text",
    [
        f"<!DOCTYPE a [<!ENTITY l0 'ha'>{LAUGHS}]><a>&l29;</a>",
        "<!DOCTYPE a [<!ENTITY x SYSTEM 'file:///etc/passwd'>]><a>&x;</a>",
        "<!DOCTYPE a SYSTEM 'http://127.0.0.1/a.dtd'><a/>",
        "<!DOCTYPE a [<!ENTITY % x SYSTEM 'file:///etc/passwd'> %x;]><a/>",
        "<!DOCTYPE a><a/>",
        "<a>&x;</a>",
        "",
        "<a>",
        "<a></b>",
        "<a/><b/>",
        "<a x='1' x='2'/>",
        "<a \ud800/>",
        b"<?xml version='1.0' encoding='no-such'?><a/>",
        b"<?xml version='1.0' encoding='shift_jis'?><a/>",
        b"\xff\xfe<",
        b"<a>\xff</a>",
        "<a>\0</a>",
        b"<a>" + MAX_TEXT_BYTES * b" " + b"</a>",
        "<a>" * (MAX_NESTING + 1),
        "<a>" + (MAX_ELEMENTS + 1) * "<b/>",
    ],
    ids=lambda text: str(text[:40]),
)
def test_texts_that_are_not_plain_xml_are_refused(text: str | bytes) -> None:
    with pytest.raises(DescriptionError):
        read_xml(text)


def test_the_deepest_nesting_is_read() -> None:
    deepest = "<a>" * MAX_NESTING + "</a>" * MAX_NESTING
    assert read_xml(deepest).name == "a"


@given(st.one_of(st.binary(max_size=200), st.text(max_size=200)))
def test_anything_is_read_or_refused(text: str | bytes) -> None:
    with suppress(DescriptionError):
        assert read_xml(text).name


def test_no_file_is_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("builtins.open", None)
    assert read_xml(f"<a href='{tmp_path}/b'><?xml-stylesheet href='c'?></a>").name == "a"


LIMIT = "<limit lower='-1' upper='2' velocity='3' effort='4'/>"


def text_of(joint: str = "", *, links: str = "<link name='base'/><link name='arm'/>") -> str:
    return f"<robot name='x'>{links}{joint}</robot>"


def joint_of(inside: str = LIMIT, *, name: str = "j", kind: str = "revolute") -> str:
    ends = "<parent link='base'/><child link='arm'/>"
    return f"<joint name='{name}' type='{kind}'>{ends}{inside}</joint>"


def read(joint: str) -> UrdfJoint:
    (found,) = read_urdf(text_of(joint), "base").joints
    return found


def test_defaults_are_those_of_urdf() -> None:
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


def test_other_elements_are_ignored() -> None:
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


large_numbers = st.floats(-MAX_NUMBER, MAX_NUMBER)
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
def test_invalid_texts_are_refused_in_a_sentence(text: str, reason: str | None) -> None:
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
