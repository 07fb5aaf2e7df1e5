"""Random problems of ten families, each the same for the same seed and number.

Everything stands on the demo's table, or on meshes that do. Some problems have no solution, on
purpose. This module alone calls the planner, for something to check.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from planner import (
    Attachment,
    Body,
    Box,
    Cylinder,
    Manipulator,
    Mesh,
    Part,
    PickAndPlace,
    Plan,
    Scene,
    Sphere,
    load_object,
    overhead_grasp,
    plan_pick_and_place,
    plan_start_move,
)
from planner.scene.support import settle
from referee.robot import load_robot
from referee.solids import Array, distance_m, hull_solid, inverse
from referee.stage import Thing
from sim import World

Choice = TypeVar("Choice")

TABLE_Z_M = -0.155
"""Height of the table's top, seen from base."""

WIDEST_OFF_M, NARROWEST_OFF_M = 0.007, 0.003
"""How much narrower than the open hand, and wider than the closed one, bodies are made."""

HEAD_M, HEAD_DISTANCE_M = np.array([0.11, 0.0, 0.75]), 0.40
"""Random configurations of an arm keep off the head."""

OBSTACLE_DISTANCE_M = 0.09
"""From obstacles to the axes of pick and place."""

BODY = "body"

CROWDED = (
    *("lower_elbow", "upper_forearm", "lower_forearm"),
    *("wrist", "lower_shoulder", "upper_elbow"),
)
"""Links that small cubes are put close to."""

MIN_NEAR_M, MAX_NEAR_M, CROWDING_TRIES = 0.008, 0.06, 8
"""How far these are from the arm where it stops, and how often that is tried."""


@dataclass(frozen=True, eq=False)
class Problem:
    """What is to be planned.

    Attributes:
        manipulator: the arm, and the configuration of everything else.
        scene: all bodies.
        q_start: of the arm, shape (7,).
        task: what goes where; None for a free move.
        q_goal: of a free move.
        margin_m: to be kept.
        held: what the other hand holds.
    """

    manipulator: Manipulator
    scene: Scene
    q_start: Array
    task: PickAndPlace | None = None
    q_goal: Array | None = None
    margin_m: float = 0.0
    held: tuple[Attachment, ...] = ()

    @property
    def ends(self) -> list[pin.SE3]:
        """Poses of the tip at pick and place; none of a free move."""
        return [] if self.task is None else [self.task.T_base_pick, self.task.T_base_place]

    def with_task(self, **changes: Any) -> Problem:
        """The same with another task."""
        return evolve(self, task=evolve(self.task, **changes))  # type: ignore[type-var]

    def with_bodies(self, bodies: Sequence[Body]) -> Problem:
        """The same with more bodies."""
        return evolve(self, scene=Scene.of([*self.scene, *bodies]))


def make_problem(family: str, number: int, seed: int) -> Problem:
    """The problem of a family and number."""
    return FAMILIES[family](
        Draw(np.random.default_rng([seed, list(FAMILIES).index(family), number]))
    )


def planned(problem: Problem) -> Plan:
    """The planner's answer to a problem."""
    at = problem.manipulator, problem.scene, problem.q_start
    options: dict[str, Any] = {"margin_m": problem.margin_m, "held": problem.held}
    if problem.task is None:
        return plan_start_move(*at, problem.q_goal, **options)
    return plan_pick_and_place(problem.task, *at, **options)


class Draw:
    """Random choices."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng

    def within(self, low: float, high: float) -> float:
        """A number."""
        return float(self.rng.uniform(low, high))

    def count(self, low: int, high: int) -> int:
        """A whole number, `high` left out."""
        return int(self.rng.integers(low, high))

    def one(self, options: Sequence[Choice]) -> Choice:
        """One of several."""
        return options[self.count(0, len(options))]

    def number(self, *options: float) -> float:
        """One of several numbers."""
        return float(self.rng.choice(options))

    def happens(self, share: float) -> bool:
        """True at this share."""
        return bool(self.rng.random() < share)

    def angle(self, limit_rad: float = math.pi) -> float:
        """An angle of either sign."""
        return self.within(-limit_rad, limit_rad)

    def limb(self) -> str:
        """An arm, mostly the left one."""
        return "left" if self.happens(0.7) else "right"

    def width(self, m: Manipulator, narrowest: float = 0.0, widest: float = 1.0) -> float:
        """A width that the hand can grasp."""
        low = max(m.hand.closed_gap_m + NARROWEST_OFF_M, narrowest)
        return self.within(low, max(low, min(m.hand.open_gap_m - WIDEST_OFF_M, widest)))

    def gap(self) -> float:
        """How far a part is above what another part of its body stands on, often about nothing."""
        return self.number(0.0, self.within(2e-4, 1e-3), self.within(1e-3, 0.04))


# Families


def _plain(draw: Draw) -> Problem:
    m = _manipulator(draw.limb())
    return _transfer(draw, m, _block(draw, m))


def _obstacles(draw: Draw) -> Problem:
    problem = _among(draw, _plain(draw), draw.count(1, 4))
    return _crowded(draw, problem, draw.count(1, 3))


def _odd(draw: Draw) -> Problem:
    m = _manipulator(draw.limb())
    makers = (_stem, _stem, _stem, _ell, _dumbbell, _cylinder, _ball, _prism)
    parts, tip_height_m = draw.one(makers)(draw, m)
    return _transfer(draw, m, parts, tip_height_m)


def _bins(draw: Draw) -> Problem:
    problem = _plain(draw)
    ends = problem.ends
    chosen = draw.one([ends[:1], ends[1:], ends])
    walls = [wall for i, T in enumerate(chosen) for wall in _bin(draw, f"bin{i}", T.translation)]
    return problem.with_bodies(walls)


def _margins(draw: Draw) -> Problem:
    m = _manipulator(draw.limb())
    problem = _transfer(draw, m, _block(draw, m, lowest=0.06), highest_m=0.0)
    assert problem.task is not None
    # fingers may come near the body only where the tip goes straight, so from above it
    problem = problem.with_task(clear_m=0.13, hover_m=max(0.13, problem.task.hover_m))
    problem = evolve(problem, margin_m=draw.within(0.002, 0.020))
    return _among(draw, problem, draw.count(0, 3))


def _rods(draw: Draw) -> Problem:
    m = _manipulator(draw.limb())
    width = draw.within(m.hand.closed_gap_m + 0.003, 0.03)
    problem = _transfer(draw, m, [_part(Box((width, width, draw.within(0.02, 0.05))))])
    return problem.with_bodies([_rod(draw, m, draw.one(problem.ends), width)])


def _other_hand(draw: Draw) -> Problem:
    limb = draw.limb()
    other = "right" if limb == "left" else "left"
    base, holder = _manipulator(limb), _manipulator(other)
    problem = _among(draw, _transfer(draw, base, _block(draw, base)), draw.count(0, 2))
    world = World(base.robot)
    for body in problem.scene:
        world.spawn(body)
    width = draw.within(holder.hand.closed_gap_m + 0.004, 0.04)
    height = draw.within(0.02, 0.12)
    world.spawn(_body("held", Box((width, width, height)), _at(0.9, 0.0, 0.5), is_movable=True))
    world.move_arm(other, _hovering(draw, holder, low=0.02, high=0.25))
    world.set_fingers(other, (width - holder.hand.closed_gap_m) / 2 + 2e-4)
    down_m = draw.within(0.0, height / 2 - 0.008) if height > 0.05 else 0.0
    world.attach(other, "held", _at(0.0, 0.0, down_m))
    held = tuple(found for found in [world.holding(other)] if found is not None)
    manipulator = evolve(base, q_others=world.q)
    return evolve(problem, manipulator=manipulator, scene=world.scene, held=held)


def _free(draw: Draw) -> Problem:
    m = _manipulator(draw.limb())
    start, goal = (_hovering(draw, m, low=-0.02, high=0.35) for _ in range(2))
    ends = [m.arm.T_base_tip(q) for q in (start, goal)]
    problem = Problem(m, Scene.of([_table()]), start, q_goal=goal)
    for number in range(draw.count(2, 6)):
        found = _obstacle(draw, f"obstacle{number}", ends, m)
        clear = [b for b in found if _arm_distance_m(m, b, [start, goal]) > MIN_NEAR_M]
        problem = problem.with_bodies(clear)
    margin_m = draw.within(0.002, 0.01) if draw.happens(0.3) else 0.0
    return _crowded(draw, evolve(problem, margin_m=margin_m), draw.count(0, 3))


def _several_parts(draw: Draw) -> Problem:
    """Parts that hang a little above what the body stands on, which is often in parts, too."""
    m = _manipulator(draw.limb())
    problem = _transfer(draw, m, draw.one((_mug, _tee))(draw, m), highest_m=0.001)
    if draw.happens(0.4):  # off the middle, so that a finger pushes the body along its support
        aside = _at(0.0, draw.within(-0.004, 0.004), 0.0)
        pick, place = (T * aside for T in problem.ends)
        problem = problem.with_task(T_base_pick=pick, T_base_place=place)
    if draw.happens(0.5):
        problem = _on_a_step(draw, problem)
    if draw.happens(0.3):
        problem = evolve(problem, margin_m=draw.within(0.0, 0.003))
    return problem


def _on_meshes(draw: Draw) -> Problem:
    """A pick, a place or both on surfaces: bins, trays, stairs, plates off level or with holes."""
    problem = _plain(draw)
    T_pick, T_place = problem.ends
    body = problem.scene[BODY]
    problem = evolve(problem, scene=problem.scene.without(BODY))
    for i in draw.one(([0], [1], [0, 1])):
        support = _mesh_support(draw, f"support{i}", problem.ends[i].translation)
        problem = problem.with_bodies([support])
    T_body_pick = body.T_base_body.inverse() * T_pick
    lift_m = draw.number(0.0, draw.within(0.0, 0.004))
    rested, put = (
        settle(body.at(_at(0.0, 0.0, 0.15) * T), list(problem.scene)).body
        for T in (body.T_base_body, T_place * T_pick.inverse() * body.T_base_body)
    )
    return problem.with_bodies([rested]).with_task(
        T_base_pick=rested.T_base_body * T_body_pick,
        T_base_place=_at(0.0, 0.0, lift_m) * put.T_base_body * T_body_pick,
    )


FAMILIES: dict[str, Callable[[Draw], Problem]] = {
    "plain": _plain,
    "obstacles": _obstacles,
    "odd bodies": _odd,
    "bins": _bins,
    "margins": _margins,
    "rods": _rods,
    "other hand holding": _other_hand,
    "free moves": _free,
    "several parts near supports": _several_parts,
    "meshes as supports": _on_meshes,
}


# Bodies, some with the height at which they are grasped


def _block(draw: Draw, m: Manipulator, *, lowest: float = 0.02) -> list[Part]:
    x, y = draw.width(m), draw.within(0.02, 0.09)
    return [_part(Box((x, y, draw.within(lowest, 0.10))))]


def _stem(draw: Draw, m: Manipulator) -> tuple[list[Part], float]:
    """A stem with a crossbar above, wider than the stem, taken by the stem."""
    width, height = draw.width(m, widest=0.025), draw.within(0.07, 0.12)
    across = draw.within(width, 0.055)
    along = across + draw.within(0.0, 0.02)  # longer, so that the hand comes across
    bar = _part(Box((along, across, 0.02)), z=height - 0.01)
    return [_part(Box((width, width, height)), z=height / 2), bar], draw.within(0.015, 0.03)


def _ell(draw: Draw, m: Manipulator) -> tuple[list[Part], float]:
    width, height = draw.width(m, widest=0.035), draw.within(0.05, 0.12)
    length, off = draw.within(0.05, 0.12), width / 2
    post = _part(Box((width, width, height)), z=height / 2)
    if draw.count(0, 2):
        foot = _part(Box((length, width, 0.02)), x=length / 2 - off, z=0.01)
    else:
        foot = _part(Box((width, length, 0.02)), y=length / 2 - off, z=0.01)
    return [post, foot], draw.within(0.03, height + 0.01)


def _dumbbell(draw: Draw, m: Manipulator) -> tuple[list[Part], float]:
    """A rod between two discs."""
    radius, height = draw.width(m, widest=0.026) / 2, draw.within(0.08, 0.13)
    disc = Cylinder(draw.within(radius, 0.035), 0.012)
    rod = _part(Cylinder(radius, height), z=height / 2)
    parts = [rod, _part(disc, z=0.006), _part(disc, z=height - 0.006)]
    return parts, draw.within(0.03, height - 0.02)


def _cylinder(draw: Draw, m: Manipulator) -> tuple[list[Part], None]:
    return [_part(Cylinder(draw.width(m) / 2, draw.within(0.02, 0.12)))], None


def _ball(draw: Draw, m: Manipulator) -> tuple[list[Part], None]:
    return [_part(Sphere(draw.width(m, narrowest=0.02) / 2))], None


def _prism(draw: Draw, m: Manipulator) -> tuple[list[Part], None]:
    """A frustum of five to eight sides, as a mesh."""
    radius, height = draw.width(m) / 2.1, draw.within(0.03, 0.10)
    sides, top = draw.count(5, 9), draw.within(0.7, 1.0)
    turn = 2 * math.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(sides)], axis=1) * [radius, radius, 0]
    hull = hull_solid("mesh", np.concatenate([ring, ring * top + [0.0, 0.0, height]]))
    corners = hull.vertices[hull.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    middle = hull.vertices.mean(axis=0)
    outwards = np.einsum("ij,ij->i", normals, corners.mean(axis=1) - middle) > 0
    faces = np.where(outwards[:, None], hull.faces, hull.faces[:, ::-1])
    return [_part(Mesh(hull.vertices, faces))], None


def _mug(draw: Draw, m: Manipulator) -> list[Part]:
    """A cylinder with a handle on either side, turned by up to half a right angle."""
    radius, height = draw.width(m, narrowest=0.03) / 2, draw.within(0.06, 0.1)
    gap, long = draw.gap(), draw.within(0.015, 0.03)
    high = draw.within(0.015, height - 0.042)
    turn = draw.number(0.0, math.pi) + draw.angle(math.pi / 4)
    place = _at(0.0, 0.0, 0.0, turn) * _at(radius + long / 2 - 0.002, 0.0, gap + high / 2)
    handle = Part(Box((long, draw.within(0.005, 0.012), high)), place)
    return [_part(Cylinder(radius, height), z=height / 2), handle]


def _tee(draw: Draw, m: Manipulator) -> list[Part]:
    """A post with one or two blocks at its sides."""
    width, height = draw.width(m), draw.within(0.06, 0.1)
    parts = [_part(Box((width, width, height)), z=height / 2)]
    for side in draw.one(((1.0,), (-1.0,), (1.0, -1.0))):
        gap, high = draw.gap(), draw.within(0.01, height - 0.045)
        long = draw.within(0.01, 0.03)
        shape = Box((long, min(width, 0.02), high))
        parts.append(_part(shape, x=side * (width / 2 + long / 2), z=gap + high / 2))
    return parts


# What stands around


def _on_a_step(draw: Draw, problem: Problem) -> Problem:
    """The same problem with a body of two heights, on which the grasped one is put."""
    pick, place = problem.ends
    height, drop = draw.within(0.02, 0.06), draw.gap()
    low, wide = max(0.004, height - drop), draw.within(0.05, 0.09)
    upper = _part(Box((wide, wide, height)), z=height / 2)
    lower = _part(Box((0.05, wide, low)), x=wide / 2 + 0.025, z=low / 2)
    x, y, _ = (place * pick.inverse() * problem.scene[BODY].T_base_body).translation
    T_step = _at(x, y, TABLE_Z_M, draw.angle())
    step = Body("step", (upper, lower), T_step, is_movable=bool(draw.count(0, 2)))
    return problem.with_bodies([step]).with_task(T_base_place=_at(0.0, 0.0, height) * place)


def _rod(draw: Draw, m: Manipulator, T: pin.SE3, width_m: float) -> Body:
    """A post beside a finger: between its open and its closed pad, or just outside."""
    thick, height = draw.within(0.004, 0.010), draw.within(0.02, 0.07)
    open_m = m.hand.open_gap_m / 2
    beside = draw.within(width_m / 2 + thick / 2 + 0.001, open_m - thick / 2)
    if draw.happens(0.7):
        beside = open_m + draw.within(0.022, 0.045) + thick / 2
    side, across = draw.number(-1.0, 1.0), draw.within(-0.022, 0.022)
    x, y, _ = T.translation + T.rotation @ np.array([across, side * beside, 0.0])
    angle = math.atan2(T.rotation[1, 0], T.rotation[0, 0])
    shape: Any = Box((draw.within(0.004, 0.012), thick, height))
    if draw.happens(0.4):
        shape = Cylinder(thick / 2, height)
    T_rod = _at(x, y, TABLE_Z_M + height / 2, angle)
    return _body("rod", shape, T_rod, is_movable=bool(draw.count(0, 2)))


def _bin(draw: Draw, name: str, centre: Array) -> list[Body]:
    """Four walls around a point, their turn at random."""
    x, y = draw.rng.uniform(0.05, 0.12, size=2)
    height, angle = draw.within(0.02, 0.09), draw.angle()
    off = draw.rng.uniform(-0.01, 0.01, size=2)
    T_bin = _at(*(centre[:2] + off), TABLE_Z_M + height / 2, angle)
    walls = []
    for number, (dx, dy) in enumerate(((1, 0), (-1, 0), (0, 1), (0, -1))):
        size = (0.008, 2 * y, height) if dx else (2 * x, 0.008, height)
        T = T_bin * _at(dx * (x + 0.004), dy * (y + 0.004), 0.0)
        walls.append(_body(f"{name}_wall{number}", Box(size), T))
    return walls


def _mesh_support(draw: Draw, name: str, centre: Array) -> Body:
    """A surface on the table, around a point or with it somewhere on its edge."""
    makers = (_bin_sheets, _tray_sheets, _stair_sheets, _plate_sheets, _grate_sheets)
    corners = np.concatenate(draw.one(makers)(draw))
    vertices, numbers = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    x, y = centre[:2] + draw.rng.uniform(-0.02, 0.02, size=2)
    T = _at(x, y, TABLE_Z_M + 0.001, draw.angle())
    return _body(name, Mesh(vertices, numbers.reshape(-1, 3)), T)


def _bin_sheets(draw: Draw) -> list[Array]:
    """A floor and four walls without thickness."""
    x, y = draw.within(0.06, 0.12), draw.within(0.06, 0.12)
    return [_level((-x, x), (-y, y), 0.0), *_walls(x, y, draw.within(0.01, 0.06))]


def _tray_sheets(draw: Draw) -> list[Array]:
    """A floor, and around it a rim that is broad and higher."""
    x, y, rim = draw.within(0.06, 0.12), draw.within(0.06, 0.12), draw.within(0.002, 0.012)
    wide, found = 0.015, [_level((-x, x), (-y, y), 0.0), *_walls(x, y, rim)]
    for sign in (-1.0, 1.0):
        found.append(_level((-x - wide, x + wide), (sign * y, sign * (y + wide)), rim))
        found.append(_level((sign * x, sign * (x + wide)), (-y, y), rim))
    return found


def _stair_sheets(draw: Draw) -> list[Array]:
    """Three steps with risers."""
    deep, high = draw.within(0.05, 0.10), draw.within(0.002, 0.03)
    found = []
    for number in range(3):
        x, z = (number - 1.5) * deep, number * high
        found.append(_level((x, x + deep), (-0.08, 0.08), z))
        if number:
            found.append(_riser((x, -0.08), (x, 0.08), z - high, z))
    return found


def _plate_sheets(draw: Draw) -> list[Array]:
    """A plate off level, most by less than a degree, with a triangle that rises at its far edge."""
    reach, rise = 0.1, draw.within(0.0, 0.002)
    slope = math.radians(draw.number(0.0, 1e-3, draw.within(0.0, 1.2)))
    turn = pin.exp3(slope * _at(0.0, 0.0, 0.0, draw.angle(3.0)).rotation[:, 0])
    plate = _level((-reach, reach), (-reach, reach), 0.0)
    flap = np.array([[[reach, -reach, 0.0], [reach, reach, 0.0], [reach + 0.1, 0.0, rise]]])
    return [np.concatenate([plate, flap]) @ turn.T + [0.0, 0.0, 0.004]]


def _grate_sheets(draw: Draw) -> list[Array]:
    """A plate with a hole, into which some bodies fall."""
    outer, hole, z = 0.1, draw.within(0.005, 0.06), 0.004
    bands = ((-outer, -hole), (hole, outer))
    whole = [_level((-outer, outer), band, z) for band in bands]
    return [*whole, *(_level(band, (-hole, hole), z) for band in bands)]


def _sheet(*corners: tuple[float, float, float]) -> Array:
    """Two triangles between four corners, shape (2, 3, 3)."""
    a, b, c, d = np.array(corners)
    return np.array([[a, b, c], [a, c, d]])


def _level(xs: tuple[float, float], ys: tuple[float, float], z: float) -> Array:
    (x0, x1), (y0, y1) = sorted(xs), sorted(ys)
    return _sheet((x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z))


def _riser(a: tuple[float, float], b: tuple[float, float], low: float, high: float) -> Array:
    return _sheet((*a, low), (*b, low), (*b, high), (*a, high))


def _walls(x: float, y: float, high: float) -> list[Array]:
    corners = [(-x, -y), (x, -y), (x, y), (-x, y)]
    return [_riser(corners[i - 1], corners[i], 0.0, high) for i in (1, 2, 3, 0)]


def _among(draw: Draw, problem: Problem, count: int) -> Problem:
    """The same problem with obstacles on the table."""
    for number in range(count):
        found = _obstacle(draw, f"obstacle{number}", problem.ends, problem.manipulator)
        problem = problem.with_bodies(found)
    return problem


def _crowded(draw: Draw, problem: Problem, count: int) -> Problem:
    """The same problem with small cubes in the air, close to links of the arm where it stops."""
    m, cubes = problem.manipulator, []
    solved = [m.ik.solve(T) for T in problem.ends]
    ends = [problem.q_start, *(np.array(found.q) for found in solved if found.is_valid)]
    if problem.q_goal is not None:
        ends.append(problem.q_goal)
    for number in range(count):
        q = draw.one(ends)
        middle = _poses(m, q)[f"{m.arm.side}_{draw.one(CROWDED)}"][:3, 3]
        for _ in range(CROWDING_TRIES):
            out = draw.rng.normal(size=3)
            centre = middle + out / np.linalg.norm(out) * draw.within(0.08, 0.20)
            edge = draw.within(0.01, 0.04)
            T = _at(*centre.tolist(), draw.angle(1.0))
            cube = _body(f"cube{number}", Box((edge, edge, edge)), T)
            near_m = _arm_distance_m(m, cube, ends)
            if centre[2] > TABLE_Z_M + 0.15 and MIN_NEAR_M < near_m < MAX_NEAR_M:
                cubes.append(cube)
                break
    return problem.with_bodies(cubes)


def _poses(m: Manipulator, q: Array) -> dict[str, Array]:
    joints = dict(zip(m.robot.joint_names, m.q_others.tolist(), strict=True))
    return load_robot().poses(joints | dict(zip(m.arm.joint_names, q.tolist(), strict=True)))


def _arm_distance_m(m: Manipulator, body: Body, ends: list[Array]) -> float:
    """Smallest distance of the arm to a body in some configurations."""
    robot, tracks = load_robot(), Thing.of(body).tracks()
    return min(
        distance_m(solid, track.solid, inverse(track.T) @ T[link])
        for T in (_poses(m, q) for q in ends)
        for link in robot.below([m.arm.joint_names[0]])
        for solid in robot.solids[link]
        for track in tracks
    )


def _obstacle(draw: Draw, name: str, ends: Sequence[pin.SE3], m: Manipulator) -> list[Body]:
    """A box, cylinder or ball, some of them in the air; none near the ends."""
    side = 1.0 if m.arm.side == "left" else -1.0
    radius, height = draw.within(0.01, 0.04), draw.within(0.05, 0.30)
    x, y = draw.within(0.55, 0.85), side * draw.within(-0.12, 0.40)
    z = TABLE_Z_M + height / 2 + (draw.within(0.1, 0.4) if draw.happens(0.25) else 0.0)
    off = [math.hypot(*(end.translation[:2] - (x, y))) for end in ends]
    if min(off) < OBSTACLE_DISTANCE_M + radius:
        return []
    shapes = (Box((2 * radius, 1.5 * radius, height)), Cylinder(radius, height), Sphere(radius))
    shape = draw.one(shapes)
    if isinstance(shape, Sphere):
        z = draw.within(0.0, 0.3)
    return [_body(name, shape, _at(x, y, z, draw.angle()))]


# Tasks


def _transfer(
    draw: Draw,
    m: Manipulator,
    parts: list[Part],
    tip_height_m: float | None = None,
    *,
    highest_m: float = 0.004,
) -> Problem:
    """A body on the table, and another place and yaw for it."""
    (x, y), (to_x, to_y) = _places(draw, m)
    body = Body(BODY, tuple(parts), _at(x, y, 0.0, draw.angle()), is_movable=True)
    low, _ = body.extent_m((0.0, 0.0, 1.0))
    body = body.at(_at(0.0, 0.0, TABLE_Z_M - low) * body.T_base_body)
    T_pick = overhead_grasp(m.hand, body, yaw_rad=draw.angle(0.5))
    if tip_height_m is not None:
        p = np.array([*body.T_base_body.translation[:2], TABLE_Z_M + tip_height_m])
        T_pick = pin.SE3(T_pick.rotation, p)
    turn = draw.number(0.0, draw.angle(math.pi / 2))
    middle = T_pick.translation
    T_move = _at(to_x, to_y, 0.0, turn) * _at(-middle[0], -middle[1], 0.0)
    lift_m = draw.number(0.0, draw.within(0.0, highest_m))
    T_place = _at(0.0, 0.0, lift_m) * T_move * T_pick
    task = PickAndPlace(BODY, T_pick, T_place, hover_m=draw.within(0.08, 0.2))
    return Problem(m, Scene.of([_table(), body]), _start(draw, m), task)


def _places(draw: Draw, m: Manipulator) -> Array:
    """Two points on the table, some way apart."""
    side = 1.0 if m.arm.side == "left" else -1.0
    while True:
        x = draw.rng.uniform(0.60, 0.80, 2)
        places = np.stack([x, side * draw.rng.uniform(-0.02, 0.33, 2)], axis=1)
        if np.linalg.norm(places[1] - places[0]) > 0.13:
            return places


def _start(draw: Draw, m: Manipulator) -> Array:
    if draw.happens(0.5):
        return np.array(m.arm.start if m.arm.side == "left" else m.arm.neutral)
    return _hovering(draw, m, low=0.15, high=0.35)


def _hovering(draw: Draw, m: Manipulator, *, low: float, high: float) -> Array:
    """A configuration with the tip above the table, pointing down more or less."""
    side = 1.0 if m.arm.side == "left" else -1.0
    elbow, forearm = (f"{m.arm.side}_{link}" for link in ("lower_elbow", "lower_forearm"))
    while True:
        p = [draw.within(0.5, 0.85), side * draw.within(0.0, 0.45), draw.within(low, high)]
        tilt = pin.exp3(draw.rng.uniform(-0.5, 0.5, 3))
        R = tilt @ _at(0.0, 0.0, 0.0, draw.angle(1.0)).rotation @ np.diag([-1.0, 1, -1])
        found = m.ik.solve(pin.SE3(R, np.array(p)))
        if found.is_valid:
            T = _poses(m, np.array(found.q))
            points = np.linspace(T[elbow][:3, 3], T[forearm][:3, 3], 4)
            if np.linalg.norm(points - HEAD_M, axis=1).min() > HEAD_DISTANCE_M:
                return np.array(found.q)


def _body(name: str, shape: Any, T: pin.SE3, *, is_movable: bool = False) -> Body:
    return Body(name, (_part(shape),), T, is_movable=is_movable)


def _part(shape: Any, *, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Part:
    return Part(shape, _at(x, y, z))


def _at(x: float, y: float, z: float, yaw: float = 0.0) -> pin.SE3:
    c, s = math.cos(yaw), math.sin(yaw)
    return pin.SE3(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([x, y, z]))


@cache
def _table() -> Body:
    return load_object("table", _at(1.0, 0.0, -0.93))


@cache
def _manipulator(limb: str) -> Manipulator:
    return Manipulator.of(_robot(), limb)


@cache
def _robot() -> Baxter:
    return Baxter.load()
