"""Pickle and copy: of everything public, with nothing lost, or with a refusal in words."""

from __future__ import annotations

import copy
import importlib
import pickle
import pickletools
import pkgutil
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from enum import Enum
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import baxter_kin
import planner
import sim
from baxter_kin import Arm, Baxter, BaxterError
from baxter_kin.errors import CopyError, UnknownNameError
from baxter_kin.fields import FrozenMapping, field_names
from planner import Certificate, Plan, RobotBody, verify
from sim import Recorder
from sim.ros1.execution.readiness.ready import Finding, Readiness
from sim.view.live.viewer import Viewer
from tests.conftest import at
from tests.front_doors import FRONT_DOORS

COPIES: dict[str, Callable[[Any], Any]] = {
    "pickle": lambda each: pickle.loads(pickle.dumps(each)),
    "deepcopy": copy.deepcopy,
    "copy": copy.copy,
}

ARGUMENTS: dict[str, tuple[Any, ...]] = {
    "UnknownNameError": ("limb", "middle", ("left", "right")),
    "FileError": ("read", "a.json", "it is empty"),
    "StraightMoveError": (0.5, "the arm ends"),
    "PathMoveError": (0.5, "the arm ends"),
    "StageError": ("pick: approach", "it is too far"),
    "NotReadyError": (Readiness((Finding("state", False, "it is stopped"),), None),),
}
"""Arguments of the errors that take more than a sentence."""


def same(a: Any, b: Any) -> bool:
    """Whether two are alike: arrays, poses and values by their content, others by their text."""
    if isinstance(a, np.ndarray):
        return bool(a.flags.writeable == b.flags.writeable and np.array_equal(a, b, equal_nan=True))
    if isinstance(a, pin.SE3):
        return bool(np.array_equal(a.homogeneous, b.homogeneous))
    if (names := field_names(a)) and not isinstance(a, Certificate):
        return same([getattr(a, name) for name in names], [getattr(b, name) for name in names])
    if isinstance(a, (dict, FrozenMapping)):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, (tuple, list)):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, Certificate):
        a, b = a.as_dict(), b.as_dict()  # without the plan that it is of
    return type(a) is type(b) and (" object at 0x" in repr(a) or repr(a) == repr(b))


@pytest.mark.parametrize("way", COPIES)
def test_copies_are_alike(specimens: dict[str, object], way: str) -> None:
    for name, each in specimens.items():
        assert same(each, COPIES[way](each)), name


def test_what_is_copied_works(specimens: dict[str, Any], left: Arm) -> None:
    service, T = pickle.loads(pickle.dumps(specimens["service"])), left.T_base_tip(left.neutral)
    assert service.solve(T).q.tolist() == specimens["result"].q.tolist()
    space, guarded = pickle.loads(pickle.dumps(specimens["space"]))
    assert space.is_free(left.neutral)
    assert guarded.is_free(left.neutral)
    tool = pickle.loads(pickle.dumps(specimens["tool"])).arm
    assert np.allclose(tool.T_base_tip(left.neutral), T * at(0.0, 0.0, 0.1))


def test_the_body_that_comes_with_the_package_is_not_sent() -> None:
    assert len(pickle.dumps(RobotBody.load())) < 200
    assert pickle.loads(pickle.dumps(RobotBody.load())) is RobotBody.load()


def test_a_copy_of_a_certificate_is_of_no_plan(specimens: dict[str, Any]) -> None:
    plan: Plan = specimens["plan"]
    certificate = specimens["certificate"]
    assert certificate.is_of(plan)
    assert not pickle.loads(pickle.dumps(certificate)).is_of(plan)
    together = copy.deepcopy((plan, certificate))
    assert not together[1].is_of(together[0])
    assert verify(together[0]).is_valid


def test_every_public_class_was_copied_or_refuses(specimens: dict[str, object]) -> None:
    copied = {name for each in specimens.values() for name in classes_in(pickle.dumps(each))}
    public = {
        cls.__qualname__
        for package in FRONT_DOORS
        for cls in (getattr(package, name) for name in package.__all__)
        if isinstance(cls, type) and not issubclass(cls, (BaseException, Enum))
    }
    refusing = {"PlanCsvFile", "Program", "TipTarget", "Viewer"}
    abstract = {"Objective", "Observer", "PoseSource"}
    assert public - copied - refusing - abstract == set()


def classes_in(pickled: bytes) -> Iterator[str]:
    """The names of all classes that a pickle speaks of."""
    for opcode, argument, _ in pickletools.genops(pickled):
        if opcode.name in {"SHORT_BINUNICODE", "BINUNICODE"}:
            yield str(argument)


def test_what_holds_a_file_or_a_socket_says_that_it_cannot_be_copied(
    robot: Baxter, tmp_path: Path
) -> None:
    holders: dict[str, Any] = {
        "CsvFile": Recorder(robot, tmp_path / "a.csv"),
        "McapFile": Recorder(robot, tmp_path / "a.mcap"),
        "BagAtEnd": Recorder(robot, tmp_path / "a.bag"),
        "PlanCsvFile": sim.recording.PlanCsvFile(tmp_path / "b.csv"),
        "Viewer": Viewer(robot),
    }
    for name, holder in holders.items():
        for make in COPIES.values():
            with pytest.raises(CopyError, match=f"{name} holds an open file"):
                make(holder)
        holder.close()


def errors() -> list[type[BaxterError]]:
    for package in (baxter_kin, planner, sim):
        for module in pkgutil.iter_modules(package.__path__):
            if module.name == "errors":
                importlib.import_module(f"{package.__name__}.errors")
    found: list[type[BaxterError]] = [BaxterError]
    for each in found:
        found += each.__subclasses__()
    return found


def test_every_error_survives() -> None:
    for cls in errors():
        error = cls(*ARGUMENTS.get(cls.__name__, ("something is wrong",)))
        for make in COPIES.values():
            again = make(error)
            assert type(again) is cls
            assert str(again) == str(error)
            assert again.__dict__ == error.__dict__


@pytest.mark.slow
def test_an_error_in_a_worker_reaches_the_caller() -> None:
    """`UnknownNameError` once hung a pool for ever."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        error = pool.submit(ask_for_a_limb).exception(timeout=60.0)
    assert isinstance(error, UnknownNameError)
    assert error.allowed == ("left", "right")


def ask_for_a_limb() -> None:
    Baxter.load().arm("middle")
