"""Plan files: what is loaded is what was saved, bit by bit, and anything else is refused."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from baxter_kin import IKFailure, IKResult, SeedType
from baxter_kin.fields import evolve, field_names
from planner import (
    Body,
    Box,
    Claim,
    Cylinder,
    Grip,
    GripperAction,
    Manipulator,
    Move,
    Part,
    Plan,
    PlanFailure,
    PlannerError,
    Scene,
    Sphere,
    State,
    Trajectory,
    complete,
    load_plan,
    plan_file,
    save_plan,
    verify,
)
from planner.collision import Clearance
from planner.errors import PlanFileError
from planner.scene.mesh import Mesh
from tests.conftest import at, state_at

FINITE = st.floats(-1e30, 1e30)
ANGLES = hnp.arrays(np.float64, 7, elements=st.floats(-1.0, 1.0, width=64))
WORDS = st.text(max_size=20)
SIZES = st.floats(1e-3, 10.0)
LENGTHS = st.floats(-100.0, 100.0)
SHAPES = st.one_of(
    st.builds(Box, st.tuples(SIZES, SIZES, SIZES)),
    st.builds(Cylinder, SIZES, SIZES),
    st.builds(Sphere, SIZES),
)


@st.composite
def poses(draw: st.DrawFn) -> pin.SE3:
    axis = np.array(draw(st.tuples(*[st.floats(-3.0, 3.0)] * 3)))
    return pin.SE3(pin.exp3(axis), np.array(draw(st.tuples(LENGTHS, LENGTHS, LENGTHS))))


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    names = draw(st.lists(st.text(min_size=1, max_size=9), unique=True, max_size=3))
    parts = st.lists(st.builds(Part, SHAPES, poses()), min_size=1, max_size=2)
    return Scene.of(
        Body(name, tuple(draw(parts)), draw(poses()), draw(st.booleans())) for name in names
    )


@st.composite
def trajectories(draw: st.DrawFn, manipulator: Manipulator, q: np.ndarray[Any, Any]) -> Trajectory:
    """A motion from q on, through random jerks."""
    count = draw(st.integers(0, 4))
    lengths = draw(st.lists(st.floats(1e-3, 2.0), min_size=count, max_size=count))
    jerks = draw(hnp.arrays(np.float64, (count, 7), elements=st.floats(-20.0, 20.0)))
    states = [(q, draw(ANGLES), draw(ANGLES))]
    for dt, j in zip(lengths, jerks, strict=True):
        p, v, a = states[-1]
        states.append(
            (p + dt * (v + dt * (a / 2 + dt * j / 6)), v + dt * (a + dt * j / 2), a + dt * j)
        )
    q_knots, v_knots, a_knots = (np.array(x) for x in zip(*states, strict=True))
    knots = np.concatenate([[0.0], np.cumsum(lengths)])
    return Trajectory(manipulator.limits, knots, q_knots, v_knots, a_knots, jerks)


NUMBERS = st.dictionaries(WORDS, FINITE, max_size=2)


@st.composite
def plans(draw: st.DrawFn, manipulator: Manipulator) -> Plan:
    names = manipulator.arm.joint_names
    q = start = draw(ANGLES)
    steps: list[Move | Grip] = []
    for _ in range(draw(st.integers(0, 3))):
        trajectory = draw(trajectories(manipulator, q))
        q = trajectory.q_goal
        ik = IKResult(names, q, SeedType.NS_MAP, draw(SIZES), draw(SIZES))
        clearance = Clearance(draw(FINITE), draw(WORDS), draw(WORDS))
        pose = draw(st.none() | poses())
        claims = tuple(draw(st.lists(st.builds(Claim, WORDS, NUMBERS), max_size=2)))
        steps.append(Move(draw(WORDS), trajectory, pose, ik, clearance, claims=claims))
        steps.append(Grip(draw(WORDS), draw(st.sampled_from(GripperAction)), draw(WORDS)))
    failure = IKFailure(draw(WORDS), {SeedType.USER: 3}, draw(FINITE), names, (draw(WORDS),))
    bad = IKResult(names, q, SeedType.INVALID, 1.0, 1.0, failure)
    failed = draw(st.none() | st.builds(PlanFailure, WORDS, WORDS, st.just(bad)))
    joints = draw(st.dictionaries(WORDS, FINITE, max_size=3)) | dict(state_at(start).joints)
    return Plan(State(draw(scenes()), joints), tuple(steps), failed, limb="left")


def bits(value: Any) -> Any:
    """A value as nested tuples in which every number is its bytes."""
    if isinstance(value, pin.SE3):
        return bits((value.rotation, value.translation))
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    if isinstance(value, float):
        return np.float64(value).tobytes()
    if names := field_names(value):
        return type(value), tuple(bits(getattr(value, name)) for name in names)
    if isinstance(value, Mapping):
        return bits(tuple(value.items()))
    return tuple(map(bits, value)) if isinstance(value, tuple) else value


def same(first: Any, second: Any) -> bool:
    """Whether two values are alike in class, structure and every bit."""
    return bool(bits(first) == bits(second))


@pytest.fixture(scope="module")
def plan(tracked_plan: Plan) -> Plan:
    return tracked_plan


@pytest.fixture(scope="module")
def saved(plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The bytes of the plan's file."""
    path = tmp_path_factory.mktemp("plans") / "plan.json"
    save_plan(plan, path)
    return path.read_bytes()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "plan.json"


def refusal(file: Path, content: bytes) -> str:
    """What is said about a file of that content."""
    file.write_bytes(content)
    with pytest.raises(PlanFileError) as caught:
        load_plan(file)
    return str(caught.value)


def resealed(saved: bytes, change: Callable[[dict[str, Any]], None]) -> bytes:
    """The file with other content, and a checksum that fits it."""
    document = json.loads(saved)
    change(document)
    document["sha256"] = 64 * "0"
    content = json.dumps(document).encode()
    checksum = hashlib.sha256(content).hexdigest().encode()
    return content.replace(64 * b"0", checksum, 1)


def test_a_planned_cycle_comes_back_bit_by_bit(plan: Plan, saved: bytes, file: Path) -> None:
    save_plan(plan, file)
    assert file.read_bytes() == saved
    loaded = load_plan(file)
    assert all(step.state is not None for step in loaded)
    assert same(loaded, plan)


@given(st.data())
@settings(max_examples=25)
def test_every_plan_comes_back_bit_by_bit(
    tmp_path_factory: pytest.TempPathFactory, manipulator: Manipulator, data: st.DataObject
) -> None:
    plan = data.draw(plans(manipulator))
    path = tmp_path_factory.getbasetemp() / "any plan.json"
    save_plan(plan, path)
    assert same(load_plan(path), plan)


def test_a_file_of_version_3_is_read_and_can_be_completed(manipulator: Manipulator) -> None:
    plan = load_plan(Path(__file__).parent / "data" / "plan_version_3.json")
    assert plan.is_valid
    assert plan.limb == "left"
    assert plan.q_start.tolist() == manipulator.arm.neutral.tolist()
    assert set(plan.start.scene.bodies) == {"table", "block"}
    found = verify(complete(plan, manipulator=manipulator))
    assert found.is_valid, found.verdict
    assert found["steps that state other bodies"].is_passed


def test_a_mesh_comes_back_bit_by_bit(plan: Plan, file: Path) -> None:
    mesh = Mesh(np.array([[0, 0, 0], [0.1, 0, 0], [0, 1 / 3, 0]]), np.array([[0, 1, 2]]))
    scene = Scene.of([Body("sheet", (Part(mesh, at(0, 0, 0)),), at(1, 2, 3))])
    save_plan(evolve(plan, start=State(scene, plan.start.joints)), file)
    loaded = load_plan(file)
    assert same(loaded.start.scene["sheet"], scene["sheet"])


def test_a_plan_file_is_small_enough_to_read(saved: bytes) -> None:
    assert len(saved) < 150_000
    lines = saved.splitlines()
    times = [len(line) for line in lines if line.lstrip().startswith(b'"knots_s"')]
    others = [len(line) for line in lines if not line.lstrip().startswith(b'"knots_s"')]
    assert max(others) < 250  # a row of seven joints
    assert max(times) < 1_000  # all times of a move, about forty


@given(st.data())
@settings(max_examples=30)
def test_a_truncated_file_is_refused(
    tmp_path_factory: pytest.TempPathFactory, saved: bytes, data: st.DataObject
) -> None:
    length = data.draw(st.integers(0, len(saved) - 1))
    refusal(tmp_path_factory.getbasetemp() / "cut.json", saved[:length])


@given(st.data())
@settings(max_examples=60)
def test_a_file_with_flipped_bits_is_refused(
    tmp_path_factory: pytest.TempPathFactory, saved: bytes, data: st.DataObject
) -> None:
    content = bytearray(saved)
    flips = data.draw(st.lists(st.integers(0, 8 * len(saved) - 1), min_size=1, unique=True))
    for flip in flips:
        content[flip // 8] ^= 1 << flip % 8
    refusal(tmp_path_factory.getbasetemp() / "flipped.json", bytes(content))


@given(st.binary(max_size=200) | st.text(max_size=200).map(str.encode))
def test_any_other_bytes_are_refused(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    refusal(tmp_path_factory.getbasetemp() / "noise.json", content)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | WORDS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=3),
    max_leaves=5,
)


def places(data: Any) -> list[tuple[Any, Any]]:
    """Every entry of nested data, as its container and key."""
    keys = data.keys() if isinstance(data, dict) else range(len(data))
    found = [(data, key) for key in keys]
    for key in keys:
        if isinstance(data[key], (dict, list)):
            found += places(data[key])
    return found


@pytest.mark.slow
@given(st.data())
@settings(max_examples=60)
def test_any_content_with_a_checksum_that_fits_is_a_plan_or_refused(
    tmp_path_factory: pytest.TempPathFactory, saved: bytes, data: st.DataObject
) -> None:
    def change(document: dict[str, Any]) -> None:
        container, key = data.draw(st.sampled_from(places(document["plan"])))
        container[key] = data.draw(JSON)

    path = tmp_path_factory.getbasetemp() / "forged.json"
    path.write_bytes(resealed(saved, change))
    try:
        loaded = load_plan(path)
    except PlannerError:
        return
    assert isinstance(loaded, Plan)


def put(*path: Any, value: Any) -> Callable[[dict[str, Any]], None]:
    """Sets one entry of a document."""

    def change(document: dict[str, Any]) -> None:
        container: Any = document
        for key in path[:-1]:
            container = container[key]
        container[path[-1]] = value

    return change


TRAJECTORY = ("plan", "steps", 1, "trajectory")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (put("format", value="other"), "is not a saved plan: its format is 'other'"),
        (lambda document: document.pop("format"), "is not a saved plan: its format is not stated"),
        (
            put("version", value=2),
            "has version 2, but only 4 and 3 are read here, which say for which robot",
        ),
        (put("version", value=True), "has version True"),
        (put("more", value=1), "has entries"),
        (put("plan", "limb", value="third"), "plan: unknown limb 'third'"),
        (put("plan", "limb", value=3), "plan.limb must be of type str, got 3"),
        (put("plan", "wheels", value=4), "plan has an entry 'wheels'; a Plan has: start"),
        (put("plan", "steps", value={}), "plan.steps must be a list"),
        (put("plan", "steps", 0, "type", value="os.system"), "has type 'os.system'; use one of"),
        (put("plan", "steps", 0, "action", value="WAVE"), "use one of: OPEN, CLOSE"),
        (
            put(*TRAJECTORY, "v", value=[[0.0], [0.0, 0.0]]),
            "v must be lists of numbers, in rows of one length",
        ),
        (put(*TRAJECTORY, "v", 0, value=["0.0"] * 7), "must be of type float, got '0.0'"),
        (put(*TRAJECTORY, "j", value={"shape": [0, 99999]}), "must be lists of numbers"),
        (put(*TRAJECTORY, "knots_s", value=[0.0]), "has shape"),
        (put("plan", "start", "joints", value=[]), "plan.start.joints must be an object"),
        (put("plan", "start", "joints", "head_pan", value=None), "must be of type float"),
    ],
)
def test_a_refusal_says_what_is_wrong(
    saved: bytes, file: Path, change: Callable[[dict[str, Any]], None], reason: str
) -> None:
    assert reason in refusal(file, resealed(saved, change))


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (b'"is_movable": true', b'"is_movable": false', "was changed after it was saved"),
        (b'"limb": "left"', b'"limb": "left", "limb": "left"', "has the entry 'limb' twice"),
        *(
            (b'"version": 4', b'"version": ' + number, "finite|too large")
            for number in (b"NaN", b"Infinity", b"-Infinity", b"1e999")
        ),
    ],
)
def test_an_edited_file_is_refused(
    saved: bytes, file: Path, old: bytes, new: bytes, reason: str
) -> None:
    assert saved.count(old) >= 1
    assert re.search(reason, refusal(file, saved.replace(old, new, 1)))


def test_other_files_are_refused(file: Path, tmp_path: Path) -> None:
    assert "nested too deeply" in refusal(file, 200_000 * b"[")
    with file.open("wb") as stream:
        stream.truncate(40 * 2**20)
    for path in (file, tmp_path, tmp_path / "none.json", "a\0b", 3, None):
        with pytest.raises(PlanFileError):
            load_plan(path)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        *(({"path": path}, None) for path in ("a\0b", 3, None)),
        ({"plan": {}}, "must be of class Plan"),
        *(
            ({"certificate": bad}, "certificate must be")
            for bad in ([1], np.zeros((3, 3)), {"a": {1}}, {"a": float("nan")})
        ),
    ],
)
def test_refuses_to_save_invalid_arguments(
    plan: Plan, file: Path, changes: dict[str, Any], reason: str | None
) -> None:
    with pytest.raises(PlanFileError, match=reason):
        save_plan(**{"plan": plan, "path": file, **changes})
    assert not file.exists()


def test_a_huge_plan_is_not_saved(plan: Plan, file: Path) -> None:
    grips = (Grip(34 * 2**20 * "x", GripperAction.OPEN),)
    with pytest.raises(PlanFileError, match="at most 32 MB are read again"):
        save_plan(evolve(plan, steps=grips), file)
    assert not file.exists()


def test_a_pipe_is_refused_without_waiting(plan: Plan, file: Path) -> None:
    os.mkfifo(file)
    with pytest.raises(PlanFileError, match="it is a pipe, not a regular file"):
        load_plan(file)
    with pytest.raises(PlanFileError, match="cannot be written: it is a pipe, not a regular file"):
        save_plan(plan, file)
    assert file.is_fifo()


def test_a_link_to_a_plan_stays_a_link(plan: Plan, tmp_path: Path, file: Path) -> None:
    (tmp_path / "link").symlink_to(file)
    save_plan(plan, tmp_path / "link")
    assert (tmp_path / "link").is_symlink()
    assert file.is_file()


def test_a_failed_write_keeps_the_old_file_and_leaves_nothing_behind(
    plan: Plan, saved: bytes, file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file.write_bytes(saved)

    def fail(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    (tmp_path / "folder").mkdir()
    with pytest.raises(PlanFileError, match="folder cannot be written"):
        save_plan(plan, tmp_path / "folder")
    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(PlanFileError, match="No space left on device"):
        save_plan(evolve(plan, failure=PlanFailure("a", "b")), file)
    assert file.read_bytes() == saved
    assert set(tmp_path.iterdir()) == {file, tmp_path / "folder"}


def test_values_that_are_not_finite_are_not_saved(plan: Plan, file: Path) -> None:
    move = evolve(plan.moves[0], clearance=Clearance(float("inf"), "a", "b"))
    steps = tuple(move if step is plan.moves[0] else step for step in plan)
    with pytest.raises(PlanFileError, match=r"clearance\.distance_m must be a finite number"):
        save_plan(evolve(plan, steps=steps), file)


def test_a_plan_too_large_is_neither_written_nor_read(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_plan(plan, tmp_path / "plan.json")
    monkeypatch.setattr(plan_file, "MAX_COUNTS", {**plan_file.MAX_COUNTS, "segments": 1})
    for action in (lambda f: save_plan(plan, f), load_plan):
        with pytest.raises(PlanFileError, match="segments; at most 1 can be checked"):
            action(tmp_path / "plan.json")
