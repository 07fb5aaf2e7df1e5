"""Certificates in files of plans and of motions, and the check of one.

A plan file of version 4 may have an entry `certificate`:

- `version`: 1; the order of pairs and of letters is part of the format,
- `body`: SHA-256 of the file of clusters that it was made with,
- `steps`: for each step of the plan `margin_m`; for a hand that closes on a body `closing`: its
  opening when the first finger touches and at the end, and how far the body is pushed; and
  `contacts`: from when to when a held body may touch which other body,
- `letters`, `directions` and `fine`: of all rows, level by level and step by step. Bytes (three
  signed bytes for each direction; three signed numbers of two bytes, the lower first, for each fine
  one), compressed by zlib, in base64.

A motion that something else planned or recorded has a file of its own, `"format": "baxter-kin
motion"`. In it, `plan` has `limb`, `start` and `failure` as in a plan file, and one step of type
"Motion":

- `label`: its name in messages,
- `trajectory`: `knots_s`, n + 1 increasing times from 0, and `derivatives`: for each of the n
  pieces position, velocity and so on of the seven joints at its start, up to the fifth derivative,
- `is_timed`: whether these are the motion's real times, so that its velocities are judged,
- `a_max`, `j_max`: maximum accelerations and jerks, seven numbers, or null where not judged,
- `contacts`: the bodies (`body`) that the hand ("left hand" as `other`) or a held body may touch.

A plan of both arms on a common clock has the format "baxter-kin two-arm plan". In it, `plan` has
`start`, `plans` ("left" and "right", each as in a plan file), `begins_s` (when the steps of each
arm begin on the clock, s), `grip_s` (how long each gripper action takes on the clock, s) and
`failure`; `states` has those of each arm. Its certificate has an entry as above for each arm, in a
world without the other arm and without the bodies that only the other arm handles, and one,
`between`, whose steps are the windows of the clock (`planner.certificate.timeline.both_arms`).

A gripper action of a plan of both arms that opens may have a `receiver`: the other arm, which holds
the body then. The giver handles no body after that, and the receiver none before. The start of the
receiver's own plan states where the body is handed over; in both worlds it stands there, when the
giver has released it and before the receiver takes it.
"""

from __future__ import annotations

import base64
import binascii
import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from planner.certificate.body import Body
from planner.certificate.errors import NotCertifiedError, require
from planner.certificate.robot import OTHER_LIMB, Robot
from planner.certificate.rows import BY_MIDDLES, Advice, Trace, certified_m
from planner.certificate.timeline import MOTION, Limits, StepWitness, Timeline
from planner.certificate.timeline.both_arms import LIMBS, BothArms

PLAN_FORMAT, PLAN_VERSION = "baxter-kin plan", 4
MOTION_FORMAT, MOTION_VERSION = "baxter-kin motion", 1
TWO_ARM_FORMAT, TWO_ARM_VERSION = "baxter-kin two-arm plan", 1
VERSION = 1

BETWEEN = "between"
"""The part of a certificate of both arms that is about one arm against the other."""

MAX_PLAN_BYTES = 32 * 2**20
MAX_LETTERS = 2_000_000


@dataclass(frozen=True, eq=False)
class Witness:
    """The content of a certificate, which leads the checker; nothing of it is trusted.

    Attributes:
        body: SHA-256 of the file of clusters.
        steps: one for each step of the plan.
        trace: letters and directions of all rows.
    """

    body: str
    steps: tuple[StepWitness, ...]
    trace: Trace

    @classmethod
    def of_file(cls, data: Mapping[str, Any]) -> Witness:
        """Read the entry of a plan file.

        Raises:
            NotCertifiedError: when the entry is malformed.
        """
        try:
            require(data["version"] == VERSION, "the certificate has another version")
            steps = tuple(_step(each) for each in data["steps"])
            letters = np.frombuffer(_unpacked(data["letters"]), np.uint8).astype(np.intp)
            stated = (
                np.frombuffer(_unpacked(data[key]), kind).astype(np.float64).reshape(-1, 3)
                for key, kind in (("directions", "i1"), ("fine", "<i2"))
            )
            return cls(str(data["body"]), steps, Trace(letters, *stated))
        except (
            AttributeError,
            KeyError,
            TypeError,
            ValueError,
            OverflowError,
            zlib.error,
            binascii.Error,
        ) as cause:
            raise NotCertifiedError(f"the certificate is malformed: {cause!r}") from cause

    def require_of(self, body: Body) -> None:
        """Refuse a certificate of another body, or with margins that are no distances."""
        require(self.body == body.digest, "the certificate is of another body of the robot")
        is_distance = [0.0 <= step.margin_m < np.inf for step in self.steps]
        require(is_distance, "a margin is negative or not finite")

    def for_file(self) -> dict[str, Any]:
        """The entry of a plan file."""
        return {
            "version": VERSION,
            "body": self.body,
            "steps": [_step_for_file(each) for each in self.steps],
            "letters": _packed(self.trace.letters.astype("u1").tobytes()),
            "directions": _packed(self.trace.directions.astype("i1").tobytes()),
            "fine": _packed(self.trace.fine.astype("<i2").tobytes()),
        }


@dataclass(frozen=True)
class Certified:
    """The result of a successful check.

    Attributes:
        clearances_m: certified clearance at every instant by step, in order, m; inf where no pair
            counts. The first is of everything that stands still.
        numbers: the step of the plan that each of these belongs to, None for what stands still.
        rows: number of rows that were checked.
        bare: links of the robot without a shape, for which no clearance is certified.
        worst: upper bounds on other quantities by name, m and rad, each with where it occurs:
            "distance from line", "turn from line", "distance from path", "turn from path", "held
            bodies off their hands", "gap of closed pads", "slide in contact", "drop at release",
            and of both arms "distance of hands in one body" and "turn of hands in one body"; only
            those that the plan has.
        assumed: assumptions of the caller of a motion, as phrases.
        not_judged: quantities of a motion whose limits were not judged.
    """

    clearances_m: tuple[tuple[str, float], ...]
    numbers: tuple[int | None, ...]
    rows: int
    bare: tuple[str, ...]
    worst: Mapping[str, tuple[float, str]]
    assumed: tuple[str, ...] = ()
    not_judged: tuple[str, ...] = ()

    @property
    def clearance_m(self) -> float:
        """The smallest clearance of all steps, m."""
        return min((clear for _, clear in self.clearances_m), default=np.inf)


def read_plan(content: bytes) -> Mapping[str, Any]:
    """The document of a file of a plan or a motion.

    The checksum of a plan file is not compared, as nothing depends on it.

    Raises:
        NotCertifiedError: when the file contains neither.
    """
    require(len(content) <= MAX_PLAN_BYTES, f"more than {MAX_PLAN_BYTES >> 20} MB is no plan")
    try:
        document = json.loads(content)
    except (ValueError, RecursionError) as cause:
        raise NotCertifiedError(f"this is no plan file: {cause}") from cause
    require(isinstance(document, dict), "this is no plan file")
    kind = document.get("format"), document.get("version")
    known = {
        PLAN_FORMAT: PLAN_VERSION,
        MOTION_FORMAT: MOTION_VERSION,
        TWO_ARM_FORMAT: TWO_ARM_VERSION,
    }
    stated = ", ".join(f"{name!r} of version {version}" for name, version in known.items())
    require(kind in known.items(), f"this is none of: {stated}")
    found: Mapping[str, Any] = document
    return found


def check(
    document: Mapping[str, Any],
    urdf: str,
    *,
    body: Body | None = None,
    limits: Limits | None = None,
    certificate: Witness | None = None,
) -> Certified:
    """Certify a plan or a motion.

    Args:
        document: content of its file.
        urdf: text of the robot's URDF.
        body: the robot's body; that of the URDF with the package's clusters when not given.
        limits: maximum accelerations and jerks of plans; the presets when not given.
        certificate: the certificate; that of the file when not given.

    Raises:
        NotCertifiedError: when it is not certified; gives the reason.
    """
    if certificate is None:
        require("certificate" in document, "the file has no certificate")
        certificate = Witness.of_file(document["certificate"])
    body = Body(urdf) if body is None else body
    certificate.require_of(body)
    try:
        plan = document["plan"]
        _require_steps(document["format"] == MOTION_FORMAT, plan["steps"])
        robot = Robot(urdf, plan["limb"])
        states = document["states"]
        require(isinstance(states, list), "the states of the plan are malformed")
        timeline = Timeline(plan, states, robot, body, certificate.steps, limits=limits)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as cause:
        raise NotCertifiedError(f"the plan is malformed: {cause!r}") from cause
    return replace(
        _certified(timeline, body, certificate),
        worst=timeline.worst,
        assumed=tuple(timeline.assumed),
        not_judged=tuple(timeline.not_judged),
    )


def check_both(
    document: Mapping[str, Any],
    urdf: str,
    *,
    body: Body | None = None,
    limits: Limits | None = None,
    certificates: Mapping[str, Witness] | None = None,
) -> Mapping[str, Certified]:
    """Certify a plan of both arms on a common clock.

    Both hands must be empty at first. A gripper action must not take longer than the plan says, and
    whatever delays one arm must delay the other: the clock is assumed.

    Args:
        document: content of its file.
        urdf: text of the robot's URDF.
        body: the robot's body; that of the URDF with the package's clusters when not given.
        limits: maximum accelerations and jerks; the presets when not given.
        certificates: of "left", "right" and "between"; those of the file when not given.

    Returns:
        What is certified of "left" and "right", each without the other, and "between" both.

    Raises:
        NotCertifiedError: when it is not certified; gives the reason.
    """
    body = Body(urdf) if body is None else body
    try:
        if certificates is None:
            require("certificate" in document, "the file has no certificate")
            stated = document["certificate"]
            certificates = {part: Witness.of_file(stated[part]) for part in (*LIMBS, BETWEEN)}
        for each in certificates.values():
            each.require_of(body)
        plan = document["plan"]
        require(plan["failure"] is None, "the plan says itself that it failed")
        timelines = {
            side: Timeline(
                own["plan"],
                own["states"],
                Robot(urdf, side),
                body,
                certificates[side].steps,
                limits=limits,
                is_alone=True,
            )
            for side, own in alone(document).items()
        }
        margins = [step.margin_m for step in certificates[BETWEEN].steps]
        both = BothArms(timelines, plan["begins_s"], float(plan["grip_s"]), margins)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as cause:
        raise NotCertifiedError(f"the plan is malformed: {cause!r}") from cause
    parts: dict[str, Timeline | BothArms] = {**timelines, BETWEEN: both}
    found = {name: _certified(part, body, certificates[name]) for name, part in parts.items()}
    return {name: replace(found[name], worst=part.worst) for name, part in parts.items()}


def alone(document: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """For each arm, the document of its own plan in a world without the other's bodies.

    A body that both handle is in the worlds of both.

    Raises:
        NotCertifiedError: when a hand is not empty at first.
    """
    plan = document["plan"]
    start, bodies, found = plan["start"], plan["start"]["scene"]["bodies"], {}
    require(not start["attachments"], "a hand holds something at first")
    handled = {
        side: {step["body"] for step in plan["plans"][side]["steps"] if step["type"] == "Grip"}
        for side in LIMBS
    }
    given = {side: handed_over(plan["plans"][side]["steps"], side) for side in LIMBS}
    shared = handled["left"] & handled["right"]
    for side, other in (LIMBS, LIMBS[::-1]):
        own = plan["plans"][side]
        _require_steps(False, own["steps"])
        require(own["limb"] == side, f"the plan of the {side} arm is of the {own['limb']} arm")
        theirs = handled[other] - shared
        kept = {name: body for name, body in bodies.items() if name not in theirs}
        for name in given[other]:
            there = own["start"]["scene"]["bodies"][name]
            kept[name] = {**bodies[name], "T_base_body": there["T_base_body"]}
        world = {**start, "scene": {**start["scene"], "bodies": kept}}
        states = document["states"][side]
        require(isinstance(states, list), "the states of the plan are malformed")
        found[side] = {"plan": {**own, "start": world}, "states": states}
    return found


def handed_over(steps: Sequence[Mapping[str, Any]], side: str) -> set[str]:
    """The body that an arm hands over to the other one, at the end of what it handles; or none.

    Raises:
        NotCertifiedError: when it handles a body after that, or the receiver is not the other arm.
    """
    grips = [step for step in steps if step["type"] == "Grip" and step["body"] is not None]
    given = [step for step in grips if step.get("receiver")]
    if not given:
        return set()
    is_last = given == grips[-1:] and given[0]["action"] == "OPEN"
    require(is_last, f"the {side} arm handles a body after it has handed one over")
    receiver = given[0]["receiver"]
    require(receiver == OTHER_LIMB[side], f"the {side} arm hands a body over to {receiver!r}")
    return {given[0]["body"]}


def _certified(timeline: Timeline | BothArms, body: Body, certificate: Witness) -> Certified:
    """The clearances that a certificate shows of all steps of rows."""
    advice = Advice(certificate.trace)
    found = tuple(
        (step.label, certified_m(timeline.robot, timeline.clusters, step, advice))
        for step in timeline.steps
    )
    require(advice.is_used_up, "the certificate goes on after the plan")
    rows = int((certificate.trace.letters <= BY_MIDDLES).sum())
    return Certified(found, tuple(timeline.numbers), rows, body.bare, {})


def _require_steps(is_motion: bool, steps: Sequence[Mapping[str, Any]]) -> None:
    """A plan has no steps with assumed contacts; the file of a motion has one such step alone."""
    kinds = [step["type"] for step in steps]
    require(not is_motion or kinds == [MOTION], "this is no file of one motion")
    require(is_motion or MOTION not in kinds, f"a plan has no step of type {MOTION}")


def _step(data: Mapping[str, Any]) -> StepWitness:
    closing = data.get("closing")
    contacts = data.get("contacts", {})
    numbers = None if closing is None else tuple(float(x) for x in closing)
    require(numbers is None or len(numbers) == 3, "the closing of fingers has three numbers")
    windows = {str(name): (float(a), float(b)) for name, (a, b) in contacts.items()}
    every = [*(numbers or ()), *(x for window in windows.values() for x in window)]
    require(np.isfinite(every), "the certificate has a number that is not finite")
    return StepWitness(float(data["margin_m"]), numbers, windows)  # type: ignore[arg-type]  # three


def _step_for_file(step: StepWitness) -> dict[str, Any]:
    found: dict[str, Any] = {"margin_m": step.margin_m}
    if step.closing is not None:
        found["closing"] = list(step.closing)
    if step.contacts:
        found["contacts"] = {name: list(window) for name, window in step.contacts.items()}
    return found


def _packed(content: bytes) -> str:
    return base64.b64encode(zlib.compress(content, 9)).decode("ascii")


def _unpacked(text: Any) -> bytes:
    decoder = zlib.decompressobj()
    content = decoder.decompress(base64.b64decode(text, validate=True), MAX_LETTERS)
    if not decoder.eof:
        raise ValueError("cut off, or too long")
    return content
