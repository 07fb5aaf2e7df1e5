"""Which pairs must keep apart in each step, and by how much."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from planner.certificate.clusters import Shape
from planner.certificate.intervals import Array, Pose
from planner.certificate.robot import ARM_JOINTS, BASE
from planner.certificate.rows import Kinematics, Mover, Pair, Step
from planner.certificate.timeline.bodies import PRESS_M, Bodies, Situation

NEIGHBOURS = 2
"""Links with this many movable joints between them must not touch, but keep no margin, as the robot
is built so; links with fewer are mounted on each other and are not compared."""


def resting_pairs(bodies: Bodies, now: Situation, hands: Mapping[str, str]) -> Iterator[Pair]:
    """Everything that the arm does not move, and what its hand holds, at one instant.

    What is fixed may meet the fixed base, as a floor around its foot does: neither ever moves. No
    body is inside a link at this instant; later it could get there only through the surface.

    Args:
        bodies: all trees.
        now: the situation before the first step.
        hands: for each body in another hand, the link that it hangs on.
    """
    seen = _frames(bodies, now.arm[0])
    yield from _pairs_of_links(bodies)
    for name, T in now.at.items():
        body, is_fixed = bodies.mover(name, T, 0), not bodies.scene[name].is_movable
        yield from standing_pairs(bodies, body, with_base=not is_fixed)
        for key in bodies.insides:
            if not (is_fixed and key == BASE):
                yield _outside(bodies, key, name, T, 0, seen=seen)
    for name, link in hands.items():
        yield from _pairs_in_other_hand(bodies, now, name, link, seen)
    if now.held is not None:
        name, T = now.held
        body = bodies.mover(name, T, ARM_JOINTS)
        for key, inside in bodies.insides.items():
            if inside.level < ARM_JOINTS:
                yield _outside(bodies, key, name, T, ARM_JOINTS, seen=seen)
        fingers = [bodies.finger(f, now.opening_m, now.opening_m) for f in bodies.fingers]
        yield from _gripped_pairs(bodies, body, fingers)


def _pairs_of_links(bodies: Bodies) -> Iterator[Pair]:
    """The links that the arm does not move, with each other."""
    rest = list(bodies.rest.items())
    for number, (carrier, one) in enumerate(rest):
        for other_carrier, other in rest[:number]:
            is_one_hand = {carrier, other_carrier} <= bodies.robot.sliding  # or of two, far apart
            joints = bodies.robot.joints_between(carrier, other_carrier)
            if joints > NEIGHBOURS or (joints == NEIGHBOURS and not is_one_hand):
                yield _pair(one, other, 0.0, counts=joints > NEIGHBOURS)


def _pairs_in_other_hand(
    bodies: Bodies, now: Situation, name: str, link: str, seen: tuple[Array, Array]
) -> Iterator[Pair]:
    """A body that hangs on a link of another hand, with links and bodies that stand."""
    held, T = bodies.mover(name, now.others[name], 0), now.others[name]
    hand = bodies.robot.carrier(link)
    for carrier, mover in bodies.rest.items():
        if bodies.robot.joints_between(carrier, hand) > 1:
            yield _pair(held, mover, 0.0)
    for key in bodies.insides:
        if isinstance(key, int) or bodies.robot.joints_between(key, hand) > 1:
            yield _outside(bodies, key, name, T, 0, seen=seen)
    for other, T_other in now.at.items():
        yield _pair(held, bodies.mover(other, T_other, 0), 0.0)


def standing_pairs(bodies: Bodies, body: Mover, *, with_base: bool = True) -> Iterator[Pair]:
    """A body that stands, with all links that the arm does not move."""
    for carrier, mover in bodies.rest.items():
        if with_base or carrier != BASE:
            yield _pair(body, mover, 0.0)


def moving_pairs(
    bodies: Bodies,
    now: Situation,
    near: set[str],
    contacts: Mapping[str, tuple[float, float]],
    *,
    margin_m: float,
    end_s: float,
) -> Iterator[Pair]:
    """Everything that moves with the arm, with everything else.

    Args:
        bodies: all trees.
        now: the situation before the move.
        near: bodies that the hand may come near and its fingers may touch.
        contacts: from when to when the held body may touch which other body.
        margin_m: what counted pairs must keep.
        end_s: duration of the move.
    """
    solids, others = bodies.around(now)
    for k, arm in bodies.arm.items():
        yield from _link_pairs(bodies, arm, k, margin_m, end_s)
        for name, solid in solids.items():
            is_palm = k == ARM_JOINTS and name in near
            yield _pair(arm, solid, 0.0 if is_palm else margin_m, end_s, counts=not is_palm)
        yield from (_pair(arm, other, margin_m, end_s) for other in others)
    for name in bodies.fingers:
        finger = bodies.finger(name, now.opening_m, now.opening_m)
        yield from _link_pairs(bodies, finger, ARM_JOINTS + 1, margin_m, end_s)
        for of, solid in solids.items():
            least_m = -PRESS_M if of in near else margin_m
            yield _pair(finger, solid, least_m, end_s, counts=of not in near)
        yield from (_pair(finger, other, margin_m, end_s) for other in others)
    if now.held is not None:
        body = bodies.mover(*now.held, ARM_JOINTS)
        around = solids, others
        yield from _held_pairs(bodies, body, around, contacts, margin_m=margin_m, end_s=end_s)


def finger_pairs(
    bodies: Bodies,
    now: Situation,
    way_m: tuple[float, float],
    between: tuple[str, Pose, float, float] | None,
    contacts: Mapping[str, tuple[float, float]],
    *,
    margin_m: float,
) -> Iterator[Pair]:
    """Fingers that travel evenly, and a body between them that is pushed evenly.

    Args:
        bodies: all trees.
        now: the situation before, without the body between the fingers.
        way_m: opening of the fingers at the start and at the end.
        between: the body between the fingers, its pose seen from the last joint, and how far it is
            pushed along y at the start and at the end; None for none.
        contacts: the bodies that the pushed body may touch, as in `moving_pairs`.
        margin_m: what counted pairs must keep.
    """
    fingers = [bodies.finger(name, *way_m) for name in bodies.fingers]
    solids, others = bodies.around(now)
    for finger in fingers:
        yield from _link_pairs(bodies, finger, ARM_JOINTS + 1, margin_m, 1.0)
        yield from (_pair(finger, each, margin_m) for each in (*solids.values(), *others))
    if between is not None:
        name, T, begin_m, end_m = between
        skew_m = bodies.robot.skew * abs(end_m - begin_m)
        body = bodies.mover(name, T, ARM_JOINTS, (begin_m, end_m), skew_m)
        yield from _gripped_pairs(bodies, body, fingers)
        if end_m != begin_m:
            around, throughout = (solids, others), dict.fromkeys(contacts, (0.0, 1.0))
            yield from _held_pairs(bodies, body, around, throughout, margin_m=margin_m, end_s=1.0)


def _pair(
    first: Mover, second: Mover, least_m: float, end_s: float = 1.0, *, counts: bool = True
) -> Pair:
    """A pair over a whole step."""
    return Pair(first, second, least_m, 0.0, end_s, is_counted=counts)


def _link_pairs(
    bodies: Bodies, mover: Mover, level: int, least_m: float, end_s: float
) -> Iterator[Pair]:
    """A link that the arm moves, with other links; fingers count as level 8."""
    robot = bodies.robot
    link = mover.name if level > ARM_JOINTS else robot.chain[level - 1]
    others = [(robot.joints_between(link, carrier), rest) for carrier, rest in bodies.rest.items()]
    others += [(level - m, arm) for m, arm in bodies.arm.items()]
    for joints, other in others:
        if joints > NEIGHBOURS:
            yield _pair(mover, other, least_m, end_s)
        elif joints == NEIGHBOURS:
            yield _pair(mover, other, 0.0, end_s, counts=False)


def _gripped_pairs(bodies: Bodies, body: Mover, fingers: Sequence[Mover]) -> Iterator[Pair]:
    """A body between the fingers, with these and with the palm, all carried by one joint."""
    yield from (_pair(finger, body, -PRESS_M, counts=False) for finger in fingers)
    palm = bodies.arm.get(ARM_JOINTS)
    if palm is not None:
        yield _pair(body, palm, 0.0, counts=False)


def _held_pairs(
    bodies: Bodies,
    body: Mover,
    around: tuple[Mapping[str, Mover], Sequence[Mover]],
    contacts: Mapping[str, tuple[float, float]],
    *,
    margin_m: float,
    end_s: float,
) -> Iterator[Pair]:
    """A body that the hand moves, with everything but the hand.

    Args:
        bodies: all trees.
        body: the body.
        around: the bodies that stand, by name, and those in the other hand.
        contacts: from when to when it may touch which of these.
        margin_m: what counted pairs must keep.
        end_s: duration of the step.
    """
    solids, others = around
    for rest in bodies.rest.values():
        yield _pair(body, rest, margin_m, end_s)
    for m, arm in bodies.arm.items():
        if m < ARM_JOINTS:
            yield _pair(body, arm, margin_m, end_s)
    for other in others:
        yield _pair(body, other, margin_m, end_s)
    for name, solid in solids.items():
        if name not in contacts:
            yield _pair(body, solid, margin_m, end_s)
            continue
        begin_s, until_s = contacts[name]
        contact = Pair(body, solid, -PRESS_M, begin_s, until_s, is_counted=False)
        yield contact
        if begin_s > 0.0:
            yield replace(contact, least_m=0.0, begin_s=0.0, end_s=begin_s)
        if until_s < end_s:
            yield replace(contact, least_m=0.0, begin_s=until_s, end_s=end_s)


def _outside(
    bodies: Bodies, link: int | str, name: str, T: Pose, level: int, *, seen: tuple[Array, Array]
) -> Pair:
    """The pair that shows that a body is not inside a link, given that it does not touch it.

    A convex part is outside if one of its points is; the one farthest from the link is taken.
    """
    solid, roots = bodies.insides[link], []
    R, p = seen
    middle = bodies.clusters.middles(np.array([solid.root]))[0]
    middle = R[solid.level] @ middle + p[solid.level]
    for shape, placed in bodies.scene[name].parts:
        own = T * placed
        points = shape.points_of(0)
        at = points @ own.R.centred()[0].T + own.p.centred()[0]
        away = np.linalg.norm(at @ R[level].T + p[level] - middle, axis=1)
        farthest = Shape.of_points(points[[int(away.argmax())]])
        roots.append(bodies.clusters.add(farthest if shape.size == 1 else shape, own))
    body = Mover(name, bodies.clusters.joined(roots), level)
    first, second = (solid, body) if solid.level >= level else (body, solid)
    return _pair(first, second, 0.0, counts=False)


def _frames(bodies: Bodies, q: Array) -> tuple[Array, Array]:
    """Rotations and translations of the arm's joints in base, in doubles; only a choice."""
    still, levels = Step("", (), None, q), np.arange(ARM_JOINTS + 1)
    wanted = {(0, k) for k in range(1, ARM_JOINTS + 1)}
    seen = Kinematics(bodies.robot, still, np.zeros(1), wanted)
    return seen.at(0 * levels, levels, np.zeros(len(levels)))
