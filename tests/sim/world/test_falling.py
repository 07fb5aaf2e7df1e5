"""Falling: where a body comes to rest, and what it tips off."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner import Body, Cylinder, Part, Sphere, make_block
from planner.scene.faces import FLOOR_Z_M
from planner.scene.support import FLOOR
from sim.errors import SimulationError
from sim.world.falling import GRAVITY_M_S2, SIDESTEP_M, Rest, come_to_rest
from tests.conftest import at

REST_M = 1e-7
EDGE_X_M = 0.5435
"""Where the table begins."""

TABLE_Z_M = -0.155


def cube(x: float, y: float = 0.0, z: float = 0.1, edge: float = 0.05) -> Body:
    return make_block("b", at(x, y, z), edge_m=edge)


@settings(max_examples=25)
@given(st.floats(-0.024, 0.024), st.floats(-3.0, 3.0))
def test_a_body_stays_on_an_edge_exactly_while_its_centre_is_above_it(
    table: Body, beyond: float, yaw: float
) -> None:
    T = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, yaw), np.array([EDGE_X_M - beyond, 0.0, 0.1]))
    rest = come_to_rest(cube(0.0).at(T), [table])
    if abs(beyond) > 2e-6:
        assert rest.support == (FLOOR if beyond > 0.0 else "table")
        assert rest.fell_off == (("table",) if beyond > 0.0 else ())


def test_a_body_that_tips_off_passes_clear_of_the_edge(table: Body) -> None:
    rest = come_to_rest(cube(EDGE_X_M - 0.01), [table])
    fallen = cube(0.0).at(rest.T_base_body)
    assert fallen.extent_m((1, 0, 0))[1] == pytest.approx(EDGE_X_M - SIDESTEP_M, abs=REST_M)
    assert fallen.extent_m((0, 0, 1))[0] == pytest.approx(FLOOR_Z_M, abs=REST_M)


def test_a_body_over_a_gap_stands_on_both_sides() -> None:
    sides = [
        make_block(name, at(x, 0.0, 0.0), edge_m=0.05) for name, x in (("l", 0.0), ("r", 0.07))
    ]
    plank = make_block("b", at(0.035, 0.0, 0.2), edge_m=(0.1, 0.03, 0.01))
    rest = come_to_rest(plank, sides)
    assert rest.support in ("l", "r")
    assert rest.fell_off == ()
    assert rest.T_base_body.translation[2] == pytest.approx(0.03, abs=REST_M)


def test_a_body_that_tips_off_a_block_lands_on_the_table(table: Body) -> None:
    below = make_block("below", at(0.8, 0.0, TABLE_Z_M + 0.025))
    rest = come_to_rest(cube(0.83), [table, below])
    assert (rest.support, rest.fell_off) == ("table", ("below",))
    assert rest.T_base_body.translation[0] == pytest.approx(0.825 + SIDESTEP_M + 0.025, abs=REST_M)


def test_a_body_leans_where_it_has_no_room_to_tip_off(table: Body) -> None:
    below = make_block("below", at(0.8, 0.0, TABLE_Z_M + 0.025))
    wall = make_block("wall", at(0.88, 0.0, TABLE_Z_M + 0.1), edge_m=(0.04, 0.2, 0.2))
    rest = come_to_rest(cube(0.83), [table, below, wall])
    assert (rest.support, rest.fell_off) == ("below", ())
    assert rest.beside_m == pytest.approx(0.005, abs=REST_M)


def test_a_ball_on_the_side_of_a_ball_falls_off() -> None:
    def ball(name: str, x: float, z: float) -> Body:
        return Body(name, (Part(Sphere(0.03), at(0, 0, 0)),), at(x, 0.0, z), is_movable=True)

    below = ball("below", 0.0, FLOOR_Z_M + 0.03)
    assert come_to_rest(ball("b", 0.01, 0.0), [below]).support == FLOOR
    assert come_to_rest(ball("b", 0.0, 0.0), [below]).support == "below"


def test_a_block_stands_on_a_post_thinner_than_itself() -> None:
    post = Body("post", (Part(Cylinder(0.01, 0.2), at(0, 0, 0)),), at(0.0, 0.0, 0.0))
    assert come_to_rest(cube(0.009, z=0.3), [post]).support == "post"
    assert come_to_rest(cube(0.011, z=0.3), [post]).support == FLOOR


def test_a_fall_takes_the_time_of_its_legs(table: Body) -> None:
    rest = come_to_rest(cube(EDGE_X_M - 0.01, z=TABLE_Z_M + 0.025 + 0.1), [table])
    first, second = rest.legs
    assert first.drop_m == pytest.approx(0.1, abs=REST_M)
    assert second.drop_m == pytest.approx(TABLE_Z_M - FLOOR_Z_M, abs=REST_M)
    expected = sum(math.sqrt(2 * drop / GRAVITY_M_S2) for drop in (first.drop_m, second.drop_m))
    assert rest.duration_s == pytest.approx(expected, abs=1e-9)


def test_a_falling_body_is_never_inside_what_it_falls_off(table: Body) -> None:
    rest = come_to_rest(cube(EDGE_X_M - 0.01), [table])
    for time_s in np.linspace(0.0, rest.duration_s, 50):
        fallen = cube(0.0).at(rest.pose(float(time_s)))
        beside = fallen.extent_m((1, 0, 0))[1] < EDGE_X_M
        above = fallen.extent_m((0, 0, 1))[0] > TABLE_Z_M - REST_M
        assert beside or above
    assert rest.pose(0.0) == cube(EDGE_X_M - 0.01).T_base_body
    assert rest.pose(rest.duration_s) == rest.T_base_body


@settings(max_examples=25)
@given(st.floats(0.45, 0.65), st.floats(-0.5, 0.5), st.floats(-3.0, 3.0))
def test_a_body_at_rest_stays_where_it_is(table: Body, x: float, y: float, yaw: float) -> None:
    T = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, yaw), np.array([x, y, 0.1]))
    first = come_to_rest(cube(0.0).at(T), [table])
    again = come_to_rest(cube(0.0).at(first.T_base_body), [table])
    assert again.support == first.support
    assert again.T_base_body.homogeneous == pytest.approx(first.T_base_body.homogeneous, abs=REST_M)


def test_a_body_rests_on_something() -> None:
    with pytest.raises(SimulationError):
        Rest(at(0.0, 0.0, 0.0), (), 0.0)
