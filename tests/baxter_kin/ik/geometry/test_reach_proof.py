from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.ik.geometry.reach_proof import ReachProof
from baxter_kin.kinematics.arm import JOINTS

NAMES = {joint: f"left_{joint}" for joint in JOINTS}
WRIST = np.array([1.0204, -0.0001, 0.25])


def proof_of(excess_m: float) -> ReachProof:
    return ReachProof.of("span", excess_m, WRIST, NAMES, 0.745)


@pytest.mark.parametrize(
    ("bound", "joints"),
    [
        ("span", ["s1"]),
        ("fold", ["s1", "e1"]),
        ("shoulder", ["s0", "s1", "e1"]),
        ("wrist", ["w1", "s0", "s1", "e1"]),
        ("limits", []),
    ],
)
def test_a_proof_of_each_bound_names_its_joints_and_the_wrist(
    bound: str, joints: list[str]
) -> None:
    proof = ReachProof.of(bound, 0.0123, WRIST, NAMES, 0.745)
    assert proof.bound == bound
    assert re.findall(r"left_(\w\d)", str(proof)) == joints
    assert "12 mm" in str(proof)
    assert str(proof).endswith(", with the wrist at (1.02, 0, 0.25) m")


@pytest.mark.parametrize("bound", ["span", "shoulder"])
def test_a_proof_of_a_position_names_the_tip(bound: str) -> None:
    proof = ReachProof.of_position(bound, 0.5, WRIST, NAMES, 1.1334)
    assert str(proof).startswith("500 mm beyond the 1.133 m that ")
    assert str(proof).endswith(", with the tip at (1.02, 0, 0.25) m")


@given(st.floats(1e-6, 1e4))
def test_the_words_claim_no_more_than_the_proof_and_little_less(excess_m: float) -> None:
    number, unit = str(proof_of(excess_m)).split()[:2]
    said_m = float(number) * {"m": 1.0, "mm": 1e-3}[unit]
    digits = 1e-9 if excess_m < 10.0 else 5e-6 * excess_m  # six, of metres
    assert excess_m - max(1e-6, 0.1 * excess_m) <= said_m <= excess_m + digits


@given(st.floats(1e-6, 1.0), st.floats(0.0, 1.0))
def test_what_can_be_made_up_is_taken_off(excess_m: float, leeway_m: float) -> None:
    left = proof_of(excess_m).less(leeway_m)
    assert (left is None) == (excess_m <= leeway_m)
    if left is not None:
        assert left.excess_m == excess_m - leeway_m
        assert left.bound == "span"


def test_what_can_be_made_up_is_said_and_rounded_up() -> None:
    proof = proof_of(0.1)
    assert str(proof.less(0.0121)) == f"{proof}, and no more than 13 mm can be made up"
    assert proof.less(0.0) == proof
