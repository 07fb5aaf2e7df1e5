"""Plans in files: everything needed to execute one, or to verify it later on another machine.

The file is JSON, UTF-8, of four entries:

- `format`: "baxter-kin plan",
- `version`: 3; another number when the same entries get another meaning,
- `sha256`: the SHA-256 of the file's own bytes, with 64 zeros in place of these 64 digits,
- `plan`: the `Plan`, by the rules of `baxter_kin.json_data`: `limb`, `q_start`, `steps` (each a
  `Move` with its trajectory's knots and limits, its tip pose and IK result, or a `Grip`),
  `failure`, `situation` (the scene and all other joints), `robot` (which one the plan is for) and
  `response` (how that arm follows, and how the plan is sent to it, where it was made for such an
  arm). SI units, radians, poses seen from base.

Reading makes nothing but these values and runs nothing. A file that was truncated or edited is
refused, as are foreign versions, files that are no plan, files of more than `LARGEST_FILE_BYTES`
and plans of more than `MOST` of anything. A file is replaced at once or not at all.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

from baxter_kin.errors import FileError, shown_path
from baxter_kin.files import PathLike, open_to_read, replace_file
from baxter_kin.json_data import from_json, shown, to_json
from baxter_kin.json_text import as_lines, from_text
from baxter_kin.value_objects import FrozenMapping
from planner.errors import PlanFileError, PlannerError
from planner.plan import Plan
from planner.scene.mesh import Mesh
from planner.situation import Situation

FORMAT = "baxter-kin plan"
VERSION = 3

LARGEST_FILE_BYTES = 32 * 2**20
"""A plan of one pick and place takes 0.03 MB; a larger file than this holds something else."""

MOST: Mapping[str, int] = FrozenMapping(
    {
        "steps": 1_000,
        "segments": 50_000,
        "bodies": 500,
        "parts": 2_000,
        "triangles": 500_000,
    }
)
"""Greatest size of a plan and its scene. One pick and place has 9 steps, 200 segments, 2 bodies of
4 parts. What reading and checking a plan cost grows with these."""

_NO_CHECKSUM = 64 * "0"
_ENTRIES = ("format", "version", "sha256", "plan")


def save_plan(plan: Plan, path: PathLike) -> None:
    """Write a plan to a file, which is replaced when it exists.

    Raises:
        PlanFileError: when it cannot be written, or the plan holds something that has no place in a
            plan file.
    """
    if not isinstance(plan, Plan):
        raise PlanFileError(f"only a Plan can be saved, got {type(plan).__name__}")
    check_size(plan, plan.situation, PlanFileError)
    data = to_json(plan, Plan, "plan", PlanFileError)
    entries = (FORMAT, VERSION, _NO_CHECKSUM, data)
    content = as_lines(dict(zip(_ENTRIES, entries, strict=True))).encode() + b"\n"
    checksum = hashlib.sha256(content).hexdigest().encode()
    if len(content) > LARGEST_FILE_BYTES:
        raise PlanFileError(
            f"the plan would take {len(content) / 2**20:.1f} MB; at most "
            f"{LARGEST_FILE_BYTES >> 20} MB are read again: split it"
        )
    try:
        replace_file(path, content.replace(_NO_CHECKSUM.encode(), checksum, 1))
    except FileError as cause:
        raise PlanFileError(f"{shown_path(path)} cannot be written: {cause.reason}") from cause


def load_plan(path: PathLike) -> Plan:
    """The plan in a file.

    Raises:
        PlanFileError: when the file cannot be read, is damaged or edited, or holds no plan; says
            which and what to do.
    """
    try:
        return _plan(_content(path))
    except PlanFileError as cause:
        raise PlanFileError(f"{shown_path(path)}: {cause}") from cause


def check_size(plan: Plan, situation: Situation | None, error: type[PlannerError]) -> None:
    """Raise an error when a plan, or the scene of a situation, is larger than `MOST` says."""
    bodies = [] if situation is None else list(situation.scene)
    parts = [part for body in bodies for part in body.parts]
    counts = {
        "steps": len(plan.steps),
        "segments": sum(len(move.trajectory.j) for move in plan.moves),
        "bodies": len(bodies),
        "parts": len(parts),
        "triangles": sum(len(p.shape.triangles) for p in parts if isinstance(p.shape, Mesh)),
    }
    for name, count in counts.items():
        if count > MOST[name]:
            raise error(
                f"the plan and its scene have {count} {name}; at most {MOST[name]} can be checked"
            )


def _plan(content: bytes) -> Plan:
    document = from_text(content, PlanFileError)
    if not isinstance(document, dict):
        raise PlanFileError(f"is not a saved plan, but {shown(document)}; save_plan writes one")
    if document.get("format") != FORMAT:
        stated = shown(document["format"]) if "format" in document else "not stated"
        raise PlanFileError(f"is not a saved plan: its format is {stated}; save_plan writes one")
    if document.get("version") != VERSION or type(document["version"]) is not int:
        raise PlanFileError(
            f"has version {shown(document.get('version'))}, but only {VERSION} is read here, which "
            "says for which robot the plan is: plan again with this version of the toolkit"
        )
    if tuple(document) != _ENTRIES:
        raise PlanFileError(f"has entries {shown(list(document))}; it must have {list(_ENTRIES)}")
    stated = str(document["sha256"])
    blank = content.replace(stated.encode(errors="replace"), _NO_CHECKSUM.encode(), 1)
    if hashlib.sha256(blank).hexdigest() != stated:
        raise PlanFileError("was changed after it was saved, or damaged: its checksum does not fit")
    plan: Plan = from_json(document["plan"], Plan, "plan", PlanFileError)
    check_size(plan, plan.situation, PlanFileError)
    return plan


def _content(path: PathLike) -> bytes:
    try:
        with open_to_read(path) as stream:
            content = stream.read(LARGEST_FILE_BYTES + 1)
    except FileError as cause:
        raise PlanFileError(f"cannot be read: {cause.reason}") from cause
    except OSError as cause:
        raise PlanFileError(f"cannot be read: {cause.strerror}") from cause
    if len(content) > LARGEST_FILE_BYTES:
        raise PlanFileError(f"is larger than {LARGEST_FILE_BYTES >> 20} MB, so it is no plan")
    return content
