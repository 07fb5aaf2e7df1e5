"""Response: how a real arm follows the set-points that it is sent, and how they are sent.

A Baxter in position mode follows its set-points with a lag. Each joint is modelled as a first-order
system,

    T(t) y'(t) = u(t) - y(t),        |q(t) - y(t)| <= e,

where u is the set-point in force, T(t) is a lag that may change at any time within an interval, and
e bounds the distance of the joint position q from y: gravity, friction, backlash, calibration. What
is sent is the plan q(t) slowed down, with a lead along its velocity:

    u(t) = q(s t) + L s q'(s t), within the joint limits,        s the speed, L the lead.

A joint whose lag is exactly L follows a plan with that lead without any lag: u = q + L q' is solved
by y = q.

**From a recording.** `fit_response` estimates these bounds. For each joint it fits a lag T and an
offset b, so that the answer y of T y' = u - y to the commands, each held until the next, is nearest
to the measurements less b in the least-squares sense: T on a grid, then by golden-section search.
As the answer starts where the joint is measured, less b, an offset appears as b (1 - exp(-t / T)).
A joint that moves at one constant speed only lags by the same course, so its lag cannot be told
from an offset, and it is refused. No single number describes a joint at all times. The interval of
the lag is therefore the hull of

- T, plus and minus its uncertainty due to noise: `SIGMAS` standard deviations of a least-squares
  estimate (Seber and Wild, "Nonlinear Regression", 1989, ch. 2), where the derivative of y by T is
  about minus its speed, less what an offset explains as well;
- the lags that fit best in pieces of `PIECE_S` of the motion, where the joint moves enough.

The settled error is the largest distance of a measurement from the tube of that interval
(`planner.motion.tracking_tube`, for the recorded commands), times `RESERVE`. The response thus
describes the data that it was estimated from; how well it describes other motions, faster ones or
with a load, only other data can show.

**Files.** `python -m sim.ros1.check --identify` writes a response to a JSON file (`save_response`);
`--response FILE` of `sim.ros1.execute` and of `planner.verification` reads it (`load_responses`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from baxter_kin.display import seconds, shown_path
from baxter_kin.errors import FileError
from baxter_kin.fields import evolve, field, frozen, scalar
from baxter_kin.files import PathLike, open_to_read, replace_file
from baxter_kin.files.json_data import from_json, shown, to_json
from baxter_kin.files.json_text import as_lines, from_text
from baxter_kin.kinematics.arm import JOINTS
from baxter_kin.validation import FloatArray, expect, finite_array, float_array
from planner.errors import ResponseError
from planner.trajectory import Trajectory

TICK_S = 0.01
"""Time between two set-points: 100 Hz, as the original clients."""

LATE_S = 0.02
"""Default lateness of the stream that proofs assume."""

REST_PLAN_S = 0.01
"""Additional rest, in plan time: more than the cells by which tubes extend a motion."""

MAX_LAG_S, MAX_LEAD_S, MAX_LATE_S, MAX_ERROR_RAD = 5.0, 1.0, 1.0, 0.2
"""Maximum values; larger ones are not the response of an arm, but numbers in another unit."""

MIN_SAMPLES, MAX_GAP_S = 50, 0.25
"""Requirements on a recording: set-points come at 100 Hz; longer gaps leave open what was sent and
done."""

MIN_RECORDED_SHARE = 0.5
"""Minimum share of the time that is recorded."""

MIN_TRAVEL_RAD = 0.02
"""Minimum commanded travel of a joint whose lag can be estimated."""

MIN_SPEED = 0.05
"""Minimum average speed (RMS) of a piece of a joint's motion from which its lag is estimated,
rad/s."""

MIN_UNEXPLAINED_SHARE = 0.3
"""Minimum share of a joint's speed that an offset does not explain."""

MIN_DIFFERENCE_RAD = 1e-9
"""Minimum difference of commands and measurements: no arm follows immediately."""

GRID_S = np.concatenate([[0.0], np.geomspace(2e-3, MAX_LAG_S, 80)])
"""Lags that are tried before the search between two of them."""

MAX_FITTED_SHARE = 0.99
"""Maximum share of `MAX_LAG_S` of a lag that was found; a longer one was cut off."""

REFINEMENTS = 40
"""Number of golden-section steps: an interval of the grid is reduced to 1e-8 of it."""

SIGMAS, PIECE_S, RESERVE = 3.0, 1.0, 1.25
"""Uncertainty of a lag in standard deviations, duration of a piece of a recording, and factor on
the largest distance of a measurement from the tube."""

_GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0

FORMAT, VERSION = "baxter-kin response", 1
"""Name and version of the file format."""

MAX_BYTES = 1_000_000
"""Maximum size of a response file."""


class Command(NamedTuple):
    """A set-point, each field of shape (n,) or (m, n).

    Attributes:
        q: positions, rad, within the joint limits.
        v: velocity of the plan at the reduced speed, rad/s.
    """

    q: FloatArray
    v: FloatArray


def _lags(values: ArrayLike) -> FloatArray:
    lags = float_array(values, "lag_s", ResponseError)
    if lags.shape == (2,):
        lags = np.tile(lags, (len(JOINTS), 1))
    lags = finite_array(lags, (len(JOINTS), 2), "lag_s", ResponseError)
    for number, (min_s, max_s) in enumerate(lags.tolist()):
        if not 0.0 <= min_s <= max_s <= MAX_LAG_S:
            raise ResponseError(
                f"lag_s of joint {number} must be minimum and maximum, from 0 to "
                f"{MAX_LAG_S:g} s, got {min_s:g} and {max_s:g}"
            )
    return lags


def _errors(values: ArrayLike) -> FloatArray:
    errors = float_array(values, "settled_error_rad", ResponseError)
    if errors.ndim == 0:
        errors = np.full(len(JOINTS), errors)
    errors = finite_array(errors, (len(JOINTS),), "settled_error_rad", ResponseError)
    if not ((errors >= 0.0) & (errors <= MAX_ERROR_RAD)).all():
        raise ResponseError(
            f"settled_error_rad must be from 0 to {MAX_ERROR_RAD:g} rad, got {errors.tolist()}"
        )
    return errors


@frozen(error=ResponseError)
class Response:
    """Bounds on how an arm follows its set-points, and how these are sent.

    Attributes:
        lag_s: minimum and maximum lag of each joint, shape (7, 2), s, up to `MAX_LAG_S`; one pair
            of shape (2,) stands for all joints. A joint of zero lag follows immediately.
        settled_error_rad: maximum distance of each joint from the position that follows from its
            lag, shape (7,), rad, up to `MAX_ERROR_RAD`; one number stands for all joints.
        speed: of plan time to time, in (0, 1].
        lead_s: lead of set-points along the velocity, 0 .. `MAX_LEAD_S`.
        late_s: maximum total delay of a set-point relative to an even stream of 100 Hz, 0 ..
            `MAX_LATE_S`: the maximum lateness of one, plus all time for which plan time stood still
            since the arm last rested. Longer delays are not covered.

    Raises:
        ResponseError: when a value is not a number, or outside its range; names the range.
    """

    lag_s: FloatArray = field(converter=_lags)
    settled_error_rad: FloatArray = field(default=0.0, converter=_errors)
    speed: float = scalar(above=0.0, most=1.0, default=1.0)
    lead_s: float = scalar(least=0.0, most=MAX_LEAD_S, default=0.0)
    late_s: float = scalar(least=0.0, most=MAX_LATE_S, default=LATE_S)

    if TYPE_CHECKING:  # converters take more than the fields hold

        def __init__(
            self,
            lag_s: ArrayLike,
            settled_error_rad: ArrayLike = 0.0,
            speed: float = 1.0,
            lead_s: float = 0.0,
            late_s: float = LATE_S,
        ) -> None: ...

    @property
    def window_s(self) -> float:
        """Maximum age of the set-point in force: a tick, and the lateness of the stream."""
        return TICK_S + self.late_s

    @property
    def rest_s(self) -> float:
        """Minimum time for which the last set-point stands before the next motion may begin, s.

        From then on no older one is in force, which tubes of the next motion rely on.
        """
        return self.window_s + REST_PLAN_S / self.speed

    def at_speed(self, speed: float) -> Response:
        """The same arm, sent the same plan at another speed, in (0, 1]."""
        return evolve(self, speed=speed)

    def command(self, trajectory: Trajectory, t_s: ArrayLike) -> Command:
        """The set-point at one time or at many, from the beginning of a motion.

        Args:
            trajectory: the motion as planned.
            t_s: one time, or shape (m,), s, not negative; after its end the motion rests.

        Raises:
            TrajectoryError: when a time is not a number, negative, or after the end of a motion
                that does not end at rest.
            ResponseError: when it is not a `Trajectory`.
        """
        expect(trajectory, Trajectory, "trajectory", ResponseError)
        state = trajectory.sample(self.speed * float_array(t_s, "t_s", ResponseError))
        v = self.speed * state.v
        limits = trajectory.limits
        led = np.clip(state.q + self.lead_s * v, limits.q_min, limits.q_max)
        return Command(led if self.lead_s > 0.0 else state.q, v)

    def _facts(self) -> tuple[str, ...]:
        lag = f"lag {self.lag_s.min():.3g} .. {self.lag_s.max():.3g} s"
        error = f"error {self.settled_error_rad.max():.3g} rad"
        lead = f"lead {seconds(self.lead_s)}" if self.lead_s else ""
        return lag, error, f"speed {self.speed:.3g}", lead, f"{1e3 * self.late_s:.3g} ms late"


def remaining_share(time_s: float | FloatArray, lag_s: FloatArray) -> FloatArray:
    """Share of a distance that remains after a time; zero without lag."""
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):  # lags of 0, or near it
        share = np.exp(-np.divide(time_s, lag_s))
    return np.where((lag_s > 0.0) | (np.asarray(time_s) <= 0.0), np.nan_to_num(share, nan=1.0), 0.0)


def fit_response(t: ArrayLike, q_commanded: ArrayLike, q_measured: ArrayLike) -> Response:
    """Bounds on how an arm follows, estimated from a recording of its commands and its motion.

    Args:
        t: times, shape (k,), s, increasing.
        q_commanded: set-points as they were sent, including their lead, each in force until the
            next time, shape (k, 7), rad.
        q_measured: positions measured at these times, shape (k, 7), rad.

    Returns:
        A response at speed 1 without lead, whose tube contains the measurements.

    Raises:
        ResponseError: when arrays do not match, a number is not finite, times do not increase or
            are mostly gaps, or a joint did not move enough, or did not follow; says which.
    """
    data = _checked(t, q_commanded, q_measured)
    lag_s = _fitted_lags(data)
    low, high = _intervals(data, lag_s)
    errors = RESERVE * _outside(data, low, high, _offsets(data, lag_s))
    if float(errors.max()) > MAX_ERROR_RAD:
        joint = int(errors.argmax())
        raise ResponseError(
            f"{_named(joint)} is measured {_rounded(errors[joint], up=True)} rad from any lag's "
            f"answer to its commands; up to {MAX_ERROR_RAD:g} rad can be stated: was it "
            "pushed, or are these columns of other joints?"
        )
    return Response(np.column_stack([low, high]), errors)


class _Data(NamedTuple):
    """A recording: times (k,), commands and measurements (k, 7); whether a part begins there."""

    t: FloatArray
    u: FloatArray
    q: FloatArray
    begins: NDArray[np.bool_]

    @classmethod
    def of(cls, t: FloatArray, u: FloatArray, q: FloatArray) -> _Data:
        """Parts are separated by gaps."""
        return cls(t, u, q, np.diff(t, prepend=-np.inf) > MAX_GAP_S)

    @property
    def since_s(self) -> FloatArray:
        """Time since the beginning of the part, shape (k,)."""
        first = np.flatnonzero(self.begins)
        since_s: FloatArray = self.t - self.t[first[np.cumsum(self.begins) - 1]]
        return since_s


def _checked(t: ArrayLike, q_commanded: ArrayLike, q_measured: ArrayLike) -> _Data:
    times = float_array(t, "t", ResponseError)
    times = finite_array(times, (times.size,), "t", ResponseError)
    u = finite_array(q_commanded, (times.size, len(JOINTS)), "q_commanded", ResponseError)
    q = finite_array(q_measured, (times.size, len(JOINTS)), "q_measured", ResponseError)
    _check_times(times)
    if np.abs(u - q).max() <= MIN_DIFFERENCE_RAD:
        raise ResponseError(
            "q_commanded is q_measured: give the set-points that were sent, such as "
            "`recording.commands[limb]` has them; `recording.motion` has what was measured"
        )
    for what, values in (("commanded", u), ("measured", q)):
        travel = np.ptp(values, axis=0)
        if float(travel.min()) < MIN_TRAVEL_RAD:
            raise ResponseError(
                f"{_named(int(travel.argmin()))} was {what} over {_rounded(travel.min())} rad "
                f"only; every joint must go {MIN_TRAVEL_RAD:g} rad to tell its lag"
            )
    return _Data.of(times, u, q)


def _check_times(times: FloatArray) -> None:
    if len(times) < MIN_SAMPLES:
        raise ResponseError(f"{len(times)} samples tell no response; give {MIN_SAMPLES} or more")
    gaps = np.diff(times)
    if not (gaps > 0.0).all():
        at = int(gaps.argmin())
        raise ResponseError(
            f"times must increase, but {times[at]:g} s comes before {times[at + 1]:g} s"
        )
    missing_s = float(gaps[gaps > MAX_GAP_S].sum())
    if missing_s > (1.0 - MIN_RECORDED_SHARE) * float(gaps.sum()):
        raise ResponseError(
            f"nothing is recorded for {missing_s:.3g} of {gaps.sum():.3g} s, in gaps longer than "
            f"{MAX_GAP_S:g} s; record at 100 Hz, and give times in seconds"
        )


def _answers(data: _Data, lags_s: FloatArray) -> FloatArray:
    """Positions for lags of shape (..., 7), from the start of each part: shape (k, ..., 7)."""
    answers = np.empty((len(data.t), *lags_s.shape))
    answers[0] = y = np.broadcast_to(data.q[0], lags_s.shape)
    for number, step_s in enumerate(np.diff(data.t).tolist()):
        if data.begins[number + 1]:
            y = np.broadcast_to(data.q[number + 1], lags_s.shape)
        else:
            y = data.u[number] + (y - data.u[number]) * remaining_share(step_s, lags_s)
        answers[number + 1] = y
    return answers


def _speeds(data: _Data, lags_s: FloatArray) -> FloatArray:
    """Speeds of these answers, shape (k, 7), rad/s; zero on both sides of a gap."""
    speeds = np.gradient(_answers(data, lags_s), data.t, axis=0)
    gaps = data.begins[1:]
    speeds[1:][gaps] = speeds[:-1][gaps] = 0.0
    return speeds


def _off(data: _Data, lags_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Measurement minus answer, and the effect of an offset of 1 on it, both (k, ..., 7)."""
    since_s = data.since_s.reshape(-1, *(1,) * lags_s.ndim)
    measured = data.q.reshape(len(data.t), *(1,) * (lags_s.ndim - 1), data.q.shape[1])
    return measured - _answers(data, lags_s), 1.0 - remaining_share(since_s, lags_s)


def _misfit(data: _Data, lags_s: FloatArray, *, has_offset: bool) -> FloatArray:
    """Sum of squares for each lag, with its best offset or without, of the shape of the lags."""
    off, course = _off(data, lags_s)
    if has_offset:
        off = off - course * _best_offset(off, course)
    squares: FloatArray = (off**2).sum(axis=0)
    return squares


def _best_offset(off: FloatArray, course: FloatArray) -> FloatArray:
    best: FloatArray = (off * course).sum(axis=0) / (course**2).sum(axis=0)
    return best


def _best(data: _Data, *, has_offset: bool) -> FloatArray:
    """The best lag of each joint, shape (7,), s; the longest where none fits."""
    grid = np.repeat(GRID_S[:, None], data.q.shape[1], axis=1)
    best = _misfit(data, grid, has_offset=has_offset).argmin(axis=0)
    low, high = GRID_S[np.maximum(best - 1, 0)], GRID_S[np.minimum(best + 1, len(GRID_S) - 1)]
    for _ in range(REFINEMENTS):
        inner = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        first, second = _misfit(data, np.array(inner), has_offset=has_offset)
        is_first = first < second
        low, high = np.where(is_first, low, inner[0]), np.where(is_first, inner[1], high)
    middle = (low + high) / 2
    without_lag, with_lag = _misfit(
        data, np.array([np.zeros_like(middle), middle]), has_offset=has_offset
    )
    lags_s: FloatArray = np.where(without_lag <= with_lag, 0.0, middle)
    return lags_s


def _fitted_lags(data: _Data) -> FloatArray:
    """The best lag of each joint, shape (7,), s."""
    lag_s = _best(data, has_offset=True)
    if float(lag_s.max()) > MAX_FITTED_SHARE * MAX_LAG_S:
        raise ResponseError(
            f"{_named(int(lag_s.argmax()))} does not follow its commands within "
            f"{MAX_LAG_S:g} s; was the arm enabled, and are these columns of the same joints?"
        )
    return lag_s


def _offsets(data: _Data, lag_s: FloatArray) -> FloatArray:
    """Constant offset of each joint from the answer of its lag, shape (7,), rad."""
    return _best_offset(*_off(data, lag_s))


def _intervals(data: _Data, lag_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Minimum and maximum lag of each joint, shape (7,) both, s."""
    speeds = _speeds(data, lag_s)
    fastest = np.max([_rms(speeds[piece]) for piece in _parts(data)], axis=0)
    if float(fastest.min()) < MIN_SPEED:
        raise ResponseError(
            f"{_named(int(fastest.argmin()))} went at {_rounded(fastest.min())} rad/s in its "
            "fastest second, which does not tell its lag; every joint must go at "
            f"{MIN_SPEED:g} rad/s or more, if only for a second"
        )
    usual = _rms(speeds)
    off, course = _off(data, lag_s)
    offsets = _best_offset(off, course)
    telling = speeds - course * _best_offset(speeds, course)
    share = _rms(telling) / usual
    if float(share.min()) < MIN_UNEXPLAINED_SHARE:
        raise ResponseError(
            f"{_named(int(share.argmin()))} went at one speed nearly all the time, so its lag "
            "cannot be told from an offset; let it go there and back"
        )
    noise = (off - course * offsets).std(axis=0)
    spread = SIGMAS * noise / (share * usual * np.sqrt(len(data.t)))
    pieces = _pieces(data._replace(q=data.q - offsets), lag_s, speeds)
    low, high = np.minimum(lag_s - spread, pieces.min(axis=0)), lag_s + spread
    return np.maximum(low, 0.0), np.minimum(np.maximum(high, pieces.max(axis=0)), MAX_LAG_S)


def _pieces(data: _Data, lag_s: FloatArray, speeds: FloatArray) -> FloatArray:
    """The best lags in each piece, shape (pieces, 7), s.

    That of the whole recording where a joint moves too little.
    """
    lags = []
    for part in _parts(data):
        piece = _Data.of(*(values[part] for values in (data.t, data.u, data.q)))
        tells = _rms(speeds[part]) >= MIN_SPEED
        lags.append(np.where(tells, _best(piece, has_offset=False), lag_s))
    return np.array(lags)


def _parts(data: _Data) -> list[slice]:
    """The samples of each piece of `PIECE_S`."""
    count = max(1, int((data.t[-1] - data.t[0]) / PIECE_S))
    ends = np.linspace(0, len(data.t), count + 1).astype(np.intp)
    return [slice(first, last) for first, last in pairwise(ends.tolist())]


def _rms(values: FloatArray) -> FloatArray:
    """Root mean square over the samples."""
    rms: FloatArray = np.sqrt((values**2).mean(axis=0))
    return rms


def _outside(data: _Data, low_s: FloatArray, high_s: FloatArray, offsets: FloatArray) -> FloatArray:
    """Maximum distance of measurements from the tube of an interval of lags, shape (7,), rad."""
    high = low = data.q[0] - offsets
    farthest = np.abs(offsets)
    for number, step_s in enumerate(np.diff(data.t).tolist()):
        measured = data.q[number + 1]
        if data.begins[number + 1]:
            high = low = measured - offsets
            continue
        min_share, max_share = remaining_share(step_s, low_s), remaining_share(step_s, high_s)
        aim = data.u[number]
        high = aim + (high - aim) * np.where(high < aim, min_share, max_share)
        low = aim + (low - aim) * np.where(low > aim, min_share, max_share)
        farthest = np.maximum(farthest, np.maximum(measured - high, low - measured))
    return farthest


def _named(joint: int) -> str:
    """The name of a joint by its column."""
    return f"joint {joint} ({JOINTS[joint]})"


def _rounded(value: float, *, up: bool = False) -> str:
    """A number rounded away from a limit, so that it does not read as the limit.

    0.04998 is not 0.05.
    """
    steps = value * 1e4
    return f"{1e-4 * (np.ceil(steps) if up else np.floor(steps)):.4f}".rstrip("0").rstrip(".")


@dataclass(frozen=True, slots=True)
class _Document:
    format: str
    version: int
    limb: str
    lag_s: tuple[tuple[float, float], ...]
    settled_error_rad: tuple[float, ...]


def save_response(response: Response, limb: str, path: PathLike) -> None:
    """Write how an arm follows; speed and lead are not saved."""
    lags = tuple((float(low), float(high)) for low, high in response.lag_s)
    errors = tuple(response.settled_error_rad.tolist())
    document = _Document(FORMAT, VERSION, limb, lags, errors)
    data = to_json(document, _Document, "response", ResponseError)
    try:
        replace_file(path, as_lines(data).encode() + b"\n")
    except FileError as cause:
        raise ResponseError(f"{shown_path(path)} cannot be written: {cause.reason}") from cause


def load_responses(paths: Iterable[PathLike], limbs: Iterable[str]) -> dict[str, Response]:
    """Read how one arm follows its set-points, or both do; "left" or "right" -> response.

    Args:
        paths: one file of each arm.
        limbs: the arms, "left", "right" or both.

    Raises:
        ResponseError: when a file cannot be read, two are of the same arm, or they are not of
            these arms.
    """
    found: dict[str, Response] = {}
    for path in paths:
        limb, response = _loaded(path)
        if limb in found:
            raise ResponseError(f"{shown_path(path)} is of the {limb} arm, as another file is")
        found[limb] = response
    wanted = list(limbs)
    if set(found) != set(wanted):
        raise ResponseError(
            f"the responses are of {' and '.join(found)}, and the plan is of "
            f"{' and '.join(wanted)}; give one file of each arm that moves"
        )
    return found


def _loaded(path: PathLike) -> tuple[str, Response]:
    """The arm that a file is of, and its response."""
    try:
        with open_to_read(path) as stream:
            content = stream.read(MAX_BYTES)
    except (FileError, OSError) as cause:
        raise ResponseError(f"the response cannot be read: {cause}") from cause
    try:
        return _read(content)
    except ResponseError as cause:
        raise ResponseError(f"{shown_path(path)} {cause}") from cause


def _read(content: bytes) -> tuple[str, Response]:
    data = from_text(content, ResponseError)
    stated = data.get("format") if isinstance(data, dict) else None
    if stated != FORMAT:
        said = "not stated" if stated is None else shown(stated)
        raise ResponseError(
            f"holds no response, as its format is {said}; python -m sim.ros1.check "
            "--identify left --output FILE writes one"
        )
    document: _Document = from_json(data, _Document, "response", ResponseError)
    return document.limb, Response(document.lag_s, document.settled_error_rad)
