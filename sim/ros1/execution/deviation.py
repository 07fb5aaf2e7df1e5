"""Deviation: how far an arm was off its path, afterwards and exactly.

A joint is off its set-point of the same instant, which a lag alone makes. The tip is off the
*path*: its way over the last `WINDOW` set-points as straight pieces, whenever it was there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baxter_kin import Arm
from baxter_kin.validation import FloatArray
from sim.samples import Sample

WINDOW = 150
"""Set-points of 1.5 s."""


class Deviation(NamedTuple):
    """How far an arm was off, at most.

    Attributes:
        joint_rad: of the worst joint from its set-point.
        tip_m: of the tip from its path.
    """

    joint_rad: float = 0.0
    tip_m: float = 0.0


def deviation_of(arm: Arm, samples: Sequence[Sample]) -> Deviation:
    """The greatest deviations over the samples of one execution, in order."""
    if not samples:
        return Deviation()
    q_path = np.array([sample.q_path for sample in samples])
    q_measured = np.array([sample.q_measured for sample in samples])
    paths, tips = (arm.T_base_tips(q)[:, :3, 3] for q in (q_path, q_measured))
    tip_m = max(
        _off_m(paths[max(0, number - WINDOW) : number + 1], tip) for number, tip in enumerate(tips)
    )
    return Deviation(float(np.abs(q_measured - q_path).max()), tip_m)


def _off_m(path: FloatArray, point: FloatArray) -> float:
    """The distance of a point, shape (3,), from the pieces between points, shape (n, 3), m."""
    begin, along = path[:-1], np.diff(path, axis=0)
    if not len(begin):
        return float(np.linalg.norm(point - path[0]))
    squared = np.maximum((along**2).sum(axis=1), 1e-18)
    share = np.clip(((point - begin) * along).sum(axis=1) / squared, 0.0, 1.0)
    feet = begin + share[:, None] * along
    return float(np.linalg.norm(point - feet, axis=1).min())
