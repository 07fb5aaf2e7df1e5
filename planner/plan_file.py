"""Plan files: everything needed to execute a plan, or to verify it later on another machine.

A file is JSON, UTF-8, with five or six entries:

- `format`: "baxter-kin plan",
- `version`: 4; another number when the same entries get another meaning,
- `sha256`: the SHA-256 of the file's own bytes, with 64 zeros in place of these 64 digits,
- `plan`: the `Plan`, by the rules of `baxter_kin.files.json_data`: `start` (the scene, all joints,
  what the hands hold), `steps` (each a `Move` with its trajectory's knots and limits, its tip pose,
  IK result and claims, or a `Grip` with its limb; both with their contacts), `failure`, `robot`
  (which one the plan is for) and `response` (how that arm follows, and how the plan is sent to it,
  where it was made for such an arm). SI units, radians, poses seen from base,
- `states`: for each step, what of its state differs from that of the step before; empty for a plan
  that is not complete,
- `certificate`, optional: what `planner.certificate` checks the plan by.

Reading a file creates only these values and executes no code from it. Truncated or edited files are
refused, as are versions other than this one and the third, files that contain no plan, files larger
than `MAX_FILE_BYTES` and plans that exceed `MAX_COUNTS`. A file is replaced atomically.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import pinocchio as pin

from baxter_kin.display import shown_path
from baxter_kin.errors import FileError
from baxter_kin.fields import FrozenMapping, evolve
from baxter_kin.files import PathLike, open_to_read, replace_file
from baxter_kin.files.json_data import from_json, shown, to_json
from baxter_kin.files.json_text import Json, as_lines, from_text
from baxter_kin.kinematics.arm import JOINTS
from baxter_kin.validation import expect
from planner.errors import PlanFileError, PlannerError
from planner.plan import Plan
from planner.scene.bodies import Attachment
from planner.scene.mesh import Mesh
from planner.state import State

FORMAT = "baxter-kin plan"
VERSION = 4

MAX_FILE_BYTES = 32 * 2**20
"""Maximum size of a plan file; one pick and place takes 0.03 MB."""

MAX_COUNTS: Mapping[str, int] = FrozenMapping(
    {
        "steps": 1_000,
        "segments": 50_000,
        "bodies": 500,
        "parts": 2_000,
        "triangles": 500_000,
    }
)
"""Maximum size of a plan and its scene. One pick and place has 9 steps, 200 segments, 2 bodies of 4
parts. The cost of reading and checking a plan grows with these."""

NO_CHECKSUM = 64 * "0"
ENTRIES = ("format", "version", "sha256", "plan", "states")
CERTIFICATE = "certificate"


@dataclass(frozen=True, slots=True, eq=False)
class _Change:
    """Difference between two states."""

    joints: Mapping[str, float]
    T_base_bodies: Mapping[str, pin.SE3]
    attachments: tuple[Attachment, ...]

    @classmethod
    def between(cls, before: State, after: State) -> _Change:
        joints = {n: x for n, x in after.joints.items() if before.joints.get(n) != x}
        poses = {
            body.name: body.T_base_body
            for body in after.scene
            if body is not before.scene.bodies.get(body.name)
        }
        return cls(joints, poses, after.attachments)

    def of(self, state: State) -> State:
        """The state that results from a change of another."""
        scene = state.scene
        for name, T_base_body in self.T_base_bodies.items():
            scene = scene.moved(name, T_base_body)
        return State(scene, {**state.joints, **self.joints}, self.attachments)


_Changes: TypeAlias = tuple[_Change, ...]


def save_plan(plan: Plan, path: PathLike, *, certificate: Mapping[str, Json] | None = None) -> None:
    """Write a plan to a file, replacing an existing one.

    Args:
        plan: the plan.
        path: the file.
        certificate: the result of `planner.verification.certificate_of` for this plan.

    Raises:
        PlanFileError: when it cannot be written, or the plan contains something that a plan file
            cannot represent.
    """
    check_size(expect(plan, Plan, "plan", PlanFileError), plan.start, PlanFileError)
    write_document(plan_document(plan), path, certificate)


def write_document(
    document: dict[str, Json], path: PathLike, certificate: Mapping[str, Json] | None
) -> None:
    """Write the content of a plan file with its checksum; errors as of `save_plan`.

    Args:
        document: the entries, with `NO_CHECKSUM` as "sha256".
        path: the file.
        certificate: a further entry, or None.
    """
    if certificate is not None:
        document = {**document, CERTIFICATE: _json_of(certificate)}
    content = as_lines(document).encode() + b"\n"
    checksum = hashlib.sha256(content).hexdigest().encode()
    if len(content) > MAX_FILE_BYTES:
        raise PlanFileError(
            f"the plan would take {len(content) / 2**20:.1f} MB; at most "
            f"{MAX_FILE_BYTES >> 20} MB are read again: split it"
        )
    try:
        replace_file(path, content.replace(NO_CHECKSUM.encode(), checksum, 1))
    except FileError as cause:
        raise PlanFileError(f"{shown_path(path)} cannot be written: {cause.reason}") from cause


def _json_of(certificate: Mapping[str, Json]) -> Json:
    expect(certificate, Mapping, "certificate", PlanFileError)  # type: ignore[type-abstract]
    try:
        data: Json = json.loads(json.dumps(dict(certificate), allow_nan=False))
    except (TypeError, ValueError, RecursionError) as cause:
        raise PlanFileError(f"certificate must be JSON data, by certificate_of: {cause}") from cause
    return data


def plan_document(plan: Plan) -> dict[str, Json]:
    """The content of a plan file, without its checksum."""
    data = to_json(without_states(plan), Plan, "plan", PlanFileError)
    entries = (FORMAT, VERSION, NO_CHECKSUM, data, states_document(plan))
    return dict(zip(ENTRIES, entries, strict=True))


def without_states(plan: Plan) -> Plan:
    """The plan without the states of its steps."""
    return evolve(plan, steps=tuple(evolve(step, state=None) for step in plan))


def states_document(plan: Plan) -> Json:
    """What of each step's state differs from that of the step before."""
    states = [step.state for step in plan if step.state is not None]
    changes = tuple(map(_Change.between, (plan.start, *states), states))
    return to_json(changes, _Changes, "states", PlanFileError)


def load_plan(path: PathLike) -> Plan:
    """Read a plan from a file.

    A certificate in the file is not read: it is for `planner.certificate`, which needs nothing but
    the file, and `verify` finds its own.

    Raises:
        PlanFileError: when the file cannot be read, is damaged or edited, or contains no plan; says
            which, and what to do.
    """
    try:
        return _plan(content_of(path))
    except PlanFileError as cause:
        raise PlanFileError(f"{shown_path(path)}: {cause}") from cause


def check_size(plan: Plan, state: State, error: type[PlannerError]) -> None:
    """Raise `error` when a plan, or the scene of a state, exceeds `MAX_COUNTS`."""
    bodies = list(state.scene)
    parts = [part for body in bodies for part in body.parts]
    counts = {
        "steps": len(plan.steps),
        "segments": sum(len(move.trajectory.j) for move in plan.moves),
        "bodies": len(bodies),
        "parts": len(parts),
        "triangles": sum(len(p.shape.triangles) for p in parts if isinstance(p.shape, Mesh)),
    }
    for name, count in counts.items():
        if count > MAX_COUNTS[name]:
            raise error(
                f"the plan and its scene have {count} {name}; at most {MAX_COUNTS[name]} can be "
                "checked"
            )


def _plan(content: bytes) -> Plan:
    document = document_of(content, FORMAT, (VERSION, 3))
    if document["version"] == VERSION:
        plan: Plan = from_json(document["plan"], Plan, "plan", PlanFileError)
        plan = with_states(plan, document["states"], "states")
    else:
        plan = _of_version_3(document["plan"])
    check_size(plan, plan.start, PlanFileError)
    return plan


def document_of(content: bytes, kind: str, versions: tuple[int, ...]) -> dict[str, Json]:
    """The entries of a file of some format, whose checksum fits.

    Args:
        content: of the file.
        kind: the format.
        versions: that are read, the newest first; the third has no states and no certificate.
    """
    document = from_text(content, PlanFileError)
    if not isinstance(document, dict):
        raise PlanFileError(f"is not a saved plan, but {shown(document)}; save_plan writes one")
    if document.get("format") != kind:
        stated = shown(document["format"]) if "format" in document else "not stated"
        raise PlanFileError(f"is not a saved plan: its format is {stated}; save_plan writes one")
    version = document.get("version")
    if type(version) is not int or version not in versions:
        read = " and ".join(map(str, versions))
        raise PlanFileError(
            f"has version {shown(version)}, but only {read} are read here, which say for which "
            "robot the plan is: plan again with this version of the toolkit"
        )
    is_third = kind == FORMAT and version == 3
    entries = ENTRIES[:-1] if is_third else ENTRIES
    further = () if is_third else (CERTIFICATE,)
    if tuple(document) not in (entries, entries + further):
        raise PlanFileError(f"has entries {shown(list(document))}; it must have {list(entries)}")
    stated = str(document["sha256"])
    blank = content.replace(stated.encode(errors="replace"), NO_CHECKSUM.encode(), 1)
    if hashlib.sha256(blank).hexdigest() != stated:
        raise PlanFileError("was changed after it was saved, or damaged: its checksum does not fit")
    return document


def with_states(plan: Plan, data: Json, what: str) -> Plan:
    """A plan with the states of its steps, from what `states_document` made of them."""
    changes: _Changes = from_json(data, _Changes, what, PlanFileError)
    if not changes:
        return plan
    if len(changes) != len(plan.steps):
        raise PlanFileError(f"has {len(plan.steps)} steps, and the states of {len(changes)}")
    states = [plan.start]
    try:
        for change in changes[1:]:
            states.append(change.of(states[-1]))
    except PlannerError as cause:
        raise PlanFileError(f"{what}: {cause}") from cause
    steps = zip(plan.steps, states, strict=True)
    return evolve(plan, steps=tuple(evolve(step, state=state) for step, state in steps))


def _of_version_3(data: Any) -> Plan:
    """A plan of version 3: steps without states; limb and start beside a situation."""
    try:
        situation, limb = data["situation"], data["limb"]
        names = [f"{limb}_{joint}" for joint in JOINTS]
        held = [
            {"body": h["body"], "link": f"{h['side']}_gripper", "T_link_body": h["T_tip_body"]}
            for h in situation.get("held", ())
        ]
        joints = situation["joints"] | dict(zip(names, data["q_start"], strict=True))
        start = {"scene": situation["scene"], "joints": joints, "attachments": held}
        kept = {n: entry for n, entry in data.items() if n not in ("situation", "q_start")}
    except (AttributeError, KeyError, TypeError, ValueError) as cause:
        raise PlanFileError(
            "is of version 3 and does not say for which situation it was made; plan again"
        ) from cause
    plan: Plan = from_json(kept | {"start": start}, Plan, "plan", PlanFileError)
    return plan


def content_of(path: PathLike) -> bytes:
    """The bytes of a plan file."""
    try:
        with open_to_read(path) as stream:
            content = stream.read(MAX_FILE_BYTES + 1)
    except FileError as cause:
        raise PlanFileError(f"cannot be read: {cause.reason}") from cause
    except OSError as cause:
        raise PlanFileError(f"cannot be read: {cause.strerror}") from cause
    if len(content) > MAX_FILE_BYTES:
        raise PlanFileError(f"is larger than {MAX_FILE_BYTES >> 20} MB, so it is no plan")
    return content
