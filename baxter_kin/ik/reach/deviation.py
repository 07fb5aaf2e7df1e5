"""Bounds on the deviation of an arm from its linkage near given joint angles.

Seen from a frame that turns with s0, the wrist of the arm minus that of its linkage, at the same
angles, is a sum over the links i = 1 .. 6, where link i joins the axes of joints i - 1 and i:

```
D = sum_i P_i (dR_i w_i + dp_i)
```

P_i is the rotation of the arm up to link i, w_i the wrist of the linkage seen from the end of its
link, dR_i and dp_i are rotation and lengths of the arm's link minus those of the linkage's:
|dR_i w| <= c_i |w|, with c_i the difference of the twists. Turning joint k rotates the sum of the
terms i > k, and moves w_i of the others with a lever of at most l_k, the distance of the wrist from
the joint's axis. The same holds for any second joint before it, so that the first and second
derivatives of D are at most

```
G_k = sum_{i > k} (c_i |w_i| + |dp_i|) + sum_{i <= k} c_i l_k          k the later of the joints
```

The arm's hand is that of the linkage turned by E. Turning joint k turns E at the rate
w_k = z_k - E z'_k, with z and z' the axis in arm and linkage; it is at most sum_{i > k} c_i = G_k,
constant if k alone turns, and rotates with the joints before k.

In a box of angles q_k -+ d_k, move from the middle to any point one joint after the other, s1
first. Joint k moves D, which is sinusoidal in it, by at most the smaller of

```
(|dD/dq_k| + G_k sum_{j < k} d_j) d_k + |d2D/dq_k2| d_k^2 / 2,         2 sin(d_k / 2) G_k
```

with the derivatives at the middle; E likewise, without the second derivative.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from baxter_kin.ik.reach.linkage import Linkage
from baxter_kin.ik.reach.shoulder_sweep import Flags
from baxter_kin.kinematics.symbolic import QUARTERS
from baxter_kin.validation import FloatArray

_FIRST_AXES = np.diag([-1.0, -1.0, 1.0])  # from `DHParameters.T_base_first` to the linkage's
_AT_ZERO = 0.5 * np.pi * np.array(QUARTERS)[:, None]


class HandDeviation(NamedTuple):
    """The displacement between the hand of an arm and that of its linkage in n boxes, or in all.

    Attributes:
        wrist: the arm's wrist minus the linkage's, radially, sideways and up with s0, (3, n), m.
        R: the rotation from the arm's hand to the linkage's, along the same axes, (3, 3, n).
        slack: bounds on the errors of both anywhere in a box, shape (2, n), m and rad.
    """

    wrist: FloatArray
    R: FloatArray
    slack: FloatArray

    def part(self, which: Flags) -> HandDeviation:
        """The deviations in some of the boxes."""
        if self.slack.shape[1] == 1:
            return self
        return HandDeviation(*(values[..., which] for values in self))

    def repeated(self, count: int) -> HandDeviation:
        """Each deviation `count` times."""
        if self.slack.shape[1] == 1:
            return self
        return HandDeviation(*(np.repeat(values, count, axis=-1) for values in self))

    def or_tighter(self, other: HandDeviation) -> HandDeviation:
        """The estimate with the smaller error, for each box and for wrist and hand separately."""
        wrist, hand = other.slack < self.slack
        return HandDeviation(
            np.where(wrist, other.wrist, self.wrist),
            np.where(hand, other.R, self.R),
            np.minimum(self.slack, other.slack),
        )


class NearbyDeviation:
    """The deviation of one arm from its linkage.

    Attributes:
        anywhere: the deviation for all angles.
    """

    def __init__(self, linkage: Linkage) -> None:
        dh, whole = linkage.dh, linkage.deviation
        is_missing = np.arange(6) % 2 == 1
        a, d = dh.a_m, np.concatenate([[0.0], dh.d_m])
        self._a, self._d, alpha = (
            np.stack([arms, linkages], axis=1)[:, :, None]
            for arms, linkages in (
                (a, np.where(is_missing, 0.0, a)),
                (d, np.where(is_missing, 0.0, d)),
                (dh.alpha_rad, np.full(6, 0.5 * np.pi)),
            )
        )
        self._cos, self._sin = np.cos(alpha), np.sin(alpha)
        self._max_rates = _max_rates(linkage, np.where(is_missing, np.hypot(a, d), 0.0))[:, :, None]
        slack = np.array([[whole.wrist_m], [whole.axis]])
        self.anywhere = HandDeviation(np.zeros((3, 1)), np.eye(3)[:, :, None], slack)

    def near(self, q: FloatArray, slack: FloatArray) -> HandDeviation:
        """The deviation in boxes of the linkage's angles s1, e0, e1, w0 and w1.

        Args:
            q: middles of the boxes, shape (5, n), rad.
            slack: half their widths, shape (5, n), rad.
        """
        x, y, z, p, axes, points = self._frames(q)
        frame = np.stack([x, y, z])
        R = np.einsum("can,cbn->abn", frame[:, :, 1], frame[:, :, 0])
        moves = _cross(axes, p - points)
        turns = np.einsum("abn,kbn->kan", R, axes[:, :, 0]) - axes[:, :, 1]
        rates = np.stack([_length(_difference(moves)), _length(turns)])
        before = np.cumsum(slack, axis=0) - slack
        off = (rates + self._max_rates * before) * slack
        off[0] += 0.5 * _length(_difference(_cross(axes, moves))) * slack**2
        chords = 2.0 * np.sin(0.5 * np.minimum(slack, np.pi))
        return HandDeviation(
            _difference(p), R, np.minimum(off, self._max_rates * chords).sum(axis=1)
        )

    def _frames(self, q: FloatArray) -> tuple[FloatArray, ...]:
        """Axes x, y, z of the hand before w2, and the wrist, (3, 2, n): of arm and linkage.

        And the axes of the joints s1 to w1, and a point on each, (5, 3, 2, n).
        """
        both = (3, 2, q.shape[1])
        x, y, z = (np.broadcast_to(axis[:, None, None], both) for axis in _FIRST_AXES)
        p, axes, points = np.zeros(both), np.empty((5, *both)), np.empty((5, *both))
        cos, sin = np.cos(q + _AT_ZERO), np.sin(q + _AT_ZERO)
        for i in range(6):
            if i > 0:
                axes[i - 1], points[i - 1] = z, p
                x, y = _turned(x, y, cos[i - 1], sin[i - 1])
            p = p + self._d[i] * z + self._a[i] * x
            y, z = _turned(y, z, self._cos[i], self._sin[i])
        return x, y, z, p, axes, points


def _max_rates(linkage: Linkage, missing_m: FloatArray) -> FloatArray:
    """The bounds G on the derivatives of D and of E for s1 to w1, shape (2, 5)."""
    twists = np.abs(linkage.dh.alpha_rad - 0.5 * np.pi)
    fore, wrist = linkage.fore_span_m, linkage.wrist_offset_m
    reach = linkage.upper_span_m + fore
    to_wrist = np.array([reach, reach, fore, fore, 0.0, 0.0])
    levers = np.array([reach, linkage.elbow_offset_m + fore, fore, wrist, 0.0])
    moves = _sums_after(twists * to_wrist + missing_m) + np.cumsum(twists)[:5] * levers
    return np.stack([moves, _sums_after(twists)])


def _sums_after(terms: FloatArray) -> FloatArray:
    """The sums over the links after s1 to w1."""
    return np.asarray(np.cumsum(terms[:0:-1])[::-1])


def _turned(
    a: FloatArray, b: FloatArray, cos: FloatArray, sin: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Two axes turned by an angle from the first to the second."""
    return cos * a + sin * b, cos * b - sin * a


def _difference(values: FloatArray) -> FloatArray:
    """The arm's values minus the linkage's."""
    return np.asarray(values[..., 0, :] - values[..., 1, :])


def _length(vectors: FloatArray) -> FloatArray:
    """The lengths of vectors of shape (k, 3, n)."""
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=1)))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """The cross products of vectors of shape (k, 3, 2, n)."""
    (ax, ay, az), (bx, by, bz) = np.moveaxis(a, 1, 0), np.moveaxis(b, 1, 0)
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
