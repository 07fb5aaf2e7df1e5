from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

from baxter_kin import Arm, IKFailure, IKResult, IKService, SeedType
from baxter_kin.errors import ConfigurationError
from baxter_kin.ik.result import checked_result, pending_failure
from tests.conftest import overhead


def test_a_pending_failure_finds_its_reason_once_when_a_field_is_read() -> None:
    calls = []

    def find() -> IKFailure:
        calls.append(1)
        return IKFailure("no way", {SeedType.USER: 3}, 0.5)

    failure = pending_failure(find)
    assert not calls
    assert failure.beyond_reach_m == 0.5
    assert str(failure) == "no way"
    assert failure == find()
    assert pickle.loads(pickle.dumps(pending_failure(find))) == failure
    assert len(calls) == 3
    with pytest.raises(AttributeError, match="no attribute 'resaon'"):
        _ = failure.resaon  # type: ignore[attr-defined]


def test_a_result_lists_joints_by_name(ik: IKService, left: Arm) -> None:
    result = ik.solve(overhead(0.70, 0.15, -0.129), current=left.start)
    assert tuple(result.joints) == left.joint_names
    assert list(result.joints.values()) == result.q.tolist()


def test_joint_values_of_a_result_are_read_only(ik: IKService, left: Arm) -> None:
    T = overhead(0.70, 0.15, -0.129)
    results = [ik.solve(T), ik.solve(T, current=left.start), *ik.solve_batch([T, T])]
    for result in results:
        for each in (result, pickle.loads(pickle.dumps(result))):
            with pytest.raises(ValueError, match="read-only"):
                each.q[0] = 7.0


@pytest.mark.parametrize(
    "changes",
    [
        {"position_error_m": -1.0},
        {"orientation_error_rad": -1.0},
        {"q": np.zeros(3)},
        {"q": np.zeros((7, 1))},
        {"seed_type": SeedType.INVALID},
        {"failure": IKFailure("no way")},
    ],
    ids=str,
)
def test_an_inconsistent_result_of_a_file_is_refused(left: Arm, changes: dict[str, Any]) -> None:
    whole: dict[str, Any] = {
        "joint_names": left.joint_names,
        "q": np.array(left.neutral),
        "seed_type": SeedType.USER,
        "position_error_m": 0.0,
        "orientation_error_rad": 0.0,
    }
    checked = checked_result(IKResult(**whole))
    assert checked is not None
    assert checked.is_valid
    assert not checked.q.flags.writeable
    with pytest.raises(ConfigurationError):
        checked_result(IKResult(**(whole | changes)))


@pytest.mark.parametrize("changes", [{"reason": 5}, {"starts": {"x": 1}}, {"starts": 5}], ids=str)
def test_a_failure_refuses_values_of_other_classes(changes: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError):
        IKFailure(**({"reason": "no way"} | changes))


def test_starts_of_a_failure_cannot_be_changed() -> None:
    starts = {SeedType.USER: 1}
    failure = IKFailure("no way", starts)
    starts[SeedType.USER] = 2
    assert failure.starts == {SeedType.USER: 1}
    with pytest.raises(TypeError):
        failure.starts[SeedType.USER] = 2  # type: ignore[index]
