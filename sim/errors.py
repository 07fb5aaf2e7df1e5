"""What this layer raises; the root is `baxter_kin.errors.BaxterError`.

```
BaxterError
└── SimulationError       an order that the world cannot follow
    ├── ViewerError       the live view cannot be served
    └── RecordingError    a recording that is none, or cannot be read or written
                          (also ValueError)
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
