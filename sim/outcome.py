"""The pauses in the execution of a plan, and its outcome."""

from __future__ import annotations

from baxter_kin.display import count, millimetres, phrase, seconds
from baxter_kin.fields import field, frozen, scalar
from sim.errors import SimulationError
from sim.world.contacts import Contact

ROBOT_DWELL_S = 1.0
"""Pause of a real arm before and after its gripper acts, as in the original demo. At speed ratio
0.3 it settles within 0.8 s, and the script that plays files back commands grippers at 20 Hz."""

MAX_DWELL_S = 60.0
"""Longer ones are mistakes."""


@frozen(error=SimulationError, eq=True)
class Dwell:
    """Pauses after gripper actions; none by default, where the original waits a second.

    Attributes:
        after_grasp_s: once both pads are on the body.
        after_release_s: once the fingers are open.
    """

    after_grasp_s: float = scalar(least=0.0, default=0.0)
    after_release_s: float = scalar(least=0.0, default=0.0)


@frozen(error=SimulationError, eq=True)
class Outcome:
    """How the execution of a plan ended.

    Attributes:
        failure: None, or why it stopped early, as one sentence.
        duration_s: its simulated duration.
        hits: what the arm, its hand or what it held ran into, in order, each at the depth at which
            it was first found. Bodies that give way stop no move, so a success may have some.
    """

    failure: str | None
    duration_s: float
    hits: tuple[Contact, ...] = field(default=(), kw_only=True)

    @property
    def is_success(self) -> bool:
        """Whether every step was executed."""
        return self.failure is None

    def _facts(self) -> tuple[str, ...]:
        failure = "success" if self.failure is None else f"failed: {self.failure}"
        return seconds(self.duration_s), failure, self._phrase_of_hits()

    def _phrase_of_hits(self) -> str:
        """The hits as a phrase, the deepest by name; empty without any."""
        if not self.hits:
            return ""
        worst = max(self.hits, key=lambda hit: hit.depth_m)
        names = f"{phrase(worst.mover)} {millimetres(worst.depth_m)} inside {phrase(worst.other)}"
        return f"{count(len(self.hits), 'hit')}: {names}"
