"""What a certificate allows, each bound with its reason."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from baxter_kin.errors import expect
from baxter_kin.validation import finite_scalar
from baxter_kin.value_objects import OneLine
from planner.errors import TaskError
from planner.plan import Plan


@dataclass(frozen=True, slots=True, repr=False)
class Tolerances(OneLine):
    """How much of each is rounding, or what the toolkit promises; none is negative.

    Attributes:
        state: of q, v and a between what the jerks give and what the knots say, and between moves;
            rad, rad/s, rad/s^2. Rounding of cubics over seconds stays below.
        position_rad: how far a joint may be outside its range: the rounding of states.
        ratio: how far a limit may be exceeded by rounding, relative to it.
        tip_m: between a tip and where it was asked to be; what inverse kinematics promises.
        tip_rad: the same for its orientation.
        line_m: between the tip of a straight move and its line, 0.1 mm unless a plan states more.
        line_rad: the same for its orientation, 0.02 degrees.
        clearance_m: what all distances but those of allowed contacts must exceed.
        press_m: how deep an allowed contact may press.
        slide_m: how far a held body may move sideways while it still touches its support: it is
            lifted clear first.
        contact_m: below which distance two shapes count as touching: coal's accuracy, tenfold.
        finger_start_m: how far a finger may start outside its stroke, or apart from the other of
            its hand: the rounding of states.
        finger_m: between a closed finger and the body it holds.
        drop_m: from how high above its support a body may be let go.
    """

    state: float = 1e-8
    position_rad: float = 1e-8
    ratio: float = 1e-9
    tip_m: float = 1e-6
    tip_rad: float = 1e-6
    line_m: float = 1e-4
    line_rad: float = math.radians(0.02)
    clearance_m: float = 0.0
    press_m: float = 5e-4
    slide_m: float = 1e-3
    contact_m: float = 1e-5
    finger_start_m: float = 1e-8
    finger_m: float = 1e-5
    drop_m: float = 0.01

    @classmethod
    def of(cls, plan: Plan) -> Tolerances:
        """The toolkit's promises, off its lines those of a plan."""
        stated = expect(plan, Plan, "plan", TaskError).line_tolerance
        return cls(line_m=stated.position_m, line_rad=stated.rotation_rad)

    def __post_init__(self) -> None:
        for field in fields(self):
            if finite_scalar(getattr(self, field.name), field.name, TaskError) < 0.0:
                raise TaskError(f"tolerance {field.name} must not be negative")
