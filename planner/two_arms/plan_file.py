"""Files of plans of both arms: JSON with a checksum, as plan files (`planner.plan_file`).

The entries are `format` ("baxter-kin two-arm plan"), `version` (1), `sha256`, `plan` (the
`TwoArmPlan`), `states` ("left" and "right": for each step, what of its state differs from that of
the step before) and, optionally, `certificate`.
"""

from __future__ import annotations

from collections.abc import Mapping

from baxter_kin.display import shown_path
from baxter_kin.fields import evolve
from baxter_kin.files import PathLike
from baxter_kin.files.json_data import from_json, to_json
from baxter_kin.files.json_text import Json, from_text
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import expect
from planner.errors import PlanFileError
from planner.plan import Plan
from planner.plan_file import (
    ENTRIES,
    NO_CHECKSUM,
    check_size,
    content_of,
    document_of,
    load_plan,
    states_document,
    with_states,
    without_states,
    write_document,
)
from planner.two_arms.plan import TwoArmPlan

FORMAT, VERSION = "baxter-kin two-arm plan", 1


def save_two_arm_plan(
    plan: TwoArmPlan, path: PathLike, *, certificate: Mapping[str, Json] | None = None
) -> None:
    """Write a plan of both arms to a file, replacing an existing one.

    Args:
        plan: the plan.
        path: the file.
        certificate: the result of `planner.verification.certificate_of_both` for this plan.

    Raises:
        PlanFileError: when it cannot be written, or the plan contains something that a file cannot
            represent.
    """
    for own in expect(plan, TwoArmPlan, "plan", PlanFileError).plans.values():
        check_size(own, plan.start, PlanFileError)
    write_document(two_arm_document(plan), path, certificate)


def load_two_arm_plan(path: PathLike) -> TwoArmPlan:
    """Read a plan of both arms from a file.

    Raises:
        PlanFileError: when the file cannot be read, is damaged or edited, or contains no such plan;
            says which, and what to do.
    """
    try:
        return _plan(content_of(path))
    except PlanFileError as cause:
        raise PlanFileError(f"{shown_path(path)}: {cause}") from cause


def load_any_plan(path: PathLike) -> Plan | TwoArmPlan:
    """Read a plan of one arm or of both from a file, whichever it contains.

    Raises:
        PlanFileError: as `load_plan` and `load_two_arm_plan`.
    """
    try:
        document = from_text(content_of(path), PlanFileError)
    except PlanFileError as cause:
        raise PlanFileError(f"{shown_path(path)}: {cause}") from cause
    is_of_both = isinstance(document, dict) and document.get("format") == FORMAT
    return load_two_arm_plan(path) if is_of_both else load_plan(path)


def two_arm_document(plan: TwoArmPlan) -> dict[str, Json]:
    """The content of a file, without its checksum."""
    bare = {side: without_states(own) for side, own in plan.plans.items()}
    data = to_json(evolve(plan, plans=bare), TwoArmPlan, "plan", PlanFileError)
    states: Json = {side: states_document(own) for side, own in plan.plans.items()}
    return dict(zip(ENTRIES, (FORMAT, VERSION, NO_CHECKSUM, data, states), strict=True))


def _plan(content: bytes) -> TwoArmPlan:
    document = document_of(content, FORMAT, (VERSION,))
    plan: TwoArmPlan = from_json(document["plan"], TwoArmPlan, "plan", PlanFileError)
    states = document["states"]
    if not isinstance(states, dict) or set(states) != set(LIMBS):
        raise PlanFileError("states must be those of left and right")
    plans = {
        side: with_states(own, states[side], f"states of the {side} arm")
        for side, own in plan.plans.items()
    }
    for own in plans.values():
        check_size(own, plan.start, PlanFileError)
    return evolve(plan, plans=plans)
