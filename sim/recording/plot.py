"""Plots of recordings and of comparisons with plans. The only module that imports Matplotlib.

Of a recording, every joint of an arm is drawn against its limits: one column for each joint;
position, velocity, acceleration and jerk below each other. Only the object-oriented interface is
used, so no window is opened and no global state is touched.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from baxter_kin import Baxter, JointLimits
from baxter_kin.distribution.extras import run_to_install_extra
from baxter_kin.errors import UnknownNameError
from baxter_kin.kinematics.arm import LIMBS, arm_joints
from baxter_kin.validation import FloatArray, expect
from sim.errors import RecordingError
from sim.events import Event, EventKind
from sim.recording.comparison import Comparison
from sim.recording.recorded_motion import ArmMotion
from sim.recording.recording import Recording

if TYPE_CHECKING:  # an extra
    from matplotlib.figure import Figure

SIZE_INCH = (21.0, 9.5)
"""Size of the figure of one arm."""

STILL_RAD = 2e-3
"""Maximum range of the joints of an arm that stands still; real encoders are no quieter."""

STILL_RATE = 1e-6
"""Maximum rates of an arm that stands still, rad/s, rad/s^2 and rad/s^3: rounding."""

MAX_VIEW = 2.5
"""Maximum range of a panel without its margin, as a multiple of the limits' range: differences of
noisy positions are large."""

MARGIN = 0.12
"""Share of the limits' range that is shown beyond them."""

EXACT_COLOUR = "#1f5fa8"
DIFFERENCE_COLOUR = "#8fb3d9"
LIMIT_COLOUR = "#b03030"

_MARKS = {
    EventKind.GRASPED: "#2a9d4a",
    EventKind.RELEASED: "#e08a1e",
    EventKind.MISSED: "#d02060",
}
"""Events that are marked, with their colours."""

MAX_LABELS = 6
"""Maximum number of marks with text, which could not be read otherwise; the legend has it, too."""


MAX_LINE_S = 0.2
"""Maximum time between two samples that a line joins."""

_ROWS = {
    "q": "position [rad]",
    "v": "velocity [rad/s]",
    "a": "acceleration [rad/s²]",
    "j": "jerk [rad/s³]",
}
"""Labels of the rows of panels, by the quantity's name in `ArmMotion`."""


def plot_recording(
    recording: Recording, limb: str | None = None, *, limits: JointLimits | None = None
) -> Figure:
    """Position, velocity, acceleration and jerk of each joint against its limits.

    Args:
        recording: the recording to draw.
        limb: "left" or "right"; when not given, those that moved.
        limits: of that arm; when not given, those of the recorded moves, or else the robot's.

    Returns:
        A figure of Matplotlib; nothing is opened, `figure.savefig("motion.png")` keeps it.

    Raises:
        UnknownNameError: when there is no such limb.
        RecordingError: when Matplotlib is missing, the limits are not those of that arm, or its
            joints were not recorded.
    """
    expect(recording, Recording, "recording", RecordingError)
    limbs = _limbs(recording, limb, limits)
    motions = [recording.motion(side, with_knots=True) for side in limbs]
    figure = _new_figure(len(limbs))
    parts = figure.subfigures(len(limbs), 1, squeeze=False)[:, 0]
    for part, side, motion in zip(parts, limbs, motions, strict=True):
        bounds = _in_order(_limits(recording, side) if limits is None else limits, side)
        _draw_arm(part, recording, motion, bounds, side)
    return figure


def _limbs(recording: Recording, limb: object, limits: JointLimits | None) -> tuple[str, ...]:
    """The arms to draw."""
    if limb is not None:
        if not isinstance(limb, str) or limb not in LIMBS:
            raise UnknownNameError("limb", limb, LIMBS)
        return (limb,)
    if limits is not None:
        names = sorted(expect(limits, JointLimits, "limits", RecordingError).names)
        fitting = tuple(side for side in LIMBS if sorted(arm_joints(side)) == names)
        if not fitting:
            raise RecordingError(f"limits of {', '.join(limits.names)} are not those of an arm")
        return fitting
    moved = [side for side in LIMBS if np.ptp(recording.motion(side).q, axis=0).max() > STILL_RAD]
    return tuple(moved) or LIMBS


def _limits(recording: Recording, limb: str) -> JointLimits:
    """The widest of those that the moves of the arm were made for, or else the robot's."""
    own = [move.trajectory.limits for move in recording.moves if move.limb == limb]
    if not own:
        return Baxter.load().arm(limb).limits
    ordered = [_in_order(limits, limb) for limits in own]
    return JointLimits(
        arm_joints(limb),
        q_min=np.min([limits.q_min for limits in ordered], axis=0),
        q_max=np.max([limits.q_max for limits in ordered], axis=0),
        v_max=np.max([limits.v_max for limits in ordered], axis=0),
        a_max=np.max([limits.a_max for limits in ordered], axis=0),
        j_max=np.max([limits.j_max for limits in ordered], axis=0),
    )


def _in_order(limits: JointLimits, limb: str) -> JointLimits:
    names = arm_joints(limb)
    known = expect(limits, JointLimits, "limits", RecordingError).names
    if sorted(known) != sorted(names):
        raise RecordingError(f"limits of {', '.join(known)} are not those of the {limb} arm")
    order = [known.index(name) for name in names]
    arrays = (limits.q_min, limits.q_max, limits.v_max, limits.a_max, limits.j_max)
    q_min, q_max, v_max, a_max, j_max = (array[order] for array in arrays)
    return JointLimits(names, q_min, q_max, v_max, a_max, j_max)


def _new_figure(arms: int) -> Figure:
    try:
        from matplotlib.figure import Figure  # noqa: PLC0415 - an extra
    except ImportError as cause:
        raise RecordingError(
            f"drawing needs the package matplotlib; {run_to_install_extra('plot')}"
        ) from cause
    width, height = SIZE_INCH
    return Figure(figsize=(width, arms * height), layout="constrained", facecolor="white")


def _draw_arm(
    part: Any, recording: Recording, motion: ArmMotion, limits: JointLimits, limb: str
) -> None:
    events = [event for event in recording.events if event.kind in _MARKS]
    known = _known(motion)
    panels = part.subplots(len(_ROWS), len(motion.joint_names), sharex=True)
    for (key, label), axes_of_row in zip(_ROWS.items(), panels, strict=True):
        low, high = _bounds(key, limits)
        for i, axes in enumerate(axes_of_row):
            _draw_panel(axes, motion, key, i, (float(low[i]), float(high[i])), known=known)
            _draw_marks(axes, events)
        axes_of_row[0].set_ylabel(label)
    for axes, name in zip(panels[0], motion.joint_names, strict=True):
        axes.set_title(name, fontsize=11, fontweight="bold", pad=8)
    if len(events) <= MAX_LABELS:
        for axes in panels[0]:
            _draw_labels(axes, events)
    for axes in panels[-1]:
        axes.set_xlabel("time [s]")
    panels[0, 0].set_xlim(*_time_range(recording))
    part.suptitle(_title(recording, limb), fontsize=14, fontweight="bold")
    part.legend(*_legend(motion, known, events), loc="outside lower center", ncols=6, frameon=False)


def _draw_panel(
    axes: Any,
    motion: ArmMotion,
    key: str,
    joint: int,
    bounds: tuple[float, float],
    *,
    known: NDArray[np.bool_],
) -> None:
    values: FloatArray = getattr(motion, key)[:, joint]
    style = "steps-post" if key == "j" else "default"  # jerks are piecewise constant
    for mask, colour in ((_widened(~known), DIFFERENCE_COLOUR), (known, EXACT_COLOUR)):
        shown = np.where(mask, values, np.nan)
        axes.plot(motion.times_s, shown, color=colour, linewidth=1.3, drawstyle=style, zorder=3)
    for bound in bounds:
        axes.axhline(bound, color=LIMIT_COLOUR, linewidth=1.0, linestyle=(0, (5, 3)), zorder=2)
    axes.set_ylim(*_view(values, *bounds))
    axes.grid(visible=True, color="#e6e6e6", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)


def _draw_marks(axes: Any, events: list[Event]) -> None:
    for event in events:
        axes.axvline(event.time_s, color=_MARKS[event.kind], linewidth=1.1, zorder=1)


def _draw_labels(axes: Any, events: list[Event]) -> None:
    """What happened, upright beside its mark."""
    for event in events:
        axes.annotate(
            event.kind.value,
            (event.time_s, 0.14),
            xycoords=("data", "axes fraction"),
            xytext=(2, 0),
            textcoords="offset points",
            rotation=90,
            fontsize=7,
            color=_MARKS[event.kind],
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6, "alpha": 0.8},
            zorder=2.5,
        )


def _bounds(key: str, limits: JointLimits) -> tuple[FloatArray, FloatArray]:
    if key == "q":
        return limits.q_min, limits.q_max
    bound: FloatArray = getattr(limits, f"{key}_max")
    return -bound, bound


def _view(values: FloatArray, low: float, high: float) -> tuple[float, float]:
    """What a panel shows: the limits and a margin, and values beyond as far as is sensible."""
    reach = (high - low) / 2 * MAX_VIEW
    middle = (low + high) / 2
    margin = MARGIN * (high - low) / 2
    bottom = max(min(low, float(values.min())), middle - reach)
    top = min(max(high, float(values.max())), middle + reach)
    return bottom - margin, top + margin


def _known(motion: ArmMotion) -> NDArray[np.bool_]:
    """Where the motion is exact: in recorded moves, and where the arm stands still."""
    changes = np.abs(np.concatenate([motion.v, motion.a, motion.j], axis=1))
    known: NDArray[np.bool_] = motion.is_exact | (changes.max(axis=1) < STILL_RATE)
    return known


def _widened(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """With the neighbours of each run, so that a line through them has no gap."""
    wider = mask.copy()
    wider[:-1] |= mask[1:]
    wider[1:] |= mask[:-1]
    return wider


def _time_range(recording: Recording) -> tuple[float, float]:
    first, last = float(recording.times_s[0]), float(recording.times_s[-1])
    return (first, last) if last > first else (first - 0.5, last + 0.5)


def _title(recording: Recording, limb: str) -> str:
    moves = sum(move.limb == limb for move in recording.moves)
    suffix = f", {moves} move{'' if moves == 1 else 's'}" if moves else ""
    return f"{limb.capitalize()} arm: {recording.duration_s:.2f} s{suffix}"


def _legend(
    motion: ArmMotion, known: NDArray[np.bool_], events: list[Event]
) -> tuple[list[Any], list[str]]:
    from matplotlib.lines import Line2D  # noqa: PLC0415 - an extra

    entries: dict[str, Any] = {}
    if motion.is_exact.any():
        entries["exact, from the recorded moves"] = Line2D([], [], color=EXACT_COLOUR)
    elif known.any():
        entries["standing still"] = Line2D([], [], color=EXACT_COLOUR)
    if not known.all():
        entries["differences of the recorded positions"] = Line2D([], [], color=DIFFERENCE_COLOUR)
    entries["limit"] = Line2D([], [], color=LIMIT_COLOUR, linestyle=(0, (5, 3)))
    for kind, colour in _MARKS.items():
        if any(event.kind is kind for event in events):
            entries[kind.value] = Line2D([], [], color=colour)
    return list(entries.values()), list(entries)


def plot_comparison(comparison: Comparison) -> Figure:
    """The differences of an arm from its plan over time, one line for each joint, and the tip's.

    Args:
        comparison: as of `sim.recording.compare_run`.

    Raises:
        RecordingError: when Matplotlib is missing, or the argument is of another class.
    """
    expect(comparison, Comparison, "comparison", RecordingError)
    figure = _new_figure(1)
    joints, tip = figure.subplots(2, 1, sharex=True)
    gaps = np.flatnonzero(np.diff(comparison.times_s) > MAX_LINE_S) + 1
    times_s, off_rad, tip_off_m = (
        np.insert(values, gaps, np.nan, axis=0)
        for values in (comparison.times_s, comparison.off_rad, comparison.tip_off_m)
    )
    for name, column in zip(comparison.joint_names, off_rad.T, strict=True):
        joints.plot(times_s, 1e3 * column, linewidth=1.3, label=name)
    tip.plot(times_s, 1e3 * tip_off_m, color=EXACT_COLOUR, linewidth=1.3)
    joints.set_ylabel("off the plan [mrad]")
    joints.legend(loc="upper right", ncols=len(comparison.joint_names), frameon=False)
    tip.set_ylabel("tip off the plan [mm]")
    tip.set_xlabel("time [s]")
    for axes in (joints, tip):
        axes.grid(visible=True, color="#e6e6e6", linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    return figure
