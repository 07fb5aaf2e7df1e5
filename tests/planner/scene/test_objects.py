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


def test_the_table_stands_on_the_floor_and_its_top_is_at_minus_155_mm(table: Body) -> None:
    assert table.extent_m((0, 0, 1)) == pytest.approx((-0.93, TABLE_TOP_Z_M), abs=ROUNDING_M)


def test_the_table_covers_what_the_original_covers(table: Body) -> None:
    assert table.extent_m((1, 0, 0)) == pytest.approx((0.5435, 1.4565), abs=ROUNDING_M)
    assert table.extent_m((0, 1, 0)) == pytest.approx((-0.4565, 0.4565), abs=ROUNDING_M)


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


def test_an_object_is_named_by_its_kind_by_default() -> None:
    assert load_object("block", at(0.0, 0.0, 0.0)).name == "block"
    assert load_object("block", at(0.0, 0.0, 0.0), name="brick").name == "brick"


def test_an_object_is_fixed_by_default() -> None:
    assert not load_object("block", at(0.0, 0.0, 0.0)).is_movable
    assert load_object("block", at(0.0, 0.0, 0.0), is_movable=True).is_movable


@pytest.mark.parametrize(
    "kind", ["chair", "", None, 5, "../urdf/block", "block.urdf", "x" * 5000, "a\0b", ["block"]]
)
def test_a_message_on_an_unknown_kind_names_those_available(kind: Any) -> None:
    with pytest.raises(SceneError, match="it has: block, table"):
        load_object(kind, at(0.0, 0.0, 0.0))


@pytest.mark.parametrize("name", ["", 5, ["a"]])
def test_an_object_refuses_an_invalid_name(name: Any) -> None:
    with pytest.raises(SceneError, match="name"):
        load_object("block", at(0.0, 0.0, 0.0), name=name)


@pytest.mark.parametrize("pose", [None, "here", np.eye(3), np.full((4, 4), np.nan)])
def test_an_object_refuses_an_invalid_pose(pose: Any) -> None:
    with pytest.raises(PoseError):
        load_object("block", pose)


class TestBlocks:
    """Blocks of any size and colour."""

    def test_a_block_is_a_movable_cube_of_5_cm_about_its_centre(self) -> None:
        block = make_block("b", at(0.7, 0.1, 0.0))
        assert block.parts[0].shape == Box((0.05, 0.05, 0.05))
        assert block.centre_base == pytest.approx([0.7, 0.1, 0.0], abs=ROUNDING_M)
        assert block.is_movable

    def test_a_block_may_have_three_edges(self) -> None:
        block = make_block("b", at(0.0, 0.0, 0.0), edge_m=(0.02, 0.03, 0.04))
        assert block.parts[0].shape == Box((0.02, 0.03, 0.04))

    @pytest.mark.parametrize("colour", sorted(COLOURS))
    def test_a_block_named_after_a_colour_has_it(self, colour: str) -> None:
        named = make_block(colour, at(0.0, 0.0, 0.0))
        asked = make_block("b", at(0.0, 0.0, 0.0), colour=colour)
        assert named.parts[0].rgba == asked.parts[0].rgba == COLOURS[colour]

    def test_a_block_of_another_name_is_grey(self) -> None:
        assert make_block("b", at(0.0, 0.0, 0.0)).parts[0].rgba == COLOURS["grey"]

    def test_a_colour_may_be_given_in_numbers(self) -> None:
        block = make_block("b", at(0.0, 0.0, 0.0), colour=(0.1, 0.2, 0.3, 0.4))
        assert block.parts[0].rgba == (0.1, 0.2, 0.3, 0.4)

    @pytest.mark.parametrize("edge_m", [0.0, -0.05, np.nan, None, "5 cm", (0.05, 0.05), [], 99.0])
    def test_refuses_an_invalid_edge(self, edge_m: Any) -> None:
        with pytest.raises(SceneError, match="edge"):
            make_block("b", at(0.0, 0.0, 0.0), edge_m=edge_m)

    @pytest.mark.parametrize("colour", ["pink", "", 5, (1.0, 0.0, 0.0), (2.0, 0, 0, 1), [None] * 4])
    def test_refuses_an_invalid_colour(self, colour: Any) -> None:
        with pytest.raises(SceneError, match="colour"):
            make_block("b", at(0.0, 0.0, 0.0), colour=colour)

    @pytest.mark.parametrize("name", ["", None, 5, ["red"]])
    def test_refuses_an_invalid_name(self, name: Any) -> None:
        with pytest.raises(SceneError, match="name"):
            make_block(name, at(0.0, 0.0, 0.0))
