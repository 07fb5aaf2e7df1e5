"""A planned cycle is certified; every change of plan, world or certificate is refused."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from planner import Plan, load_plan, save_plan
from planner.certificate.__main__ import main
from planner.certificate.body import Body
from planner.certificate.checking import Certified, Witness, check, read_plan
from planner.certificate.errors import NotCertifiedError
from planner.certificate.robot import Robot
from planner.certificate.rows import BY_MIDDLES, CUT_TIME
from planner.certificate.timeline import Timeline
from planner.verification import certificate_of
from planner.verification.witness import witness_of
from tests.planner.certificate.conftest import checked_alone

Data = dict[str, Any]
Change = Callable[[Data], None]

BODIES, TURN = ("plan", "start", "scene", "bodies"), ("T_base_body", "rotation")

UP = {"axis_x": 0.0, "axis_y": 0.0, "axis_z": 1.0, "max_tilt_rad": 0.2}
"""What a plan states of an axis that stays upright."""


TIGHT = 0.97
"""How much of the distance that the planner met is certified at least."""


@pytest.fixture(scope="module")
def certificate(planned: Plan) -> Any:
    return certificate_of(planned)


@pytest.fixture
def certified(document: Data, certificate: Any) -> Data:
    return {**document, "certificate": copy.deepcopy(certificate)}


def judged(document: Data, text: str, body: Body) -> Certified:
    return check(document, text, body=body)


def test_every_step_is_certified_to_nearly_what_its_proof_met(
    certified: Data, text: str, body: Body, planned: Plan
) -> None:
    found = dict(judged(certified, text, body).clearances_m)
    for step in planned:
        assert step.proof is not None
        assert found[step.label] >= TIGHT * step.proof.nearest.distance_m


def test_the_certificate_survives_its_file(
    planned: Plan, certificate: Any, text: str, tmp_path: Path
) -> None:
    path = tmp_path / "plan.json"
    save_plan(planned, path, certificate=certificate)
    assert len(json.dumps(certificate)) < 8_000
    assert load_plan(path).is_valid
    assert check(read_plan(path.read_bytes()), text).clearance_m > 0.0


def test_the_command_needs_numpy_alone(
    planned: Plan, certificate: Any, text: str, tmp_path: Path
) -> None:
    plan = tmp_path / "plan.json"
    save_plan(planned, plan, certificate=certificate)
    assert "certified: " in checked_alone(plan, text)


def test_the_command_refuses_in_one_sentence(
    saved: bytes, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan, urdf = tmp_path / "plan.json", tmp_path / "robot.urdf"
    plan.write_bytes(saved)
    urdf.write_text(text, "utf-8")
    assert main([str(plan), "--urdf", str(urdf)]) == 1
    assert capsys.readouterr().out == "not certified: the file has no certificate\n"
    assert main([str(tmp_path / "none.json"), "--urdf", str(urdf)]) == 2


# Attacks on the plan, with the certificate that it had


def step_of(document: Data, label: str) -> Data:
    found: Data = next(s for s in document["plan"]["steps"] if s["label"] == label)
    return found


def moves(document: Data) -> list[Data]:
    return [s["trajectory"] for s in document["plan"]["steps"] if s["type"] == "Move"]


def put(*path: Any, value: Any) -> Change:
    """Set an entry of a document."""

    def change(document: Data) -> None:
        container: Any = document
        for key in path[:-1]:
            container = container[key]
        container[path[-1]] = value

    return change


def faster(document: Data) -> None:
    for t in moves(document):
        t["knots_s"] = (np.array(t["knots_s"]) / 1.001).tolist()
        for key, power in (("v", 1), ("a", 2), ("j", 3)):
            t[key] = (np.array(t[key]) * 1.001**power).tolist()


def promising(key: str) -> Change:
    def change(document: Data) -> None:
        limits = moves(document)[1]["limits"]
        limits[key] = (0.05 * np.array(limits[key])).tolist()

    return change


def turned(joint: int, by: float) -> Change:
    """A joint of all moves, and of the start."""

    def change(document: Data) -> None:
        for t in moves(document):
            q = np.array(t["q"])
            q[:, joint] += by
            t["q"] = q.tolist()
        name = moves(document)[0]["limits"]["names"][joint]
        document["plan"]["start"]["joints"][name] += by

    return change


def without(label: str) -> Change:
    def change(document: Data) -> None:
        labels = [step["label"] for step in document["plan"]["steps"]]
        del document["plan"]["steps"][labels.index(label)]

    return change


def stating(label: str, **entries: Any) -> Change:
    return lambda document: step_of(document, label).update(entries)


def placed(name: str, by: tuple[float, float, float]) -> Change:
    def change(document: Data) -> None:
        T = document["plan"]["start"]["scene"]["bodies"][name]["T_base_body"]
        T["translation"] = (np.array(T["translation"]) + by).tolist()

    return change


def with_box(at: tuple[float, float, float], size: tuple[float, float, float]) -> Change:
    def change(document: Data) -> None:
        still = {"rotation": np.eye(3).tolist(), "translation": [0.0, 0.0, 0.0]}
        shape = {"type": "Box", "size_m": list(size)}
        document["plan"]["start"]["scene"]["bodies"]["box"] = {
            "name": "box",
            "parts": [{"shape": shape, "T_body_part": still}],
            "is_movable": False,
            "T_base_body": {"rotation": np.eye(3).tolist(), "translation": list(at)},
        }

    return change


def hanging_on(link: str) -> Change:
    """The block hangs on a link from the start."""

    def change(document: Data) -> None:
        still = {"rotation": np.eye(3).tolist(), "translation": [0.0, 0.0, 0.3]}
        held = {"body": "block", "link": link, "T_link_body": still}
        document["plan"]["start"]["attachments"] = [held]

    return change


def touching(body: str, other: str, **entries: Any) -> Change:
    def change(document: Data) -> None:
        contacts = step_of(document, "pick: retract")["contacts"]
        contacts[0] |= {"body": body, "other": other, **entries}

    return change


def in_the_other_hand(link: str, at_m: tuple[float, float, float]) -> Change:
    """A marble that hangs on the right hand, with its middle on a link."""

    def change(document: Data) -> None:
        robot = Baxter.load()
        start = document["plan"]["start"]
        q = robot.configuration(start["joints"])
        T_link, T_hand = (frame_pose(robot, q, name) for name in (link, "right_gripper"))
        seen = T_link * pin.SE3(np.eye(3), np.array(at_m))
        T = T_hand.inverse() * seen
        still = {"rotation": np.eye(3).tolist(), "translation": [0.0, 0.0, 0.0]}
        start["scene"]["bodies"]["marble"] = {
            "name": "marble",
            "parts": [{"shape": {"type": "Sphere", "radius_m": 0.001}, "T_body_part": still}],
            "is_movable": True,
            "T_base_body": {
                "rotation": seen.rotation.tolist(),
                "translation": seen.translation.tolist(),
            },
        }
        place = {"rotation": T.rotation.tolist(), "translation": T.translation.tolist()}
        start["attachments"] = [{"body": "marble", "link": "right_gripper", "T_link_body": place}]
        document["states"] = []

    return change


def frame_pose(robot: Baxter, q: Any, name: str) -> pin.SE3:
    model = robot.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[model.getFrameId(name)]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (faster, "beyond"),
        (promising("v_max"), "velocity beyond"),
        (promising("a_max"), "acceleration beyond"),
        (promising("j_max"), "jerk beyond"),
        (turned(0, 0.0014), "tip ends elsewhere"),
        (turned(6, 2e-6), "tip ends elsewhere"),
        (without("pick: close"), "other steps"),
        (stating("pick: close", body="table"), "contact of block and left hand is not meant"),
        (stating("place: open", opening_m=0.03), "do not open so"),
        (stating("place: open", opening_m=0.001), "do not open so"),
        (stating("place: open", body="table"), "holds block"),
        (stating("pick: approach", is_straight=True), "off its way"),
        (stating("pick: approach", type="Dance"), "unknown kind"),
        (placed("block", (0.0, 0.001, 0.0)), "mm"),
        (placed("block", (0.0, 0.0, -0.001)), "mm"),
        (placed("table", (0.0, 0.0, 0.05)), "mm"),
        (with_box((0.72, 0.075, -0.05), (0.02, 0.02, 0.25)), "proven only|too soon|cut"),
        (hanging_on("left_upper_elbow"), "no hand"),
        (hanging_on("left_gripper"), "mm off the hand"),
        (hanging_on("no link"), "no link"),
        (lambda d: put("q", 3, 2, value=float("nan"))(moves(d)[0]), "not finite"),
        (put(*BODIES, "table", *TURN, value=np.diag([1.0, -1.0, 1.0]).tolist()), "reflection"),
        (touching("x", "table"), "not meant"),
        (touching("block", "right hand"), "not meant"),
        (touching("block", "left hand"), "not meant"),
        (touching("block", "table", part=7), "not meant"),
        (touching("block", "table", least_m=-6e-4), "too deep"),
        (touching("block", "table", end_s=9.0), "longer than the step"),
        (stating("place: approach", claims=[{"kind": "polite", "values": {}}]), "claim"),
        *(
            (stating(label, claims=[{"kind": "upright", "values": values}]), reason)
            for label, values, reason in (
                ("place: approach", {}, "in another way"),
                ("place: approach", UP | {"axis_w": 0.0}, "in another way"),
                ("place: approach", UP | {"axis_z": 1.001}, "no upright axis"),
                ("place: approach", UP | {"axis_z": 0.0}, "no upright axis"),
                ("place: approach", UP | {"max_tilt_rad": -0.1}, "no upright axis"),
                ("place: approach", UP | {"max_tilt_rad": 4.0}, "no upright axis"),
                ("place: approach", UP | {"max_tilt_rad": 0.01}, "leans by up to"),
                ("place: approach", UP | {"axis_z": -1.0}, "leans by up to 180"),
                ("place: approach", UP | {"axis_x": 1.0, "axis_z": 0.0}, "leans by up to"),
                ("pick: approach", UP, "not in the hand"),
                ("place: retract", UP, "not in the hand"),
            )
        ),
        (put("plan", "failure", value={"stage": "pick"}), "failed"),
        (put("states", 3, "joints", "left_s0", value=0.5), "stated elsewhere"),
    ],
)
def test_a_plan_that_was_changed_is_refused(
    certified: Data, text: str, body: Body, change: Change, reason: str
) -> None:
    change(certified)
    with pytest.raises(NotCertifiedError, match=reason):
        judged(certified, text, body)


# Attacks on the world, with a certificate that is sought anew


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (placed("table", (0.0, 0.0, -0.015)), "does not stand on table"),
        (placed("table", (0.0, 0.0, 0.001)), "table"),
        (placed("block", (0.0, 0.0, -0.001)), "table"),
        (with_box((0.72, 0.075, 0.0), (0.3, 1e-5, 0.3)), "box"),
        (with_box((0.0, -0.35, 0.3), (0.2, 0.2, 0.2)), "box and links on right"),
        (in_the_other_hand("left_upper_elbow", (0.0, 0.0, -0.05)), "inside of a link and marble"),
        (in_the_other_hand("pedestal", (0.0, 0.0, 0.3)), "inside of a link and marble"),
    ],
)
def test_no_certificate_is_found_for_a_world_in_the_way(
    certified: Data, text: str, body: Body, change: Change, reason: str
) -> None:
    change(certified)
    witness = Witness.of_file(certified["certificate"])
    steps = tuple(evolve(step, margin_m=0.0) for step in witness.steps)
    robot = Robot(text, "left")
    with pytest.raises(NotCertifiedError, match=reason):
        witness_of(Timeline(certified["plan"], (), robot, body, steps), body.digest, steps)


def test_a_floor_may_be_around_the_foot_of_the_robot(
    certified: Data, text: str, body: Body
) -> None:
    """What never moves was believed to collide."""
    with_box((0.0, 0.0, -0.95), (1.0, 1.0, 0.1))(certified)
    steps = Witness.of_file(certified["certificate"]).steps
    timeline = Timeline(certified["plan"], (), Robot(text, "left"), body, steps)
    assert witness_of(timeline, body.digest, steps).trace.letters.size > 0


def test_a_body_held_at_first_may_not_reach_into_the_palm(
    document: Data, text: str, body: Body
) -> None:
    """It was believed to be enough that the pads are on it."""
    plan, robot = document["plan"], Robot(text, "left")
    start, at_lift = plan["start"], document["states"][:5]
    for change in at_lift:
        start["joints"] |= change["joints"]
    start["attachments"] = at_lift[-1]["attachments"]
    plan["steps"] = []
    held = Timeline(plan, (), robot, body, ())
    assert len(witness_of(held, body.digest, ()).trace.letters) > 0
    shape = start["scene"]["bodies"]["block"]["parts"][0]["shape"]
    shape["size_m"] = [*shape["size_m"][:2], 0.3]
    with pytest.raises(NotCertifiedError, match="block and links of left_w2"):
        witness_of(Timeline(plan, (), robot, body, ()), body.digest, ())


# Attacks on the certificate


def told(**entries: Any) -> Callable[[Witness], Witness]:
    return lambda witness: evolve(witness, **entries)


def at_step(number: int, **entries: Any) -> Callable[[Witness], Witness]:
    def change(witness: Witness) -> Witness:
        steps = list(witness.steps)
        steps[number] = evolve(steps[number], **entries)
        return evolve(witness, steps=tuple(steps))

    return change


def closing(number: int, by: tuple[float, float, float]) -> Callable[[Witness], Witness]:
    def change(witness: Witness) -> Witness:
        found = witness.steps[number].closing
        assert found is not None
        moved = tuple(float(x) for x in np.add(found, by))
        return at_step(number, closing=moved)(witness)

    return change


def traced(**changes: Callable[[Any], Any]) -> Callable[[Witness], Witness]:
    """Change columns of the trace."""

    def change(witness: Witness) -> Witness:
        columns = {name: by(getattr(witness.trace, name)) for name, by in changes.items()}
        return evolve(witness, trace=evolve(witness.trace, **columns))

    return change


CLOSE = 3
LIFT = 4


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (traced(directions=lambda n: -n), "proven only"),
        (traced(directions=lambda n: 0.0 * n), "proven only"),
        (traced(directions=lambda n: np.nan * n), "proven only"),
        (traced(directions=lambda n: n[:-1]), "too soon"),
        (traced(fine=lambda _: np.ones((1, 3))), "goes on"),
        (traced(letters=lambda x: x[:-5]), "too soon"),
        (traced(letters=lambda x: np.append(x, BY_MIDDLES)), "goes on"),
        (traced(letters=lambda x: np.full_like(x, BY_MIDDLES)), "proven only|goes on"),
        (traced(letters=lambda _: np.full(10**6, CUT_TIME)), "too short|more rows|soon"),
        (traced(letters=lambda x: 0 * x + 7), "malformed"),
        (told(body="0" * 64), "another body"),
        (told(steps=()), "other steps"),
        (at_step(1, margin_m=0.1), "proven only"),
        (at_step(1, margin_m=-0.1), "negative"),
        (at_step(CLOSE, closing=None), "how the fingers close"),
        (at_step(LIFT, contacts={"table": (0.0, 1e-4)}), "proven only|soon|cut|goes on"),
        (at_step(LIFT, contacts={"table": (0.1, 0.2)}), "out of turn"),
        (at_step(LIFT, contacts={"nothing": (0.0, 0.01)}), "no contact"),
        (at_step(1, contacts={"table": (0.0, 0.01)}), "no contact"),
        (closing(CLOSE, (1.0, 0.0, 0.0)), "do not close so"),
        (closing(CLOSE, (0.0, 2e-5, 0.0)), "mm from block|do not close so"),
        (closing(CLOSE, (0.0, -1e-3, 0.0)), "fingers are stated"),
        (closing(CLOSE, (0.0, 0.0, 2e-3)), "mm from block|proven only"),
    ],
)
def test_a_certificate_that_was_changed_is_refused(
    certified: Data,
    text: str,
    body: Body,
    change: Callable[[Witness], Witness],
    reason: str,
) -> None:
    witness = change(Witness.of_file(certified["certificate"]))
    with pytest.raises(NotCertifiedError, match=reason):
        check(certified, text, body=body, certificate=witness)


def test_a_certificate_of_other_types_is_malformed(certified: Data, text: str, body: Body) -> None:
    certified["certificate"]["steps"][5] = []
    with pytest.raises(NotCertifiedError, match="malformed"):
        judged(certified, text, body)


@pytest.mark.slow
def test_random_letters_and_directions_certify_nothing_false(
    certified: Data, text: str, body: Body
) -> None:
    """A changed row may still hold; then what is certified is no more than before."""
    rng, witness = np.random.default_rng(1), Witness.of_file(certified["certificate"])
    whole = judged(certified, text, body).clearance_m
    for _ in range(4):
        letters, directions = witness.trace.letters.copy(), witness.trace.directions.copy()
        if rng.random() < 0.6:
            letters[rng.integers(len(letters))] = rng.integers(0, 6)
        else:
            directions[rng.integers(len(directions))] = rng.integers(-127, 128, 3)
        trace = evolve(witness.trace, letters=letters, directions=directions)
        changed = evolve(witness, trace=trace)
        try:
            found = check(certified, text, body=body, certificate=changed)
        except NotCertifiedError:
            continue
        assert found.clearance_m <= whole + 0.02


@pytest.mark.parametrize(
    ("pattern", "instead", "reason"),
    [
        ('xyz="0.102 0.0 0.0"', 'xyz="0.103 0.0 0.0"', "elsewhere|mm"),
        ("paddle_tip", "unknown_tip", "unknown_tip"),
    ],
)
def test_another_robot_is_refused(
    certified: Data, text: str, pattern: str, instead: str, reason: str
) -> None:
    changed = text.replace(pattern, instead)
    if changed == text:
        pytest.fail(f"the URDF has no {pattern}")
    with pytest.raises(NotCertifiedError, match=reason):
        check(certified, changed)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "no plan file"),
        (b"[1, 2]", "no plan file"),
        (b"{}", "version 4"),
        (b"[" * 100_000, "no plan file"),
        (b'{"format": "baxter-kin plan", "version": 3}', "version 4"),
    ],
)
def test_other_files_are_refused(content: bytes, reason: str) -> None:
    with pytest.raises(NotCertifiedError, match=reason):
        read_plan(content)


@pytest.mark.parametrize("key", ["plan", "states", "certificate"])
def test_a_plan_file_of_odd_entries_is_refused(
    certified: Data, text: str, body: Body, key: str
) -> None:
    for odd in (None, 5, "text", [], {}, [[1]], {"steps": 1}):
        if key == "states" and odd == []:
            continue  # then nothing is stated
        with pytest.raises(NotCertifiedError):
            judged({**certified, key: odd}, text, body)
