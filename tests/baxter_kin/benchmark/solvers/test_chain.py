from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.benchmark.solvers.chain import placements_about_z
from tests.served_urdf import served_urdf

ROUNDING = 1e-13


@pytest.mark.parametrize("seed", [None, 0, 1])
@pytest.mark.parametrize("side", ["left", "right"])
def test_turns_about_z_are_the_arm(seed: int | None, side: str) -> None:
    """Also where calibration tilts the axes of the joints."""
    rng = None if seed is None else np.random.default_rng(seed)
    arm = Baxter.load(served_urdf(rng)).arm(side)
    first, *others = placements_about_z(arm)
    configurations = np.random.default_rng(5)
    for _ in range(20):
        q = arm.random_configuration(configurations)
        T = first
        for angle, placement in zip(q, others, strict=True):
            T = T * pin.SE3(pin.utils.rotate("z", angle), np.zeros(3)) * placement
        assert np.abs(T.homogeneous - arm.T_base_tip(q).homogeneous).max() < ROUNDING
