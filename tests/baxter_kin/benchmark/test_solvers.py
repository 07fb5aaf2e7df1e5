"""The solvers: who takes part, and that each solves the same arm."""

from __future__ import annotations

import importlib.machinery
import importlib.metadata
import sys
from dataclasses import replace
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, Baxter
from baxter_kin.benchmark.poses import PoseSet
from baxter_kin.benchmark.solvers import (
    ENTRANTS,
    MAX_FK_DIFFERENCE,
    PEERS,
    Absence,
    Contestant,
    Entrant,
    describe,
    enter,
    ours,
    placements_about_z,
)
from baxter_kin.validation import FloatArray
from tests.conftest import at
from tests.served_urdf import served_urdf

ROUNDING = 1e-13
OPTIK = next(peer for peer in PEERS if peer.key == "optik")
OFFSET = np.array([[1.0, 0, 0, -0.016], [0, 1, 0, 0.039], [0, 0, 1, 0], [0, 0, 0, 1]])


def test_absent_solver_says_how_to_install_it(left: Arm) -> None:
    entrant = Entrant("ghost", ours, needs=("no_such_solver",), install="run: pip install it")
    absence = enter(entrant, left)
    assert absence == Absence("ghost", "no_such_solver is not installed; run: pip install it")


def test_solver_that_cannot_start_is_absent_with_the_reason(left: Arm) -> None:
    absence = enter(Entrant("odd", partial(ours, no_such_option=1)), left)
    assert isinstance(absence, Absence)
    assert absence.reason.startswith("odd could not start: TypeError")


def test_no_two_entrants_have_one_key() -> None:
    keys = [entrant.key for entrant in ENTRANTS]
    assert len(set(keys)) == len(keys)


@pytest.mark.parametrize("off", [2.0 * MAX_FK_DIFFERENCE, np.nan])
def test_a_solver_of_another_chain_does_not_take_part(left: Arm, off: float) -> None:
    def other(arm: Arm) -> Contestant:
        return replace(ours(arm), forward=lambda q: arm.T_base_tip(q).homogeneous + off)

    absence = enter(Entrant("other", other), left)
    assert isinstance(absence, Absence)
    assert "forward kinematics differs from Pinocchio's" in absence.reason


def test_an_exception_is_told_by_its_class_and_first_line() -> None:
    assert describe(ZeroDivisionError("no luck\nat all")) == "ZeroDivisionError: no luck"
    assert describe(KeyError()) == "KeyError"


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


def test_our_solver_reaches_every_pose_alone_and_in_a_batch(left: Arm, poses: PoseSet) -> None:
    solver = ours(left)
    assert solver.call_batch is not None
    batch = solver.call_batch(poses.T_base_tips, list(poses.q_seeds))
    for T, q_seed, result in zip(poses.T_base_tips, poses.q_seeds, batch, strict=True):
        for answer in (solver.call(*solver.prepare(T, q_seed)), result):
            q = solver.read(answer)
            assert q is not None
            assert np.abs(left.T_base_tip(q).homogeneous - T.homogeneous).max() < 2e-6


def test_no_solution_is_no_answer(left: Arm) -> None:
    solver = ours(left)
    assert solver.read(solver.call(*solver.prepare(at(3.0, 0.0, 0.0), left.neutral))) is None


def test_settings_say_what_was_chosen(left: Arm) -> None:
    assert ours(left).settings == "`IKService.solve`, all defaults"
    chosen = ours(left, backend="casadi")
    assert chosen.name == "baxter-kin (backend casadi)"
    assert "backend casadi" in chosen.settings


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
