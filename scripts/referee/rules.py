"""What may touch what, and how close the rest may come.

By meaning, not by what a planner allows:
- Fingers and the body that they grasp: from the moment they close until they have opened again, and
  then they press by `PRESS_M` at most; on the straight line in and out by `BRUSH_M` at most.
- The rest of the hand and that body: never. A margin is not asked of the two on these lines, as
  how far into the hand a body reaches is chosen with the grasp.
- A held body and what carries it: from the grasp until it is lifted, and when it is put down.
- Nothing else. Contact is what is deeper than `CONTACT_M`.
- Links up to two joints apart, as palm and fingers of a hand, keep no margin, because how near they
  are is how the robot is built; they must not meet.
"""

from __future__ import annotations

from dataclasses import dataclass

CONTACT_M = 1e-5
BRUSH_M = 1e-4
PRESS_M = 5e-4
SLIDE_M = 1e-3
DROP_M = 1e-2


@dataclass(frozen=True)
class Rule:
    """What is asked of a pair.

    Attributes:
        deep_m: how deep they may be inside each other.
        margin_m: how far apart they must stay, if more is asked than not to touch.
        kind: what it is called when it is broken.
    """

    deep_m: float = CONTACT_M
    margin_m: float = 0.0
    kind: str = "touches"

    @property
    def needed_m(self) -> float:
        """The distance below which it is broken; 0 for an intersection."""
        return max(self.margin_m - CONTACT_M, 0.0)

    @property
    def erosion_m(self) -> float:
        """What is taken off one solid before they are compared."""
        return self.deep_m if self.needed_m == 0.0 else 0.0


FORBIDDEN = Rule()
BRUSHING = Rule(BRUSH_M, kind="brushes too deep")
PRESSING = Rule(PRESS_M, kind="presses too deep")


def apart(margin_m: float) -> Rule:
    """A margin is asked for, unless it is zero."""
    return Rule(margin_m=margin_m, kind="closer than the margin") if margin_m > 0.0 else FORBIDDEN
