"""Objectives, and the best configuration of a pose on its self-motion curves.

An objective assigns a cost to every configuration; less is better. `best_on` searches a whole
curve, not the neighbourhood of a start, so its result is the best of the connected piece; `best_of`
searches several curves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np

from baxter_kin.display import quoted
from baxter_kin.errors import ConfigurationError, RequestError
from baxter_kin.fields import array, frozen
from baxter_kin.ik.self_motion.continuation import minimum
from baxter_kin.ik.self_motion.tracing import SelfMotion
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray, expect, finite_array, member_of

PRECISION_RAD = 1e-9
"""Precision of the best arc length; a smooth minimum cannot be located better than to the root of
the machine precision."""


class Scope(str, Enum):
    """The solutions among which an objective chooses."""

    ALL = "all"
    """All solutions of the pose, also those that the arm reaches only by moving its tip away."""
    CURVE = "curve"
    """The connected curve through the first solution: the arm can move from that one to the best
    without moving the tip."""

    @classmethod
    def of(cls, scope: str | Scope) -> Scope:
        """The scope with a name; an `UnknownNameError` if there is none."""
        return member_of(cls, "scope", scope)


class Objective(Protocol):
    """Compares configurations of a pose."""

    def costs(self, arm: Arm, q: FloatArray) -> FloatArray:
        """The cost of each of n configurations; less is better.

        Args:
            arm: the arm.
            q: its configurations, shape (n, 7), rad.

        Returns:
            Shape (n,), finite, continuous in `q`.
        """


@frozen(error=ConfigurationError)
class NearestTo:
    """Nearest to a seed in joint space.

    Cost: `1/2 |q - q_seed|^2`, in rad^2: the smallest joint motion from a configuration (Whitney,
    "Resolved motion rate control of manipulators and human prostheses", 1969, for velocities).

    Attributes:
        q_seed: shape (7,), rad; inside the limits or not.
    """

    q_seed: FloatArray = array(7)

    def costs(self, arm: Arm, q: FloatArray) -> FloatArray:  # noqa: ARG002 - the same for every arm
        """Half the squared distance to the seed, shape (n,), rad^2."""
        rows = finite_array(q, (None, 7), "q", ConfigurationError)
        squares = np.square(rows - self.q_seed)
        return np.array(0.5 * squares.sum(axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class SmallestStep:
    """Nearest to the current joints in the greatest difference of a single joint, rad.

    Its minima are sharp: there, two joints differ by the same amount, of which one grows on either
    side. Golden section needs no derivatives, and locates them as well as smooth ones.

    Attributes:
        q: the current joints, shape (7,), rad.
    """

    q: FloatArray

    def costs(self, arm: Arm, q: FloatArray) -> FloatArray:  # noqa: ARG002 - the same for every arm
        """The greatest difference of a single joint, shape (n,), rad."""
        steps: FloatArray = np.abs(q - self.q).max(axis=1)
        return steps


@dataclass(frozen=True, slots=True)
class FarthestFromLimits:
    """Farthest from the joint limits: the joint closest to a limit is as far from it as possible.

    Cost: `-min_i min(q_i - q_min_i, q_max_i - q_i) / (1/2 (q_max_i - q_min_i))`; -1 with all
    joints in the middle of their ranges, 0 with one on its limit. The maximum norm of Liegeois'
    (1977) distance from mid-range.
    """

    def costs(self, arm: Arm, q: FloatArray) -> FloatArray:
        """Minus the smallest distance to a limit, as a share of the half range, shape (n,)."""
        limits = expect(arm, Arm, "arm", RequestError).limits
        q_min, q_max = limits.q_min, limits.q_max
        q = finite_array(q, (None, 7), "q", ConfigurationError)
        shares = np.minimum(q - q_min, q_max - q) / (0.5 * (q_max - q_min))
        return np.array(-shares.min(axis=1))


@dataclass(frozen=True, slots=True)
class MostManipulable:
    """Most manipulable: farthest from singularities, in the measure of Yoshikawa.

    Cost: `-sqrt(det(J J'))`, J the tip's Jacobian in m and rad (Yoshikawa, "Manipulability of
    robotic mechanisms", 1985).
    """

    def costs(self, arm: Arm, q: FloatArray) -> FloatArray:
        """Minus the manipulability, shape (n,)."""
        expect(arm, Arm, "arm", RequestError)
        rows = finite_array(q, (None, 7), "q", ConfigurationError)
        J = np.array([arm.jacobian(one) for one in rows]).reshape(-1, 6, 7)
        singular_values = np.linalg.svd(J, compute_uv=False)  # det(J J') would lose half the digits
        return np.array(-singular_values.prod(axis=1))


def best_on(curve: SelfMotion, objective: Objective) -> FloatArray:
    """The best configuration of a whole curve, shape (7,), rad, inside the limits.

    Every minimum between neighbouring points that may be the lowest is located to `PRECISION_RAD`
    by golden section, on exact configurations (Kiefer, 1953). The lowest is found if the cost has
    at most one minimum between neighbours: trace with a smaller step for an objective that is
    rougher than those of this module.
    """
    return best_of([expect(curve, SelfMotion, "curve", RequestError)], objective)


def best_of(curves: Sequence[SelfMotion], objective: Objective) -> FloatArray:
    """The best configuration of one or more curves of an arm; as `best_on`."""
    _checked_objective(objective)
    arm, sizes = curves[0].arm, [len(curve.q) for curve in curves]
    costs = _checked_costs(objective, arm, np.concatenate([curve.q for curve in curves]))
    parts = np.split(costs, np.cumsum(sizes)[:-1])
    best = min(range(len(curves)), key=lambda i: parts[i].min())
    candidates = [(float(costs.min()), best, float(curves[best].s[np.argmin(parts[best])]))]
    for i, (curve, part) in enumerate(zip(curves, parts, strict=True)):
        for bracket in _brackets(curve, part, float(costs.min())):
            cost, s = minimum(_along(curve, objective), *bracket, PRECISION_RAD)
            candidates.append((cost, i, s))
    _, i, s = min(candidates)
    return curves[i].at(s)


def _along(curve: SelfMotion, objective: Objective) -> Callable[[float], float]:
    """The cost as a function of the length along the curve."""
    at = curve.sampler()

    def cost(s: float) -> float:
        return float(_checked_costs(objective, curve.arm, at(s)[None])[0])

    return cost


def checked_scope(objective: object, scope: str | Scope | None) -> Scope:
    """The scope of an objective, by default all solutions."""
    if objective is not None:
        _checked_objective(objective)
    elif scope is not None:
        raise RequestError(
            "scope selects the solutions among which an objective chooses; give an objective too"
        )
    return Scope.ALL if scope is None else Scope.of(scope)


def _checked_objective(objective: object) -> None:
    """Refuse an object without costs."""
    if isinstance(objective, type) or not callable(getattr(objective, "costs", None)):
        raise RequestError(
            "objective must be an object with a method costs(arm, q), such as FarthestFromLimits() "
            f"or NearestTo(q_seed), got {quoted(objective)}"
        )


def _checked_costs(objective: Objective, arm: Arm, q: FloatArray) -> FloatArray:
    what = f"costs of {type(objective).__name__}"
    return finite_array(objective.costs(arm, q), (len(q),), what, RequestError)


def _brackets(curve: SelfMotion, costs: FloatArray, lowest: float) -> list[tuple[float, float]]:
    """Intervals of arc length with a minimum that may be below the lowest known cost."""
    s = curve.s
    if len(s) < 2:
        return []
    if curve.is_closed:
        costs = np.concatenate([costs[-2:-1], costs, costs[1:2]])
        s = np.concatenate([s[-2:-1] - s[-1], s, s[1:2] + s[-1]])
    padded = np.concatenate([costs[:1], costs, costs[-1:]])
    before, after = padded[:-2] - costs, padded[2:] - costs
    promising = (before >= 0.0) & (after >= 0.0)
    promising &= costs - np.maximum(before, after) <= lowest
    last = len(s) - 1
    places = [int(i) for i in np.flatnonzero(promising)]
    return [(float(s[max(i - 1, 0)]), float(s[min(i + 1, last)])) for i in places]
