"""Rules on bodies that touch: pads that hold, supports, sliding in contact, and falling."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from planner.certificate.errors import require
from planner.certificate.intervals import Pose, norm_bound
from planner.certificate.motion import Polynomials
from planner.certificate.robot import ARM_JOINTS
from planner.certificate.timeline.bodies import PRESS_M, Bodies, Situation
from planner.certificate.timeline.tip import chord_errors

TOUCH_M = 1e-5
"""Shapes within this distance touch."""

HELD_M = 1e-3
"""Maximum distance of a pad at first from what its hand holds: grippers measure no better."""

SLIDE_M = 1e-3
"""Maximum sideways motion of a held body while it touches its support."""

SLIDE_CELLS = 128
"""Into how many cells that motion is cut."""

DROP_M = 0.01
"""Maximum height from which a body may be let go."""


def distance_m(
    bodies: Bodies, name: str, T: Pose, other: str, T_other: Pose, *, enough_m: float
) -> float:
    """An upper bound on the distance of two bodies in base; none below `enough_m` is sought."""
    roots = [bodies.mover(*each, 0).root for each in ((name, T), (other, T_other))]
    return bodies.distances.bound_m(roots[0], roots[1], np.zeros(3), enough_m)


def require_support(
    bodies: Bodies, label: str, name: str, T: Pose, other: str, *, at: Mapping[str, Pose]
) -> None:
    """Refuse a contact of a body that is taken or put down with a body that it does not touch."""
    require(other in at, f"{label}: no contact of {other}")
    enough_m = 2.0 * PRESS_M
    is_near = distance_m(bodies, name, T, other, at[other], enough_m=enough_m) <= enough_m
    require(is_near, f"{label}: {name} does not stand on {other}")


def pad_gaps_m(
    bodies: Bodies,
    label: str,
    name: str,
    T_joint_body: Pose,
    opening_m: float,
    *,
    fingers: Iterable[str],
    within_m: float = TOUCH_M,
) -> dict[str, float]:
    """Upper bounds on the distance of each finger's pads from a body, m, by finger.

    Args:
        bodies: all trees.
        label: of the step, for messages.
        name: the body.
        T_joint_body: its pose seen from the last joint.
        opening_m: how far the fingers are open.
        fingers: the fingers that must touch it.
        within_m: maximum distance.

    Raises:
        NotCertifiedError: when a finger is farther away.
    """
    body, gaps_m = bodies.mover(name, T_joint_body, ARM_JOINTS), {}
    bound_m = bodies.distances.bound_m
    for finger in fingers:
        shift = np.array([0.0, bodies.robot.fingers[finger] * opening_m, 0.0])
        pads = (bound_m(pad, body.root, shift, within_m) for pad in bodies.pads[finger])
        gaps_m[finger] = away_m = min(pads, default=np.inf)
        require(away_m <= within_m, f"{label}: {finger} is {1e3 * away_m:.3f} mm from {name}")
    return gaps_m


def slide_m(
    bodies: Bodies, motion: Polynomials, window_s: tuple[float, float], held: tuple[str, Pose]
) -> float:
    """Maximum sideways motion of a held body in a window of time, m.

    Raises:
        NotCertifiedError: when it is above `SLIDE_M`.
    """
    times_s = np.linspace(*window_s, SLIDE_CELLS + 1)
    T = bodies.robot.tips(motion.at(times_s))
    (p, error_p), (R, error_R) = T.p.centred(), T.R.centred()
    bend_m, bend = chord_errors(bodies.robot, motion, times_s)
    reach_m = float(norm_bound(held[1].p.magnitude)) + max(
        shape.reach_m + float(norm_bound(T.p.magnitude)) for shape, T in bodies.scene[held[0]].parts
    )
    turned = float(norm_bound((R - R[0]).reshape(-1, 9)).max()) + 18.0 * error_R + bend
    moved = float(norm_bound(np.ptp(p[:, :2], axis=0))) + 4.0 * error_p + 2.0 * bend_m
    found_m = moved + 2.0 * turned * reach_m
    require(found_m <= SLIDE_M, f"{motion.label}: it slides {1e3 * found_m:.3f} mm in contact")
    return found_m


def fall_m(bodies: Bodies, label: str, name: str, T: Pose, now: Situation) -> float:
    """How far a body falls in a situation until it touches something, to `TOUCH_M`.

    Raises:
        NotCertifiedError: when it falls farther than `DROP_M`.
    """
    body, falls = bodies.mover(name, T, 0), []
    for other, T_other in (*now.at.items(), *now.others.items()):
        below, fallen_m = bodies.mover(other, T_other, 0), 0.0
        while fallen_m <= DROP_M:
            shift = np.array([0.0, 0.0, -fallen_m])
            away_m = bodies.distances.bound_m(body.root, below.root, shift, TOUCH_M)
            if away_m <= TOUCH_M:
                falls.append(fallen_m)
                break
            fallen_m += max(away_m - 0.5 * TOUCH_M, 0.5 * TOUCH_M)
    require(len(falls) > 0, f"{label}: {name} would fall farther than {1e3 * DROP_M:g} mm")
    return min(falls)
