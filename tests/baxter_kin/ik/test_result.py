from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

from baxter_kin import Arm, ConfigurationError, IKFailure, IKResult, IKService, SeedType
from tests.conftest import overhead


def test_a_failure_finds_its_reason_when_it_is_asked() -> None:
    asked = []

    def ask() -> IKFailure:
        asked.append(1)
        return IKFailure("no way", {SeedType.USER: 3}, 0.5)

    failure = IKFailure.later(ask)
    assert not asked
    assert failure.beyond_reach_m == 0.5
    assert str(failure) == "no way"
    assert failure == IKFailure("no way", {SeedType.USER: 3}, 0.5)
    assert pickle.loads(pickle.dumps(IKFailure.later(ask))) == failure
    assert len(asked) == 2
    with pytest.raises(AttributeError, match="no attribute 'resaon'"):
        _ = failure.resaon  # type: ignore[attr-defined]


def test_result_lists_joints_by_name(ik: IKService, left: Arm) -> None:
    result = ik.solve(overhead(0.70, 0.15, -0.129), current=left.start)
    assert tuple(result.joints) == left.joint_names
    assert list(result.joints.values()) == result.q.tolist()


@pytest.mark.parametrize(
    "fields",
    [
        {"seed_type": "x"},
        {"seed_type": 5},
        {"joint_names": 5},
        {"joint_names": ("a", 1)},
        {"failure": "no"},
        {"position_error_m": "0"},
        {"orientation_error_rad": -1.0},
        {"q": np.zeros(3)},
        {"q": np.full(7, np.nan)},
    ],
    ids=str,
)
def test_a_result_is_not_made_of_anything(left: Arm, fields: dict[str, Any]) -> None:
    whole: dict[str, Any] = {
        "joint_names": left.joint_names,
        "q": left.neutral,
        "seed_type": SeedType.USER,
        "position_error_m": 0.0,
        "orientation_error_rad": 0.0,
    }
    assert IKResult(**whole).is_valid
    with pytest.raises(ConfigurationError):
        IKResult(**(whole | fields))


@pytest.mark.parametrize("fields", [{"reason": 5}, {"starts": {"x": 1}}, {"starts": 5}], ids=str)
def test_a_failure_is_not_made_of_anything(fields: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError, match="IKFailure"):
        IKFailure(**({"reason": "no way"} | fields))
