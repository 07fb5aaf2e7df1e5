"""Exceptions of this layer; the root is `baxter_kin.errors.BaxterError`.

```
BaxterError
└── SimulationError             an order that the world cannot follow
    ├── ViewerError             the live view cannot be served
    ├── RecordingError          a recording that is invalid, or cannot be read or written
    │                           (also ValueError)
    └── RosError                what goes wrong on a ROS 1 network, or in reaching it
        ├── RosMessageError     an invalid message, type or name       (also ValueError)
        ├── RosConnectionError  a peer or a master that cannot be reached
        │   └── RosUnreachableError  nobody answers where it should be
        └── ServiceRefused      a service that answered with an error
```

A missed grasp is an `Outcome`, not an exception.
"""

from __future__ import annotations

from baxter_kin import BaxterError


class SimulationError(BaxterError):
    """An order that the world cannot follow."""


class ViewerError(SimulationError):
    """The live view cannot be served."""


class RecordingError(SimulationError, ValueError):
    """A recording that is malformed, or cannot be read or written."""


class RosError(SimulationError):
    """What goes wrong on a ROS 1 network, or in reaching it."""


class RosMessageError(RosError, ValueError):
    """A message that does not fit its type, an unknown type, or an invalid name."""


class RosConnectionError(RosError):
    """A peer or a master that cannot be reached, or that does not speak ROS 1.

    Attributes:
        host: where it was looked for, such as "127.0.0.1:11311".
        node: whose it is: the node's name, "the master", or empty where that is not known.
        remedy: what to do about it; it may be empty.
    """

    def __init__(self, reason: str, *, host: str = "", node: str = "", remedy: str = "") -> None:
        self.host = host
        self.node = node
        self.remedy = remedy
        super().__init__(f"{reason}; {remedy}" if remedy else reason)


class RosUnreachableError(RosConnectionError):
    """Nobody answers where a peer or a master should be; it may have ended."""


class ServiceRefused(RosError):  # noqa: N818 - it is an answer, and ours to give too
    """A service that answered with an error; raised by a handler it is that answer."""
