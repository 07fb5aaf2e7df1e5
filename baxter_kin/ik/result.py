"""Results of the IK service: `IKResult`, and `IKFailure`, the reason why a pose has no solution."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import attrs

from baxter_kin.display import line, side_of
from baxter_kin.errors import ConfigurationError
from baxter_kin.fields import field_names, frozen, mapping, with_read_only_arrays
from baxter_kin.ik.seeds import SeedType
from baxter_kin.validation import FloatArray

POSITION_TOLERANCE_M = 1e-6
ORIENTATION_TOLERANCE_RAD = 1e-6


class _Pending:
    """Holds the function that finds the fields of an `IKFailure` when one is first read."""

    __slots__ = ("_find",)


@frozen(error=ConfigurationError, eq=True)
class IKFailure(_Pending):
    """Why a pose has no solution; `str()` of it is one sentence.

    Failures of the service determine their reason when a field is first read, which takes longer
    than finding that there is no solution.

    Attributes:
        reason: that sentence, with numbers.
        starts: the number of searches for each seed type.
        beyond_reach_m: lower bound on the distance of the pose from what can be reached; zero when
            nothing is proven.
        joints_at_limit: joints that are at a limit in the best attempt.
        limits_violated: for each joint limit that a solution without limits violates, a phrase with
            joint, value and range; empty when no such solution was found either.
        nearest_m: distance of the pose from the nearest reachable position found in its
            orientation, by the result's `q`; None where `beyond_reach_m` was proven before such a
            position was searched for. Where both are known, the true distance is between them.
        nearest_step_rad: how far the nearest solution found is from the current joints, in the
            greatest difference of a single joint; the result's `q` is that solution. None unless it
            was refused because it is farther than `max_step_rad`.
    """

    reason: str
    starts: Mapping[SeedType, int] = mapping(factory=dict)
    beyond_reach_m: float = 0.0
    joints_at_limit: tuple[str, ...] = ()
    limits_violated: tuple[str, ...] = ()
    nearest_m: float | None = None
    nearest_step_rad: float | None = None

    if not TYPE_CHECKING:  # which knows the fields

        def __getattr__(self, name: str) -> Any:
            """Find the fields of a pending failure, whose slots are empty."""
            if name not in _FAILURE_FIELDS:
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            found = self._find()
            for each in _FAILURE_FIELDS:
                object.__setattr__(self, each, getattr(found, each))
            return getattr(found, name)

    def __str__(self) -> str:
        return self.reason

    def _facts(self) -> tuple[str, ...]:
        return (self.reason,)


def pending_failure(find: Callable[[], IKFailure]) -> IKFailure:
    """A failure that calls `find` for its fields when one of them is first read."""
    failure = object.__new__(IKFailure)
    _SET_FIND(failure, find)
    return failure


@attrs.frozen(init=False, eq=False, repr=False)
class IKResult:
    """The result for one pose.

    Only the service makes results, a hundred thousand a second: arguments are neither checked nor
    copied. `checked_result` checks one that was read from a file.

    When `is_valid` is false, `q` and the errors are those of the best attempt, which must not be
    sent to a robot: it never reached the pose, or is farther from the current joints than allowed.

    Attributes:
        joint_names: the joints of `q`.
        q: the solution, shape (7,), rad, inside the limits; read-only.
        seed_type: the seed that led to the solution; `INVALID` without a solution.
        position_error_m: distance between requested and reached tip.
        orientation_error_rad: angle between requested and reached tip.
        failure: None, or why there is no solution.
    """

    joint_names: tuple[str, ...]
    q: FloatArray
    seed_type: SeedType
    position_error_m: float
    orientation_error_rad: float
    failure: IKFailure | None = None

    def __init__(  # noqa: PLR0917 - quicker than by name
        self,
        joint_names: tuple[str, ...],
        q: FloatArray,
        seed_type: SeedType,
        position_error_m: float,
        orientation_error_rad: float,
        failure: IKFailure | None = None,
    ) -> None:
        set_names, set_q, set_seed_type, set_offset, set_angle, set_failure = _SETTERS
        set_names(self, joint_names)
        set_q(self, q)
        set_seed_type(self, seed_type)
        set_offset(self, position_error_m)
        set_angle(self, orientation_error_rad)
        set_failure(self, failure)

    @property
    def is_valid(self) -> bool:
        """Whether `q` reaches the pose within 1e-6 m and 1e-6 rad, in limits and allowed step."""
        return self.failure is None

    @property
    def joints(self) -> dict[str, float]:
        """The solution by joint name, rad."""
        return dict(zip(self.joint_names, self.q.tolist(), strict=True))

    @property
    def label(self) -> str:
        """The seed type in the words of the original demo."""
        return self.seed_type.label

    def __getstate__(self) -> tuple[Any, ...]:
        return tuple(getattr(self, name) for name in field_names(self))

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        for set_field, value in zip(_SETTERS, state, strict=True):
            set_field(self, with_read_only_arrays(value))

    def __repr__(self) -> str:
        facts = [side_of(self.joint_names)]
        if self.failure is not None:
            facts.append(f"invalid: {self.failure}")
        else:
            errors = f"{self.position_error_m:.2g} m and {self.orientation_error_rad:.2g} rad off"
            facts += ["valid", f"from {self.seed_type.name}", errors]
        return line(type(self).__name__, facts)


def checked_result(given: IKResult | None) -> IKResult | None:
    """A result that was read from a file, if it is consistent; its array becomes read-only.

    Anything but a result is returned as it is: the type check of the field refuses it.
    """
    if not isinstance(given, IKResult):
        return given
    if min(given.position_error_m, given.orientation_error_rad) < 0.0:
        raise ConfigurationError("the errors of a result must not be negative")
    if (given.failure is None) == (given.seed_type is SeedType.INVALID):
        raise ConfigurationError("a result has either a seed type that led to it or a failure")
    if given.q.shape != (len(given.joint_names),):
        raise ConfigurationError(
            f"a result for {len(given.joint_names)} joints has a q of shape {given.q.shape}"
        )
    given.q.setflags(write=False)
    return given


_FAILURE_FIELDS = tuple(IKFailure.__annotations__)
_SET_FIND = _Pending._find.__set__  # type: ignore[attr-defined]  # the slot

_SETTERS = tuple(getattr(IKResult, name).__set__ for name in IKResult.__annotations__)
"""Write the slots of a frozen result, in less time than `object.__setattr__`."""
