"""Compute the null-space map: `python scripts/build_setpoints.py`, writes setpoints.json.

The tip poses of 40,000 random configurations of the left arm are split into 64 regions by Lloyd's
k-means, on position and rotation together. For each region, the setpoint is that one of its own
configurations from which a search reaches the region's other poses at the least cost: mean
iterations over the share of searches that succeed. The right arm gets the mirror images.

Each row of the table holds the region's middle (position in m and rotation matrix by rows, seen
from base), the setpoint in rad, and the share of the region's poses that one search from it solves.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from baxter_kin.command_line import OneSentenceParser
from baxter_kin.files import replace_file
from baxter_kin.ik.search.searcher import Searcher
from baxter_kin.ik.seeds import pose_features
from baxter_kin.kinematics.arm import MIRROR
from baxter_kin.kinematics.robot import Baxter
from baxter_kin.validation import FloatArray, Indices

SAMPLES = 40_000
REGIONS = 64
CANDIDATES = 150
PROBES = 150
LLOYD_STEPS = 25
TARGET = Path(__file__).parents[1] / "baxter_kin" / "ik" / "setpoints.json"


def main() -> None:
    """Compute and write the table."""
    OneSentenceParser(description=(__doc__ or "").split("\n", 1)[0]).parse_args()
    arm = Baxter.load().arm("left")
    rng = np.random.default_rng(27)
    qs = np.array([arm.random_configuration(rng) for _ in range(SAMPLES)])
    Ts = np.array([arm.T_base_tip(q).homogeneous for q in qs])
    features = pose_features(Ts)
    middles, region_of = _regions(features, rng)
    searcher = Searcher(arm)
    left = [
        _row(searcher, qs, Ts, np.flatnonzero(region_of == region), rng)
        for region in range(len(middles))
    ]
    right = [_mirrored(row) for row in left]
    table = ",\n".join(
        f' "{side}": [\n' + ",\n".join(f"  {json.dumps(row)}" for row in rows) + "\n ]"
        for side, rows in (("left", left), ("right", right))
    )
    replace_file(TARGET, ("{\n" + table + "\n}\n").encode())
    shares = [row["solved_share"] for row in left]
    print(f"{len(left)} setpoints per arm in {TARGET}; one search solves {np.mean(shares):.3f}")


def _regions(features: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, Indices]:
    middles = features[rng.choice(len(features), REGIONS, replace=False)]
    for _ in range(LLOYD_STEPS):
        nearest = _nearest(features, middles)
        middles = np.array([features[nearest == i].mean(axis=0) for i in range(REGIONS)])
    return middles, _nearest(features, middles)


def _nearest(features: FloatArray, middles: FloatArray) -> Indices:
    distances = (middles**2).sum(axis=1) - 2 * features @ middles.T
    nearest: Indices = distances.argmin(axis=1)
    return nearest


def _row(
    searcher: Searcher, qs: FloatArray, Ts: FloatArray, region: Indices, rng: np.random.Generator
) -> dict[str, object]:
    candidates = rng.choice(region, min(CANDIDATES, len(region)), replace=False)
    probes = rng.choice(region, min(PROBES, len(region)), replace=False)
    starts = np.repeat(qs[candidates], len(probes), axis=0)
    found = searcher.search(starts, np.tile(Ts[probes], (len(candidates), 1, 1)))
    shape = (len(candidates), len(probes))
    solved = found.is_valid.reshape(shape).mean(axis=1)
    cost = found.iterations.reshape(shape).mean(axis=1) / np.maximum(solved, 1e-6)
    best = int(cost.argmin())
    middle = Ts[region].mean(axis=0)
    return {
        "p_base_tip_m": middle[:3, 3].round(4).tolist(),
        "R_base_tip": middle[:3, :3].ravel().round(4).tolist(),
        "q_rad": qs[candidates[best]].round(6).tolist(),
        "solved_share": round(float(solved[best]), 3),
    }


def _mirrored(row: dict[str, object]) -> dict[str, object]:
    """The row for the right arm: base and tip frame reflected at their x-z planes."""
    reflect = np.diag([1.0, -1.0, 1.0])
    p, R = np.array(row["p_base_tip_m"]), np.array(row["R_base_tip"]).reshape(3, 3)
    return {
        **row,
        "p_base_tip_m": (reflect @ p + 0.0).tolist(),
        "R_base_tip": (reflect @ R @ reflect + 0.0).ravel().tolist(),
        "q_rad": (MIRROR * np.array(row["q_rad"]) + 0.0).tolist(),
    }


if __name__ == "__main__":
    main()
