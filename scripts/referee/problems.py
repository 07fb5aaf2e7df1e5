"""Random problems of ten families, each the same for the same seed and number.

Everything stands on the demo's table, or on meshes that do. Some problems have no solution, on
purpose.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

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
    Scene,
    Sphere,
    load_object,
    overhead_grasp,
)
from planner.scene.support import come_down
from referee.clearance import distance_m, inverse
from referee.solids import Array, hull_solid
from referee.stage import Thing
from referee.urdf import load_robot
from sim import World

TABLE_Z_M = -0.155
"""Height of the table's top, seen from base."""

WIDEST_OFF_M, NARROWEST_OFF_M = 0.007, 0.003
"""How much narrower than the open hand, and wider than the closed one, bodies are made."""

HEAD_M, HEAD_ROOM_M = np.array([0.11, 0.0, 0.75]), 0.40
"""Arms that stand somewhere at random keep off the head."""

ROOM_M = 0.09
"""From obstacles to the axes of pick and place."""

BODY = "body"

CROWDED = (
    "lower_elbow",
    "upper_forearm",
    "lower_forearm",
    "wrist",
    "lower_shoulder",
    "upper_elbow",
)
"""Links that small cubes are put close to."""

NEAREST_M, NEAR_M, CROWDING_TRIES = 0.008, 0.06, 8
"""How far these are from the arm where it stops, and how often that is tried."""


@dataclass(frozen=True, eq=False)
class Problem:
    """What is to be planned.

    Attributes:
        manipulator: the arm, and where everything else stands.
        scene: all bodies.
        q_start: where the arm stands, shape (7,).
        task: what goes where; None for a free move.
        q_goal: where a free move goes.
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


def make_problem(family: str, number: int, seed: int) -> Problem:
    """The problem of a family and number."""
    rng = np.random.default_rng([seed, list(FAMILIES).index(family), number])
    return FAMILIES[family](rng)


# Families


def _plain(rng: np.random.Generator) -> Problem:
    m = _manipulator(_limb(rng))
    return _transfer(rng, m, _block(rng, m))


def _obstacles(rng: np.random.Generator) -> Problem:
    problem = _among(rng, _plain(rng), int(rng.integers(1, 4)))
    return _crowded(rng, problem, int(rng.integers(1, 3)))


def _odd(rng: np.random.Generator) -> Problem:
    m = _manipulator(_limb(rng))
    makers = (_stem, _stem, _stem, _ell, _dumbbell, _cylinder, _ball, _prism)
    parts, tip_height_m = makers[int(rng.integers(len(makers)))](rng, m)
    return _transfer(rng, m, parts, tip_height_m)


def _bins(rng: np.random.Generator) -> Problem:
    problem = _plain(rng)
    assert problem.task is not None
    ends = (problem.task.T_base_pick, problem.task.T_base_place)
    chosen = [ends[:1], ends[1:], ends][int(rng.integers(3))]
    walls = [wall for i, T in enumerate(chosen) for wall in _bin(rng, f"bin{i}", T.translation[:2])]
    return evolve(problem, scene=_with(problem.scene, walls))


def _margins(rng: np.random.Generator) -> Problem:
    m = _manipulator(_limb(rng))
    problem = _transfer(rng, m, _block(rng, m, lowest=0.06), highest_m=0.0)
    assert problem.task is not None
    # fingers may come near the body only where the tip goes straight, so from above it
    task = evolve(problem.task, clear_m=0.13, hover_m=max(0.13, problem.task.hover_m))
    margin_m = float(rng.uniform(0.002, 0.020))
    problem = evolve(problem, task=task, margin_m=margin_m)
    return _among(rng, problem, int(rng.integers(0, 3)))


def _rods(rng: np.random.Generator) -> Problem:
    m = _manipulator(_limb(rng))
    width = float(rng.uniform(m.hand.closed_gap_m + 0.003, 0.03))
    parts = [_part(Box((width, width, float(rng.uniform(0.02, 0.05)))))]
    problem = _transfer(rng, m, parts)
    assert problem.task is not None
    ends = (problem.task.T_base_pick, problem.task.T_base_place)
    T = ends[int(rng.integers(2))]
    return evolve(problem, scene=_with(problem.scene, [_rod(rng, m, T, width)]))


def _other_hand(rng: np.random.Generator) -> Problem:
    limb = _limb(rng)
    other = "right" if limb == "left" else "left"
    base, holder = _manipulator(limb), _manipulator(other)
    problem = _among(rng, _transfer(rng, base, _block(rng, base)), int(rng.integers(0, 2)))
    world = World(base.robot)
    for body in problem.scene:
        world.spawn(body)
    width = float(rng.uniform(holder.hand.closed_gap_m + 0.004, 0.04))
    size = (width, width, float(rng.uniform(0.02, 0.12)))
    world.spawn(Body("held", (_part(Box(size)),), _at(0.9, 0.0, 0.5), is_movable=True))
    world.move_arm(other, _hovering(rng, holder, low=0.02, high=0.25))
    world.set_fingers(other, (width - holder.hand.closed_gap_m) / 2 + 2e-4)
    down_m = float(rng.uniform(0.0, size[2] / 2 - 0.008)) if size[2] > 0.05 else 0.0
    world.attach(other, "held", _at(0.0, 0.0, down_m))
    manipulator = evolve(base, q_others=world.q)
    held = tuple(found for found in [world.holding(other)] if found is not None)
    return evolve(problem, manipulator=manipulator, scene=world.scene, held=held)


def _free(rng: np.random.Generator) -> Problem:
    m = _manipulator(_limb(rng))
    start, goal = (_hovering(rng, m, low=-0.02, high=0.35) for _ in range(2))
    ends = [m.arm.T_base_tip(q).translation for q in (start, goal)]
    scene = Scene.of([_table()])
    for number in range(int(rng.integers(2, 6))):
        found = _obstacle(rng, f"obstacle{number}", ends, m)
        clear = [b for b in found if _arm_distance_m(m, b, [start, goal]) > NEAREST_M]
        scene = _with(scene, clear)
    margin = float(rng.uniform(0.002, 0.01)) if rng.random() < 0.3 else 0.0
    problem = Problem(m, scene, start, q_goal=goal, margin_m=margin)
    return _crowded(rng, problem, int(rng.integers(0, 3)))


def _several_parts(rng: np.random.Generator) -> Problem:
    """Parts that hang a little above what the body stands on, which is often in parts, too."""
    m = _manipulator(_limb(rng))
    maker = (_mug, _tee)[int(rng.integers(2))]
    problem = _transfer(rng, m, maker(rng, m), highest_m=0.001)
    assert problem.task is not None
    if rng.random() < 0.4:  # off the middle, so that a finger pushes the body along its support
        aside = _at(0.0, float(rng.uniform(-0.004, 0.004)), 0.0)
        ends = problem.task.T_base_pick * aside, problem.task.T_base_place * aside
        problem = evolve(
            problem, task=evolve(problem.task, T_base_pick=ends[0], T_base_place=ends[1])
        )
    if rng.random() < 0.5:
        problem = _on_a_step(rng, problem)
    if rng.random() < 0.3:
        problem = evolve(problem, margin_m=float(rng.uniform(0.0, 0.003)))
    return problem


def _on_meshes(rng: np.random.Generator) -> Problem:
    """A pick, a place or both on surfaces: bins, trays, stairs, plates off level or with holes."""
    problem = _plain(rng)
    assert problem.task is not None
    scene, task = problem.scene.without(BODY), problem.task
    ends = [task.T_base_pick.translation[:2], task.T_base_place.translation[:2]]
    chosen = ([0], [1], [0, 1])[int(rng.integers(3))]
    for i in chosen:
        scene = _with(scene, [_mesh_support(rng, f"support{i}", ends[i])])
    body = problem.scene[BODY]
    T_body_pick = body.T_base_body.inverse() * task.T_base_pick
    T_move = task.T_base_place * task.T_base_pick.inverse()
    lift_m = float(rng.choice([0.0, rng.uniform(0.0, 0.004)]))
    rested, placed = (
        come_down(each.at(_at(0.0, 0.0, 0.15) * each.T_base_body), list(scene)).body
        for each in (body, body.at(T_move * body.T_base_body))
    )
    T_pick = rested.T_base_body * T_body_pick
    T_place = _at(0.0, 0.0, lift_m) * placed.T_base_body * T_body_pick
    task = evolve(task, T_base_pick=T_pick, T_base_place=T_place)
    return evolve(problem, scene=scene.with_body(rested), task=task)


FAMILIES: dict[str, Callable[[np.random.Generator], Problem]] = {
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


# Bodies


def _block(rng: np.random.Generator, m: Manipulator, *, lowest: float = 0.02) -> list[Part]:
    x, y = _width(rng, m), float(rng.uniform(0.02, 0.09))
    return [_part(Box((x, y, float(rng.uniform(lowest, 0.10)))))]


def _stem(rng: np.random.Generator, m: Manipulator) -> tuple[list[Part], float]:
    """A stem with a crossbar above, wider than the stem, taken by the stem."""
    width, height = _width(rng, m, widest=0.025), float(rng.uniform(0.07, 0.12))
    across = rng.uniform(width, 0.055)
    along = across + rng.uniform(0.0, 0.02)  # longer, so that the hand comes across
    bar = Part(Box((float(along), float(across), 0.02)), _at(0.0, 0.0, height - 0.01))
    return [_part(Box((width, width, height)), z=height / 2), bar], float(rng.uniform(0.015, 0.03))


def _ell(rng: np.random.Generator, m: Manipulator) -> tuple[list[Part], float | None]:
    width, height = _width(rng, m, widest=0.035), float(rng.uniform(0.05, 0.12))
    length = float(rng.uniform(0.05, 0.12))
    along = bool(rng.integers(2))
    size = (length, width, 0.02) if along else (width, length, 0.02)
    foot = {"x" if along else "y": length / 2 - width / 2}
    parts = [_part(Box((width, width, height)), z=height / 2), _part(Box(size), z=0.01, **foot)]
    return parts, float(rng.uniform(0.03, height + 0.01))


def _cylinder(rng: np.random.Generator, m: Manipulator) -> tuple[list[Part], None]:
    return [_part(Cylinder(_width(rng, m) / 2, float(rng.uniform(0.02, 0.12))))], None


def _ball(rng: np.random.Generator, m: Manipulator) -> tuple[list[Part], None]:
    return [_part(Sphere(_width(rng, m, narrowest=0.02) / 2))], None


def _prism(rng: np.random.Generator, m: Manipulator) -> tuple[list[Part], None]:
    """A frustum of five to eight sides, as a mesh."""
    radius, height = _width(rng, m) / 2.1, float(rng.uniform(0.03, 0.10))
    sides, top = int(rng.integers(5, 9)), float(rng.uniform(0.7, 1.0))
    turn = 2 * math.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(sides)], axis=1) * [radius, radius, 0]
    points = np.concatenate([ring, ring * top + [0.0, 0.0, height]])
    return [_part(_convex_mesh(points))], None


def _gap(rng: np.random.Generator) -> float:
    """How far a part is above what another part of its body stands on; about nothing at times."""
    return float(rng.choice([0.0, rng.uniform(2e-4, 1e-3), rng.uniform(1e-3, 0.04)]))


def _mug(rng: np.random.Generator, m: Manipulator) -> list[Part]:
    """A cylinder with a handle on either side, turned by up to half a right angle."""
    radius, height, gap = (
        _width(rng, m, narrowest=0.03) / 2,
        float(rng.uniform(0.06, 0.1)),
        _gap(rng),
    )
    long, high = float(rng.uniform(0.015, 0.03)), float(rng.uniform(0.015, height - 0.042))
    turn = float(rng.choice([0.0, math.pi])) + float(rng.uniform(-math.pi / 4, math.pi / 4))
    place = _at(0.0, 0.0, 0.0, turn) * _at(radius + long / 2 - 0.002, 0.0, gap + high / 2)
    handle = Part(Box((long, float(rng.uniform(0.005, 0.012)), high)), place)
    return [_part(Cylinder(radius, height), z=height / 2), handle]


def _tee(rng: np.random.Generator, m: Manipulator) -> list[Part]:
    """A post with one or two blocks at its sides."""
    width, height = _width(rng, m), float(rng.uniform(0.06, 0.1))
    parts = [_part(Box((width, width, height)), z=height / 2)]
    for side in ((1.0,), (-1.0,), (1.0, -1.0))[int(rng.integers(3))]:
        gap, high, long = (
            _gap(rng),
            float(rng.uniform(0.01, height - 0.045)),
            float(rng.uniform(0.01, 0.03)),
        )
        beside = side * (width / 2 + long / 2)
        parts.append(_part(Box((long, min(width, 0.02), high)), x=beside, z=gap + high / 2))
    return parts


def _on_a_step(rng: np.random.Generator, problem: Problem) -> Problem:
    """The same problem with a body of two heights where its body goes, which it is put on."""
    assert problem.task is not None
    body, task = problem.scene[BODY], problem.task
    height, drop = float(rng.uniform(0.02, 0.06)), _gap(rng)
    low, wide = max(0.004, height - drop), float(rng.uniform(0.05, 0.09))
    parts = (
        _part(Box((wide, wide, height)), z=height / 2),
        _part(Box((0.05, wide, low)), x=wide / 2 + 0.025, z=low / 2),
    )
    T_place_body = task.T_base_place * task.T_base_pick.inverse() * body.T_base_body
    x, y = T_place_body.translation[:2]
    T_step = _at(float(x), float(y), TABLE_Z_M, float(rng.uniform(-math.pi, math.pi)))
    step = Body("step", parts, T_step, is_movable=bool(rng.integers(2)))
    raised = _at(0.0, 0.0, height) * task.T_base_place
    scene = _with(problem.scene, [step])
    return evolve(problem, scene=scene, task=evolve(task, T_base_place=raised))


def _dumbbell(rng: np.random.Generator, m: Manipulator) -> tuple[list[Part], float]:
    """A rod between two discs."""
    radius, height = _width(rng, m, widest=0.026) / 2, float(rng.uniform(0.08, 0.13))
    disc = Cylinder(float(rng.uniform(radius, 0.035)), 0.012)
    parts = [
        _part(Cylinder(radius, height), z=height / 2),
        _part(disc, z=0.006),
        _part(disc, z=height - 0.006),
    ]
    return parts, float(rng.uniform(0.03, height - 0.02))


def _rod(rng: np.random.Generator, m: Manipulator, T: pin.SE3, width_m: float) -> Body:
    """A post beside a finger: between its open and its closed pad, or just outside."""
    thick, height = rng.uniform(0.004, 0.010), float(rng.uniform(0.02, 0.07))
    open_m = m.hand.open_gap_m / 2
    inner, outer = width_m / 2 + thick / 2 + 0.001, open_m - thick / 2
    beside = rng.uniform(inner, outer)
    if rng.random() < 0.7:
        beside = open_m + rng.uniform(0.022, 0.045) + thick / 2
    side, across = rng.choice([-1.0, 1.0]), rng.uniform(-0.022, 0.022)
    shift = T.rotation @ np.array([across, side * beside, 0.0])
    x, y = T.translation[:2] + shift[:2]
    angle = math.atan2(T.rotation[1, 0], T.rotation[0, 0])
    shape = Box((float(rng.uniform(0.004, 0.012)), float(thick), height))
    if rng.random() < 0.4:
        shape = Cylinder(float(thick) / 2, height)
    T_rod = _at(float(x), float(y), TABLE_Z_M + height / 2, angle)
    return Body("rod", (_part(shape),), T_rod, is_movable=bool(rng.integers(2)))


def _bin(rng: np.random.Generator, name: str, centre: Array) -> list[Body]:
    """Four walls around a point, their turn at random."""
    x, y = rng.uniform(0.05, 0.12, size=2)
    height, angle = float(rng.uniform(0.02, 0.09)), float(rng.uniform(-math.pi, math.pi))
    T_bin = _at(*(centre + rng.uniform(-0.01, 0.01, size=2)), TABLE_Z_M + height / 2, angle)
    walls = []
    for number, (dx, dy) in enumerate(((1, 0), (-1, 0), (0, 1), (0, -1))):
        size = (0.008, 2 * y, height) if dx else (2 * x, 0.008, height)
        T = T_bin * _at(dx * (x + 0.004), dy * (y + 0.004), 0.0)
        walls.append(Body(f"{name}_wall{number}", (_part(Box(size)),), T))
    return walls


def _mesh_support(rng: np.random.Generator, name: str, centre: Array) -> Body:
    """A surface on the table, around a point or with it somewhere on its edge."""
    makers = (_bin_sheets, _tray_sheets, _stair_sheets, _plate_sheets, _grate_sheets)
    corners = np.concatenate(makers[int(rng.integers(len(makers)))](rng))
    vertices, numbers = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    off = rng.uniform(-0.02, 0.02, size=2)
    T = _at(*(centre + off).tolist(), TABLE_Z_M + 0.001, float(rng.uniform(-math.pi, math.pi)))
    return Body(name, (_part(Mesh(vertices, numbers.reshape(-1, 3))),), T)


def _bin_sheets(rng: np.random.Generator) -> list[Array]:
    """A floor and four walls without thickness."""
    x, y = rng.uniform(0.06, 0.12, size=2).tolist()
    return [_level((-x, x), (-y, y), 0.0), *_walls(x, y, 0.0, float(rng.uniform(0.01, 0.06)))]


def _tray_sheets(rng: np.random.Generator) -> list[Array]:
    """A floor, and around it a rim that is broad and higher."""
    (x, y), rim = rng.uniform(0.06, 0.12, size=2).tolist(), float(rng.uniform(0.002, 0.012))
    wide, found = 0.015, [_level((-x, x), (-y, y), 0.0), *_walls(x, y, 0.0, rim)]
    for sign in (-1.0, 1.0):
        found.append(_level((-x - wide, x + wide), (sign * y, sign * (y + wide)), rim))
        found.append(_level((sign * x, sign * (x + wide)), (-y, y), rim))
    return found


def _stair_sheets(rng: np.random.Generator) -> list[Array]:
    """Three steps with risers."""
    deep, high = float(rng.uniform(0.05, 0.10)), float(rng.uniform(0.002, 0.03))
    found = []
    for number in range(3):
        x, z = (number - 1.5) * deep, number * high
        found.append(_level((x, x + deep), (-0.08, 0.08), z))
        if number:
            found.append(
                _sheet((x, -0.08, z - high), (x, 0.08, z - high), (x, 0.08, z), (x, -0.08, z))
            )
    return found


def _plate_sheets(rng: np.random.Generator) -> list[Array]:
    """A plate off level, most by less than a degree, with a triangle that rises at its far edge."""
    reach, rise = 0.1, float(rng.uniform(0.0, 0.002))
    slope = math.radians(float(rng.choice([0.0, 1e-3, rng.uniform(0.0, 1.2)])))
    turn = pin.exp3(slope * _at(0.0, 0.0, 0.0, float(rng.uniform(-3.0, 3.0))).rotation[:, 0])
    plate = _level((-reach, reach), (-reach, reach), 0.0)
    flap = np.array([[[reach, -reach, 0.0], [reach, reach, 0.0], [reach + 0.1, 0.0, rise]]])
    return [np.concatenate([plate, flap]) @ turn.T + [0.0, 0.0, 0.004]]


def _grate_sheets(rng: np.random.Generator) -> list[Array]:
    """A plate with a hole, into which some bodies fall."""
    outer, hole, z = 0.1, float(rng.uniform(0.005, 0.06)), 0.004
    return [
        _level((-outer, outer), (-outer, -hole), z),
        _level((-outer, outer), (hole, outer), z),
        _level((-outer, -hole), (-hole, hole), z),
        _level((hole, outer), (-hole, hole), z),
    ]


def _sheet(*corners: tuple[float, float, float]) -> Array:
    """Two triangles between four corners, shape (2, 3, 3)."""
    a, b, c, d = np.array(corners)
    return np.array([[a, b, c], [a, c, d]])


def _level(xs: tuple[float, float], ys: tuple[float, float], z: float) -> Array:
    (x0, x1), (y0, y1) = sorted(xs), sorted(ys)
    return _sheet((x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z))


def _walls(x: float, y: float, low: float, high: float) -> list[Array]:
    corners = [(-x, -y), (x, -y), (x, y), (-x, y)]
    ends = zip(corners, corners[1:] + corners[:1], strict=True)
    return [_sheet((*a, low), (*b, low), (*b, high), (*a, high)) for a, b in ends]


def _among(rng: np.random.Generator, problem: Problem, count: int) -> Problem:
    """The same problem with obstacles on the table."""
    assert problem.task is not None
    ends = [T.translation for T in (problem.task.T_base_pick, problem.task.T_base_place)]
    scene = problem.scene
    for number in range(count):
        scene = _with(scene, _obstacle(rng, f"obstacle{number}", ends, problem.manipulator))
    return evolve(problem, scene=scene)


def _crowded(rng: np.random.Generator, problem: Problem, count: int) -> Problem:
    """The same problem with small cubes in the air, close to links of the arm where it stops."""
    m = problem.manipulator
    ends, cubes = _ends(problem), []
    for number in range(count):
        q = ends[int(rng.integers(len(ends)))]
        link = f"{m.arm.side}_{CROWDED[int(rng.integers(len(CROWDED)))]}"
        middle = _links_at(m, q)[link]
        for _ in range(CROWDING_TRIES):
            out = rng.normal(size=3)
            centre = middle + out / np.linalg.norm(out) * rng.uniform(0.08, 0.20)
            edge = float(rng.uniform(0.01, 0.04))
            T = _at(*centre.tolist(), float(rng.uniform(-1.0, 1.0)))
            cube = Body(f"cube{number}", (_part(Box((edge, edge, edge))),), T)
            near_m = _arm_distance_m(m, cube, ends)
            if centre[2] > TABLE_Z_M + 0.15 and NEAREST_M < near_m < NEAR_M:
                cubes.append(cube)
                break
    return evolve(problem, scene=_with(problem.scene, cubes))


def _ends(problem: Problem) -> list[Array]:
    """Where the arm stands or stops, one of the solutions where there are many."""
    ends = [problem.q_start] if problem.q_goal is None else [problem.q_start, problem.q_goal]
    if problem.task is not None:
        poses = problem.task.T_base_pick, problem.task.T_base_place
        found = [problem.manipulator.ik.solve(T) for T in poses]
        ends += [np.array(ik.q) for ik in found if ik.is_valid]
    return ends


def _links_at(m: Manipulator, q: Array) -> dict[str, Array]:
    """The origin of each link, shape (3,)."""
    return {link: T[:3, 3] for link, T in _poses(m, q).items()}


def _poses(m: Manipulator, q: Array) -> dict[str, Array]:
    joints = dict(zip(m.robot.joint_names, m.q_others.tolist(), strict=True))
    return load_robot().poses(joints | dict(zip(m.arm.joint_names, q.tolist(), strict=True)))


def _arm_distance_m(m: Manipulator, body: Body, ends: list[Array]) -> float:
    """How near the arm is to a body at any of some configurations."""
    robot, tracks = load_robot(), Thing.of(body).tracks()
    moving = robot.below({m.arm.joint_names[0]})
    return min(
        distance_m(solid, track.solid, inverse(track.T) @ T[link])
        for T in (_poses(m, q) for q in ends)
        for link in moving
        for solid in robot.solids[link]
        for track in tracks
    )


def _obstacle(rng: np.random.Generator, name: str, ends: list[Array], m: Manipulator) -> list[Body]:
    """A box, cylinder or ball, some of them in the air; none near the ends."""
    side = 1.0 if m.arm.side == "left" else -1.0
    radius, height = float(rng.uniform(0.01, 0.04)), float(rng.uniform(0.05, 0.30))
    x, y = rng.uniform(0.55, 0.85), side * rng.uniform(-0.12, 0.40)
    z = TABLE_Z_M + height / 2 + (float(rng.uniform(0.1, 0.4)) if rng.random() < 0.25 else 0.0)
    if any(math.hypot(x - end[0], y - end[1]) < ROOM_M + radius for end in ends):
        return []
    shapes = (Box((2 * radius, 1.5 * radius, height)), Cylinder(radius, height), Sphere(radius))
    shape = shapes[int(rng.integers(3))]
    if isinstance(shape, Sphere):
        z = float(rng.uniform(0.0, 0.3))
    T = _at(float(x), float(y), z, float(rng.uniform(-math.pi, math.pi)))
    return [Body(name, (_part(shape),), T)]


# Tasks


def _transfer(
    rng: np.random.Generator,
    m: Manipulator,
    parts: list[Part],
    tip_height_m: float | None = None,
    *,
    highest_m: float = 0.004,
) -> Problem:
    """A body on the table, and another place and yaw for it."""
    (x, y), (to_x, to_y) = _places(rng, m)
    yaw = float(rng.uniform(-math.pi, math.pi))
    body = _standing(Body(BODY, tuple(parts), _at(x, y, 0.0, yaw), is_movable=True))
    T_pick = overhead_grasp(m.hand, body, yaw_rad=float(rng.uniform(-0.5, 0.5)))
    if tip_height_m is not None:
        p = np.array([*body.T_base_body.translation[:2], TABLE_Z_M + tip_height_m])
        T_pick = pin.SE3(T_pick.rotation, p)
    turn = float(rng.choice([0.0, rng.uniform(-math.pi / 2, math.pi / 2)]))
    middle = T_pick.translation
    T_move = _at(to_x, to_y, 0.0, turn) * _at(-middle[0], -middle[1], 0.0)
    lift_m = float(rng.choice([0.0, rng.uniform(0.0, highest_m)]))
    T_place = _at(0.0, 0.0, lift_m) * T_move * T_pick
    task = PickAndPlace(BODY, T_pick, T_place, hover_m=float(rng.uniform(0.08, 0.2)))
    return Problem(m, Scene.of([_table(), body]), _start(rng, m), task)


def _places(rng: np.random.Generator, m: Manipulator) -> Array:
    """Two points on the table, some way apart."""
    side = 1.0 if m.arm.side == "left" else -1.0
    while True:
        places = np.stack([rng.uniform(0.60, 0.80, 2), side * rng.uniform(-0.02, 0.33, 2)], axis=1)
        if np.linalg.norm(places[1] - places[0]) > 0.13:
            return places


def _standing(body: Body) -> Body:
    """The body raised or lowered until it stands on the table."""
    low, _ = body.extent_m((0.0, 0.0, 1.0))
    return body.at(_at(0.0, 0.0, TABLE_Z_M - low) * body.T_base_body)


def _start(rng: np.random.Generator, m: Manipulator) -> Array:
    if rng.random() < 0.5:
        return np.array(m.arm.start if m.arm.side == "left" else m.arm.neutral)
    return _hovering(rng, m, low=0.15, high=0.35)


def _hovering(rng: np.random.Generator, m: Manipulator, *, low: float, high: float) -> Array:
    """A configuration with the tip above the table, pointing down more or less."""
    side = 1.0 if m.arm.side == "left" else -1.0
    while True:
        p = np.array(
            [rng.uniform(0.5, 0.85), side * rng.uniform(0.0, 0.45), rng.uniform(low, high)]
        )
        tilt = pin.exp3(rng.uniform(-0.5, 0.5, 3))
        R = (
            tilt
            @ _at(0.0, 0.0, 0.0, float(rng.uniform(-1.0, 1.0))).rotation
            @ np.diag([-1.0, 1, -1])
        )
        found = m.ik.solve(pin.SE3(R, p))
        if found.is_valid and _is_off_the_head(m, np.array(found.q)):
            return np.array(found.q)


def _is_off_the_head(m: Manipulator, q: Array) -> bool:
    origins = _links_at(m, q)
    elbow, forearm = (origins[f"{m.arm.side}_{link}"] for link in ("lower_elbow", "lower_forearm"))
    points = np.linspace(elbow, forearm, 4)
    return bool(np.linalg.norm(points - HEAD_M, axis=1).min() > HEAD_ROOM_M)


def _limb(rng: np.random.Generator) -> str:
    return "left" if rng.random() < 0.7 else "right"


def _width(
    rng: np.random.Generator, m: Manipulator, *, narrowest: float = 0.0, widest: float = 1.0
) -> float:
    low = max(m.hand.closed_gap_m + NARROWEST_OFF_M, narrowest)
    return float(rng.uniform(low, max(low, min(m.hand.open_gap_m - WIDEST_OFF_M, widest))))


def _part(
    shape: Box | Cylinder | Sphere | Mesh, *, x: float = 0.0, y: float = 0.0, z: float = 0.0
) -> Part:
    return Part(shape, _at(x, y, z))


def _convex_mesh(points: Array) -> Mesh:
    """Its triangles counter-clockwise seen from outside."""
    hull = hull_solid("mesh", points)
    corners = hull.vertices[hull.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outwards = np.einsum("ij,ij->i", normals, corners.mean(axis=1) - hull.centre) > 0
    faces = np.where(outwards[:, None], hull.faces, hull.faces[:, ::-1])
    return Mesh(hull.vertices, faces)


def _with(scene: Scene, bodies: list[Body]) -> Scene:
    for body in bodies:
        scene = scene.with_body(body)
    return scene


def _at(x: float, y: float, z: float, yaw: float = 0.0) -> pin.SE3:
    c, s = math.cos(yaw), math.sin(yaw)
    return pin.SE3(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([x, y, z]))


@cache
def _table() -> Body:
    return load_object("table", _at(1.0, 0.0, -0.93))


@cache
def _robot() -> Baxter:
    return Baxter.load()


@cache
def _manipulator(limb: str) -> Manipulator:
    return Manipulator.of(_robot(), limb)
