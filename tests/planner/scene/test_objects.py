"""The table and the block of the URDF files, compared with the measures of the original."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin.errors import PoseError
from planner import Body, Box, load_object, make_block
from planner.errors import SceneError
from planner.scene.objects import COLOURS, URDF_FOLDER
from tests.conftest import at

ORIGIN = at(0.0, 0.0, 0.0)
ROUNDING_M = 1e-12
BLOCK_EDGE_M = 0.05
TABLE_TOP_Z_M = -0.155
"""Upper side of the table in base, with the table on the floor 0.93 m below."""


def test_the_block_is_a_green_cube_of_5_cm_with_its_origin_at_the_minimum_corner() -> None:
    block = load_object("block", at(0.0, 0.0, 0.0))
    assert [part.shape for part in block.parts] == [Box((BLOCK_EDGE_M,) * 3)]
    for axis in np.eye(3):
        assert block.extent_m(axis) == pytest.approx((0.0, BLOCK_EDGE_M), abs=ROUNDING_M)
    red, green, blue, _ = block.parts[0].rgba
    assert green > 1.3 * max(red, blue)  # the gripper is red


def test_the_table_has_top_column_and_foot(table: Body) -> None:
    assert [part.shape for part in table.parts] == [
        Box((0.913, 0.913, 0.04)),
        Box((0.042, 0.042, 0.74)),
        Box((0.56, 0.56, 0.04)),
    ]
    extents = [(0.5435, 1.4565), (-0.4565, 0.4565), (-0.93, TABLE_TOP_Z_M)]
    for axis, extent in zip(np.eye(3), extents, strict=True):
        assert table.extent_m(axis) == pytest.approx(extent, abs=ROUNDING_M)


def test_the_block_of_the_scene_stands_on_the_table(table: Body, block: Body) -> None:
    assert block.extent_m((0, 0, 1))[0] == pytest.approx(TABLE_TOP_Z_M, abs=ROUNDING_M)


def test_visual_and_collision_shapes_are_the_same() -> None:
    for path in sorted(URDF_FOLDER.glob("*.urdf")):
        text = path.read_text(encoding="utf-8")
        shapes = {
            kind: [chunk.split("</geometry>")[0] for chunk in text.split(f"<{kind}>")[1:]]
            for kind in ("visual", "collision")
        }
        assert shapes["visual"] == shapes["collision"], path.name


def test_an_object_is_named_by_its_kind_and_fixed_by_default() -> None:
    assert load_object("block", at(0.0, 0.0, 0.0)).name == "block"
    assert load_object("block", at(0.0, 0.0, 0.0), name="brick").name == "brick"
    assert not load_object("block", at(0.0, 0.0, 0.0)).is_movable
    assert load_object("block", at(0.0, 0.0, 0.0), is_movable=True).is_movable


@pytest.mark.parametrize(
    "kind", ["chair", "", None, 5, "../urdf/block", "block.urdf", "x" * 5000, "a\0b", ["block"]]
)
def test_a_message_on_an_unknown_kind_names_those_available(kind: Any) -> None:
    with pytest.raises(SceneError, match="it has: block, table"):
        load_object(kind, at(0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        *(({"name": bad}, SceneError) for bad in ("", 5, ["a"])),
        *(
            ({"T_base_body": bad}, PoseError)
            for bad in (None, "here", np.eye(3), np.full((4, 4), np.nan))
        ),
    ],
    ids=str,
)
def test_objects_and_blocks_refuse_invalid_names_and_poses(
    arguments: dict[str, Any], error: type[Exception]
) -> None:
    name, T = arguments.get("name", "block"), arguments.get("T_base_body", at(0.0, 0.0, 0.0))
    with pytest.raises(error):
        load_object("block", T, name=name)
    with pytest.raises(error):
        make_block(name, T)


def test_a_block_is_a_movable_grey_cube_of_5_cm_about_its_centre() -> None:
    block = make_block("b", at(0.7, 0.1, 0.0))
    assert block.parts[0].shape == Box((0.05, 0.05, 0.05))
    assert block.centre_base == pytest.approx([0.7, 0.1, 0.0], abs=ROUNDING_M)
    assert block.is_movable
    assert block.parts[0].rgba == COLOURS["grey"]


def test_a_block_may_have_three_edges_and_a_colour() -> None:
    block = make_block("b", ORIGIN, edge_m=(0.02, 0.03, 0.04), colour=(0.1, 0.2, 0.3, 0.4))
    assert block.parts[0].shape == Box((0.02, 0.03, 0.04))
    assert block.parts[0].rgba == (0.1, 0.2, 0.3, 0.4)
    for colour, rgba in COLOURS.items():
        for coloured in (make_block(colour, ORIGIN), make_block("b", ORIGIN, colour=colour)):
            assert coloured.parts[0].rgba == rgba


@pytest.mark.parametrize(
    "options",
    [
        *(
            {"edge_m": bad}
            for bad in list[Any]([0.0, -0.05, np.nan, None, "5 cm", (0.05, 0.05), [], 99.0])
        ),
        *(
            {"colour": bad}
            for bad in list[Any](["pink", "", 5, (1.0, 0.0), (2.0, 0, 0, 1), [None] * 4])
        ),
    ],
    ids=str,
)
def test_a_block_refuses_invalid_edges_and_colours(options: dict[str, Any]) -> None:
    with pytest.raises(SceneError, match=r"edge|colour"):
        make_block("b", ORIGIN, **options)
