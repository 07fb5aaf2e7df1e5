"""What this layer raises.

```
BaxterError
├── DescriptionError          the robot's URDF cannot be found or read
├── UnknownNameError          a limb, frame or joint that does not exist   (also ValueError)
├── ConfigurationError        joint values: shape, finiteness, limits      (also ValueError)
├── LimitsError               joint limits that make no sense              (also ValueError)
├── PoseError                 a position, quaternion or pose that is none  (also ValueError)
├── RequestError              an IK request that contradicts itself        (also ValueError)
├── CopyError                 what cannot be pickled or copied              (also TypeError)
├── FileError                 a file that cannot be read, written or trusted
└── MissingLibraryError       a library that the system lacks              (also ImportError)
```

Malformed input raises one of these. "No solution" is a result with a reason, never an exception.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeVar

T = TypeVar("T")

LONGEST_NAME = 60
"""How much of an unknown name a message repeats."""


class BaxterError(Exception):
    """Root of every error the toolkit raises on purpose."""

    def __reduce__(self) -> tuple[Any, ...]:
        """What makes it again in another process, whatever its class takes to be made."""
        return _remade, (type(self), self.args, self.__dict__)


class DescriptionError(BaxterError):
    """The robot description is missing or does not contain what it should."""


class UnknownNameError(BaxterError, ValueError):
    """A name that does not exist.

    Attributes:
        kind: what was looked up, such as "limb".
        name: the name that came.
        allowed: the names that exist.
    """

    def __init__(self, kind: str, name: object, allowed: Iterable[str]) -> None:
        """Say what came and what is allowed."""
        self.kind = kind
        self.name = name
        self.allowed = tuple(allowed)
        given = " ".join(repr(name).split())
        shown = given if len(given) <= LONGEST_NAME else f"{given[:LONGEST_NAME]}..."
        super().__init__(f"unknown {kind} {shown}; use one of: {', '.join(self.allowed)}")


class ConfigurationError(BaxterError, ValueError):
    """Joint values of the wrong shape, not finite, or outside the limits."""


class LimitsError(BaxterError, ValueError):
    """Joint limits that are not finite, not positive, or empty."""


class PoseError(BaxterError, ValueError):
    """A position, rotation or quaternion that is not one."""


class RequestError(BaxterError, ValueError):
    """An IK request whose parts do not fit together."""


class FileError(BaxterError):
    """A file that cannot be read, written or trusted.

    Attributes:
        action: what was tried: "read", "write" or "use".
        path: which file, as it was given.
        reason: why not.
    """

    def __init__(self, action: str, path: object, reason: str) -> None:
        """Say what was tried on which file, and why it failed."""
        self.action = action
        self.path = path
        self.reason = reason
        super().__init__(f"cannot {action} {path}: {reason}")


class CopyError(BaxterError, TypeError):
    """Something that holds an open file, a socket or a thread was pickled or copied."""


class MissingLibraryError(BaxterError, ImportError):
    """A library that a dependency leaves to the system, and that the system lacks."""


def _remade(cls: type[BaxterError], args: tuple[Any, ...], facts: dict[str, Any]) -> BaxterError:
    error = cls.__new__(cls, *args)
    error.args = args
    error.__dict__.update(facts)
    return error


def expect(value: object, kind: type[T], what: str, error: type[BaxterError]) -> T:
    """`value`, known to be of that class.

    Raises:
        BaxterError: of class `error`, when it is of another.
    """
    if not isinstance(value, kind):
        raise error(f"{what} must be of class {kind.__name__}, got {type(value).__name__}")
    return value
