from __future__ import annotations

import pickle
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from baxter_kin import Arm, IKFailure, IKResult, IKService, SeedType
from baxter_kin.errors import ConfigurationError
from baxter_kin.ik.result import unchecked_result
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
    "changes",
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
def test_a_result_is_not_made_of_anything(left: Arm, changes: dict[str, Any]) -> None:
    whole: dict[str, Any] = {
        "joint_names": left.joint_names,
        "q": left.neutral,
        "seed_type": SeedType.USER,
        "position_error_m": 0.0,
        "orientation_error_rad": 0.0,
    }
    assert IKResult(**whole).is_valid
    with pytest.raises(ConfigurationError):
        IKResult(**(whole | changes))


@pytest.mark.parametrize("changes", [{"reason": 5}, {"starts": {"x": 1}}, {"starts": 5}], ids=str)
def test_a_failure_is_not_made_of_anything(changes: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError, match="IKFailure"):
        IKFailure(**({"reason": "no way"} | changes))


@pytest.mark.parametrize(
    ("seed_type", "failure"), [(SeedType.INVALID, None), (SeedType.USER, IKFailure("no way"))]
)
def test_a_result_has_either_a_seed_type_or_a_failure(
    left: Arm, seed_type: SeedType, failure: IKFailure | None
) -> None:
    with pytest.raises(ConfigurationError, match="either a seed type that led to it or a failure"):
        IKResult(left.joint_names, left.neutral, seed_type, 0.0, 0.0, failure)


@pytest.mark.parametrize("failure", [None, IKFailure("no way")], ids=["valid", "invalid"])
def test_an_unchecked_result_is_the_checked_one(left: Arm, failure: IKFailure | None) -> None:
    kind = SeedType.CURRENT if failure is None else SeedType.INVALID
    checked = IKResult(left.joint_names, left.start, kind, 1e-9, 2e-9, failure)
    unchecked = unchecked_result(left.joint_names, left.start, kind, (1e-9, 2e-9), failure)
    for field in fields(IKResult):
        assert np.all(getattr(checked, field.name) == getattr(unchecked, field.name)), field.name
    assert repr(checked) == repr(unchecked)
    assert unchecked.is_valid == (failure is None)


def test_angles_are_copied_and_read_only(left: Arm) -> None:
    q = np.array(left.start)
    result = IKResult(left.joint_names, q, SeedType.USER, 0.0, 0.0)
    q[0] = 7.0
    np.testing.assert_array_equal(result.q, left.start)
    with pytest.raises(ValueError, match="read-only"):
        result.q[0] = 7.0


def test_starts_of_a_failure_cannot_be_changed() -> None:
    starts = {SeedType.USER: 1}
    failure = IKFailure("no way", starts)
    starts[SeedType.USER] = 2
    assert failure.starts == {SeedType.USER: 1}
    with pytest.raises(TypeError):
        failure.starts[SeedType.USER] = 2  # type: ignore[index]


def test_what_is_asked_later_must_be_a_failure() -> None:
    with pytest.raises(ConfigurationError, match="ask must be callable, got str"):
        IKFailure.later("why")  # type: ignore[arg-type]
    with pytest.raises(ConfigurationError, match="what ask returns must be of class IKFailure"):
        str(IKFailure.later(lambda: "why"))  # type: ignore[arg-type,return-value]
