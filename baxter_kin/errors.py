"""Exceptions of this layer.

```
BaxterError
├── DescriptionError          the robot's URDF cannot be found or read
├── UnknownNameError          a limb, frame or joint that does not exist     (also ValueError)
├── ConfigurationError        joint values: shape, finiteness, limits        (also ValueError)
├── LimitsError               joint limits that are not finite or are empty  (also ValueError)
├── PoseError                 an invalid position, quaternion or pose        (also ValueError)
├── RequestError              an IK request that contradicts itself          (also ValueError)
├── CopyError                 an object that cannot be pickled or copied     (also TypeError)
├── FileError                 a file that cannot be read, written or trusted
└── MissingLibraryError       a system library or a package is missing       (also ImportError)
```

Malformed input raises one of these. "No solution" is a result with a reason, never an exception.
Valid input that was probably not meant warns: `QuaternionOrderWarning`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from baxter_kin.display import MAX_NAME, name_hint, quoted, shown_path


class BaxterError(Exception):
    """Base class of the errors that this toolkit raises."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _remade, (type(self), self.args, self.__dict__)


class DescriptionError(BaxterError):
    """The robot description is missing or does not contain what it should."""


class UnknownNameError(BaxterError, ValueError):
    """A name that does not exist.

    Attributes:
        kind: the kind of thing looked up, such as "limb".
        name: the given name.
        allowed: the existing names.
    """

    def __init__(self, kind: str, name: object, allowed: Iterable[str], advice: str = "") -> None:
        self.kind = kind
        self.name = name
        self.allowed = tuple(allowed)
        shown = quoted(name, MAX_NAME)
        hint = name_hint(name, self.allowed) or advice
        super().__init__(f"unknown {kind} {shown}; use one of: {', '.join(self.allowed)}{hint}")


class ConfigurationError(BaxterError, ValueError):
    """Joint values of the wrong shape, not finite, or outside the limits."""


class LimitsError(BaxterError, ValueError):
    """Joint limits that are not finite, not positive, or empty."""


class PoseError(BaxterError, ValueError):
    """An invalid position, rotation or quaternion."""


class RequestError(BaxterError, ValueError):
    """An IK request that contradicts itself."""


class FileError(BaxterError):
    """A file that cannot be read, written or trusted.

    Attributes:
        action: "read", "write" or "use".
        path: the file, as given.
        reason: why the action failed.
    """

    def __init__(self, action: str, path: object, reason: str) -> None:
        self.action = action
        self.path = path
        self.reason = reason
        super().__init__(f"cannot {action} {shown_path(path)}: {reason}")


class CopyError(BaxterError, TypeError):
    """An object that holds an open file, a socket or a thread cannot be pickled or copied."""


class MissingLibraryError(BaxterError, ImportError):
    """A system library that a dependency needs, or an optional package, is missing."""


class QuaternionOrderWarning(UserWarning):
    """A quaternion, read as x, y, z, w, that was probably written with w first."""


def _remade(cls: type[BaxterError], args: tuple[Any, ...], facts: dict[str, Any]) -> BaxterError:
    error = cls.__new__(cls, *args)
    error.args = args
    error.__dict__.update(facts)
    return error
