"""Results of the IK service."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

from baxter_kin.display import OneLine, sentence, side_of
from baxter_kin.errors import ConfigurationError
from baxter_kin.fields import Frozen, FrozenMapping
from baxter_kin.ik.seeds import SeedType
from baxter_kin.validation import FloatArray, check_fields, expect, finite_array, finite_scalar

POSITION_TOLERANCE_M = 1e-6
ORIENTATION_TOLERANCE_RAD = 1e-6


class _Pending:
    """What makes the fields of an `IKFailure` when one of them is asked for."""

    __slots__ = ("_ask",)


@dataclass(frozen=True, slots=True, repr=False)
class IKFailure(_Pending, OneLine):
    """Why a pose has no solution; `str()` of it is one sentence.

    Those that the service answers find their reason when they are asked for it, which takes longer
    than to find that there is one.

    Attributes:
        reason: that sentence, with numbers.
        starts: how many searches each seed type was given.
        beyond_reach_m: how far the pose is proven to lie out of reach; zero when nothing is proven.
        joints_at_limit: joints that the best attempt leaves at a limit.
        limits_violated: what stands in the way: a phrase, with joint, value and range, for each
            joint limit that a solution without limits violates; empty when none was found either.
        nearest_m: how far the pose is from the nearest position that was found to be reachable in
            its orientation, by the result's `q`; None where `beyond_reach_m` was proven before that
            was searched for. With both, the nearest is between them.

    Raises:
        ConfigurationError: when a value is of another class.
    """

    reason: str
    starts: Mapping[SeedType, int] = field(default_factory=dict)
    beyond_reach_m: float = 0.0
    joints_at_limit: tuple[str, ...] = ()
    limits_violated: tuple[str, ...] = ()
    nearest_m: float | None = None

    def __post_init__(self) -> None:
        check_fields(self, ConfigurationError)
        object.__setattr__(self, "starts", FrozenMapping(self.starts))

    @classmethod
    def later(cls, ask: Callable[[], IKFailure]) -> IKFailure:
        """A failure that calls a function for its fields when one of them is first read.

        Raises:
            ConfigurationError: when it is no function.
        """
        if not callable(ask):
            raise ConfigurationError(f"ask must be callable, got {type(ask).__name__}")
        failure = object.__new__(cls)
        _PUT_ASK(failure, ask)
        return failure

    if not TYPE_CHECKING:  # which knows the fields

        def __getattr__(self, name: str) -> Any:
            if name not in _FAILURE_FIELDS:
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            found = expect(self._ask(), IKFailure, "what ask returns", ConfigurationError)
            for each in _FAILURE_FIELDS:
                object.__setattr__(self, each, getattr(found, each))
            return getattr(found, name)

    def __str__(self) -> str:
        return self.reason

    def _facts(self) -> tuple[str, ...]:
        return (sentence(self.reason),)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class IKResult(Frozen, OneLine):
    """The result for one pose.

    When `is_valid` is false, `q` and the errors are those of the best attempt; it never reached the
    pose and must not be sent to a robot.

    Attributes:
        joint_names: the joints of `q`.
        q: the solution, shape (7,), rad, inside the limits.
        seed_type: whose start converged; `INVALID` without a solution.
        position_error_m: distance between requested and reached tip.
        orientation_error_rad: angle between requested and reached tip.
        failure: None, or why there is no solution.

    Raises:
        ConfigurationError: when a value is of another class, an error is negative or not finite,
            `q` has another shape than the names or is not finite, or there is both a seed type and
            a failure, or neither.
    """

    joint_names: tuple[str, ...]
    q: FloatArray
    seed_type: SeedType
    position_error_m: float
    orientation_error_rad: float
    failure: IKFailure | None = None

    def __post_init__(self) -> None:
        check_fields(self, ConfigurationError)
        for name in ("position_error_m", "orientation_error_rad"):
            if finite_scalar(getattr(self, name), name, ConfigurationError) < 0.0:
                raise ConfigurationError(f"{name} must not be negative, got {getattr(self, name)}")
        if (self.failure is None) == (self.seed_type is SeedType.INVALID):
            raise ConfigurationError("a result has either a seed type that led to it or a failure")
        q = finite_array(self.q, (len(self.joint_names),), "q", ConfigurationError)
        object.__setattr__(self, "q", q)

    @property
    def is_valid(self) -> bool:
        """Whether `q` reaches the pose within 1e-6 m and 1e-6 rad inside the limits."""
        return self.failure is None

    @property
    def joints(self) -> dict[str, float]:
        """The solution by joint name, rad."""
        return dict(zip(self.joint_names, self.q.tolist(), strict=True))

    @property
    def label(self) -> str:
        """The seed type in the words of the original demo."""
        return self.seed_type.label

    def _facts(self) -> tuple[str, ...]:
        side = side_of(self.joint_names)
        if self.failure is not None:
            return side, f"invalid: {sentence(self.failure)}"
        errors = f"{self.position_error_m:.2g} m and {self.orientation_error_rad:.2g} rad off"
        return side, "valid", f"from {self.seed_type.name}", errors


_FAILURE_FIELDS = tuple(slot.name for slot in fields(IKFailure))
_PUT_ASK = _Pending._ask.__set__  # type: ignore[attr-defined]  # the slot

_SETTERS = tuple(getattr(IKResult, slot.name).__set__ for slot in fields(IKResult))
"""What writes the slots of a frozen result, in half the time of `object.__setattr__`."""


def unchecked_result(
    joint_names: tuple[str, ...],
    q: FloatArray,
    seed_type: SeedType,
    errors: tuple[float, float],
    failure: IKFailure | None = None,
) -> IKResult:
    """A result of the service, whose values need no checks: made in a tenth of the time.

    Args:
        joint_names: as of `IKResult`.
        q: shape (7,), rad, read-only.
        seed_type: as of `IKResult`.
        errors: of position, m, and orientation, rad.
        failure: as of `IKResult`.
    """
    result = object.__new__(IKResult)
    put_names, put_q, put_seed_type, put_offset, put_angle, put_failure = _SETTERS
    put_names(result, joint_names)
    put_q(result, q)
    put_seed_type(result, seed_type)
    put_offset(result, errors[0])
    put_angle(result, errors[1])
    put_failure(result, failure)
    return result
