"""An arm's geometry as Denavit-Hartenberg parameters, computed from its Pinocchio model.

An arm has seven axes in space: joint i turns about the line through `o` along `z`, both seen from
base at q = 0. Link i, between the axes of joints i and i + 1, has a length `a` along the common
normal of the axes, `x = z_i x z_i+1`, and a twist `alpha` about it; between the feet of two such
normals on an axis are an offset `d` along the axis and an angle `theta` about it (Denavit and
Hartenberg, "A kinematic notation for lower-pair mechanisms based on matrices", 1955):

```
T_base_tip(q) = T_base_first Rz(q_1) Tx(a_1) Rx(alpha_1)
                Rz(q_2 + theta_1) Tz(d_1) Tx(a_2) Rx(alpha_2) ... Rz(q_7) T_last_tip
```

Neighbouring axes of Baxter's arms are at right angles up to a calibration, so their normals are
well defined, and small changes of the axes change the parameters little.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin.errors import DescriptionError
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray

MIN_TWIST_SINE = 0.5
"""Neighbouring axes of a Baxter are at least 30 degrees from parallel."""


@dataclass(frozen=True, slots=True, eq=False)
class DHParameters:
    """The geometry of one arm.

    Attributes:
        a_m: lengths of the six links between axes, shape (6,), m.
        alpha_rad: their twists, shape (6,), in (0, pi).
        d_m: offsets along the five axes between links, shape (5,), m.
        theta_rad: angles about them at q = 0, shape (5,), in [-3 pi/2, pi/2).
        T_base_first: the frame of the first axis: z along it, x along the first normal at q = 0.
        T_last_tip: the tip seen from the frame of the last axis: z along it, origin at the end of
            the last normal.
    """

    a_m: FloatArray
    alpha_rad: FloatArray
    d_m: FloatArray
    theta_rad: FloatArray
    T_base_first: pin.SE3
    T_last_tip: pin.SE3

    @classmethod
    def of(cls, arm: Arm) -> DHParameters:
        """The parameters of an arm; axes that cannot be a Baxter's are refused."""
        z, o = _axes(arm)
        normals = np.cross(z[:-1], z[1:])
        sines = np.linalg.norm(normals, axis=1)
        for name, sine in zip(arm.joint_names[1:], sines, strict=True):
            if not sine >= MIN_TWIST_SINE:
                raise DescriptionError(
                    f"the axis of {name} is {math.degrees(math.asin(sine)):.0f} degrees from "
                    "parallel to the one before it; on Baxter's arms they are at right angles"
                )
        x = normals / sines[:, None]
        leaving, arriving, a = _feet(z, o, x)
        alpha = np.arctan2(sines, (z[:-1] * z[1:]).sum(axis=1))
        d = ((leaving[1:] - arriving[:-1]) * z[1:-1]).sum(axis=1)
        sine = (np.cross(x[:-1], x[1:]) * z[1:-1]).sum(axis=1)
        theta = np.arctan2(sine, (x[:-1] * x[1:]).sum(axis=1))
        theta = (theta + 1.5 * np.pi) % (2.0 * np.pi) - 1.5 * np.pi
        T_base_last = _frame(z[6], x[5], arriving[5])
        T_last_tip = T_base_last.actInv(arm.T_base_tip(np.zeros(7)))
        return cls(a, alpha, d, theta, _frame(z[0], x[0], leaving[0]), T_last_tip)


def _axes(arm: Arm) -> tuple[FloatArray, FloatArray]:
    """Directions of the joints' axes and points on them at q = 0, from base, each shape (7, 3)."""
    model, data = arm.model, arm.model.createData()
    if model.nq != 7 or model.nv != 7:
        raise DescriptionError(f"the {arm.side} arm has {model.nv} degrees of freedom, not 7")
    pin.computeJointJacobians(model, data, np.zeros(7))
    z, o = np.empty((7, 3)), np.empty((7, 3))
    for i in range(7):
        here = pin.getJointJacobian(model, data, i + 1, pin.ReferenceFrame.LOCAL)[:, i]
        if np.abs(here[:3]).max() > 0.0 or not math.isclose(np.linalg.norm(here[3:]), 1.0):
            raise DescriptionError(f"{arm.joint_names[i]} is not a revolute joint")
        z[i] = data.oMi[i + 1].rotation @ here[3:]
        o[i] = data.oMi[i + 1].translation
    return z, o


def _feet(z: FloatArray, o: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The feet of the common normals on an axis and on the next, and their lengths."""
    leaving, arriving, lengths = np.empty((6, 3)), np.empty((6, 3)), np.empty(6)
    for i in range(6):
        ways = np.stack([z[i], -z[i + 1], x[i]], axis=1)
        s, t, lengths[i] = np.linalg.solve(ways, o[i + 1] - o[i])
        leaving[i], arriving[i] = o[i] + s * z[i], o[i + 1] + t * z[i + 1]
    return leaving, arriving, lengths


def _frame(z: FloatArray, x: FloatArray, origin: FloatArray) -> pin.SE3:
    return pin.SE3(np.stack([x, np.cross(z, x), z], axis=1), origin)
