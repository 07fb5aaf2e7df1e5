"""OptIK's row, with a stand-in for its package that has the same offset and the same calls."""

from __future__ import annotations

import importlib.machinery
import importlib.metadata
import sys
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from baxter_kin import Arm
from baxter_kin.benchmark.entrants import PEERS, Absence, Contestant, enter
from baxter_kin.validation import FloatArray

OPTIK = next(peer for peer in PEERS if peer.key == "optik")
OFFSET = np.array([[1.0, 0, 0, -0.016], [0, 1, 0, 0.039], [0, 0, 1, 0], [0, 0, 0, 1]])


class _StandIn:
    """`optik.Robot` of an arm whose base is off by `OFFSET`, and further along with each joint."""

    def __init__(self, arm: Arm, *, drift: float = 0.0) -> None:
        self.arm = arm
        self.drift = drift
        self.threads = 0
        self.calls: list[tuple[Any, FloatArray, FloatArray]] = []

    def from_urdf_file(self, _path: str, base_link: str, ee_link: str) -> _StandIn:
        assert (base_link, ee_link) == ("base", self.arm.tip_frame)
        return self

    def set_parallelism(self, threads: int) -> None:
        self.threads = threads

    def fk(self, q: FloatArray) -> list[list[float]]:
        T: FloatArray = np.linalg.inv(OFFSET) @ self.arm.T_base_tip(q).homogeneous
        T[0, 3] += self.drift * q[0]
        return T.tolist()  # type: ignore[no-any-return]

    def ik(self, config: Any, target: FloatArray, x0: FloatArray) -> tuple[list[float], float]:
        self.calls.append((config, target, x0))
        return x0.tolist(), 0.0


def _enter(monkeypatch: pytest.MonkeyPatch, robot: _StandIn) -> Contestant | Absence:
    module = ModuleType("optik")
    module.Robot = robot  # type: ignore[attr-defined]
    module.SolverConfig = dict  # type: ignore[attr-defined]
    module.__spec__ = importlib.machinery.ModuleSpec("optik", None)
    monkeypatch.setitem(sys.modules, "optik", module)
    monkeypatch.delitem(sys.modules, "baxter_kin.benchmark.solvers.optik", raising=False)
    monkeypatch.setattr(importlib.metadata, "version", lambda _name: "0.5.0")
    return enter(OPTIK, robot.arm)


def test_poses_are_corrected_by_the_offset_of_its_base(
    left: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = _StandIn(left)
    contestant = _enter(monkeypatch, robot)
    assert isinstance(contestant, Contestant)
    q = left.random_configuration(np.random.default_rng(3))
    answer = contestant.call(*contestant.prepare(left.T_base_tip(q), q))
    (config, target, _), *_ = robot.calls
    assert np.abs(target - np.array(robot.fk(q))).max() < 1e-12
    assert np.array_equal(contestant.read(answer), q)  # type: ignore[arg-type]
    assert config["tol_f"] == 1e-12
    assert robot.threads == 1
    assert contestant.read(None) is None


def test_an_offset_that_is_not_constant_keeps_it_out(
    left: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    absence = _enter(monkeypatch, _StandIn(left, drift=1e-9))
    assert isinstance(absence, Absence)
    assert "forward kinematics differs from Pinocchio's" in absence.reason


def test_without_its_package_the_command_to_install_it_is_given(
    left: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    absence = enter(OPTIK, left)
    assert isinstance(absence, Absence)
    assert "optik is not installed" in absence.reason
    assert "optik-py" in absence.reason
