"""Compute the null-space map: `python scripts/build_setpoints.py`, writes setpoints.json.

The tip positions of 20,000 random configurations of the left arm are split into 27 regions, as many
as a real Baxter has setpoints, by Lloyd's k-means. Each region is represented by the configuration
that, among those ending near its centre, is the best to start a search from: the product of its
manipulability (Yoshikawa 1985) and its distance from the joint limits is greatest. The right arm
gets the mirror images.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from baxter_kin.model import MIRROR, Arm, Baxter

SAMPLES = 20_000
SETPOINTS = 27
NEAR_CENTRE = 100
LLOYD_STEPS = 50
TARGET = Path(__file__).parents[1] / "baxter_kin" / "ik" / "setpoints.json"


def main() -> None:
    """Compute and write the table."""
    arm = Baxter.load().arm("left")
    rng = np.random.default_rng(27)
    configurations = np.array([arm.random_configuration(rng) for _ in range(SAMPLES)])
    positions = np.array([arm.T_base_tip(q).translation for q in configurations])
    setpoints = []
    for centre in _centres(positions, rng):
        near = np.argsort(np.linalg.norm(positions - centre, axis=1))[:NEAR_CENTRE]
        setpoints.append(max(configurations[near], key=lambda q: _quality(arm, q)))
    left = np.round(np.array(setpoints), 6)
    table = {"left": left.tolist(), "right": (left * MIRROR).tolist()}
    rows = ",\n".join(
        f' "{side}": [\n' + ",\n".join(f"  {json.dumps(q)}" for q in qs) + "\n ]"
        for side, qs in table.items()
    )
    TARGET.write_text("{\n" + rows + "\n}\n", encoding="utf-8")
    print(f"{len(left)} setpoints per arm in {TARGET}")


def _centres(points: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    centres = points[rng.choice(len(points), SETPOINTS, replace=False)]
    for _ in range(LLOYD_STEPS):
        nearest = np.linalg.norm(points[:, None] - centres[None], axis=2).argmin(axis=1)
        centres = np.array([points[nearest == i].mean(axis=0) for i in range(SETPOINTS)])
    return centres


def _quality(arm: Arm, q: NDArray[np.float64]) -> float:
    J = arm.jacobian(q)
    manipulability = np.sqrt(max(np.linalg.det(J @ J.T), 0.0))
    limits = arm.limits
    room = np.minimum(q - limits.q_min, limits.q_max - q) / (limits.q_max - limits.q_min)
    return float(manipulability * room.min())


if __name__ == "__main__":
    main()
