"""What the user of the demo asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from baxter_kin.description import HandMount

DEFAULT_POSES_M = ((0.70, 0.15, -0.129), (0.75, 0.00, -0.129))
"""Block poses of the original demo, for its left arm; y is mirrored for the right one."""

LIMITS = ("safe", "torque-control")
ROBOT_DWELL_S, LONGEST_DWELL_S = 1.0, 60.0
"""As `baxter_kin.limits.PRESETS` and `sim.outcome` have them, which load NumPy."""


@dataclass(frozen=True, slots=True)
class DemoOptions:
    """What the user asked for.

    Attributes:
        urdf: the robot's own description, or None for the stock robot.
        hands: what is on the flanges, by side; a side that is absent is as the URDF says.
        limb: "left" or "right".
        poses_m: block poses: tip positions in base, visited in turn.
        hover_m: height above the place where a cycle ends; the arm moves sideways above 5 cm, or
            above this where it is less.
        obstacles_m: boxes in the way: centre in base and size, x, y, z each.
        margin_m: distance that is kept from everything, contacts on purpose left out.
        line_tolerance: how far the tip may be off its straight lines, m and rad.
        noise_m: standard deviation of where the block is seen, along each axis of base.
        noise_rad: standard deviation of the yaw that it is seen with.
        retries: how many attempts follow a missed one; None goes by the scene as it is, in one.
        seed: of the noise.
        cycles: number of picks and places; None goes on until stopped.
        speed_ratio: scale of the velocity limits, in (0, 1].
        limits: preset of accelerations and jerks.
        is_headless: without the live view, as fast as possible.
        opens_browser: whether to open it in a browser, where there is one.
        wait_s: how long to wait for a page that watches.
        port: where to serve it; None for any that is free.
        html: where to write the replay, or None.
        shows_body: whether the replay can show the body that is planned with, too.
        csv: where to write the RSDK's CSV, or None.
        dwell_s: how long that lets the arm stand before and after gripper actions, for a robot to
            play it back; None for what the simulation did.
        record: where to write everything that happened, or None; the format by its suffix, one of
            `RECORD_SUFFIXES`.
        report: where to write the JSON report, or None.
        plan: where to save the plan of the first cycle, or None.
        verbosity: 0 quiet, 1 normal, 2 with every event.
    """

    urdf: Path | None
    hands: Mapping[str, HandMount]
    limb: str
    poses_m: tuple[tuple[float, float, float], ...]
    hover_m: float
    obstacles_m: tuple[tuple[float, ...], ...]
    margin_m: float
    line_tolerance: tuple[float, float]
    noise_m: float
    noise_rad: float
    retries: int | None
    seed: int
    cycles: int | None
    speed_ratio: float
    limits: str
    is_headless: bool
    opens_browser: bool
    wait_s: float
    port: int | None
    html: Path | None
    shows_body: bool
    csv: Path | None
    dwell_s: float | None
    record: Path | None
    report: Path | None
    plan: Path | None
    verbosity: int

    @property
    def is_closed_loop(self) -> bool:
        """Whether the block is looked for before every pick, and picked again when missed."""
        return self.retries is not None
