"""What happened on the network that nobody is told of otherwise."""

from __future__ import annotations

import threading

from baxter_kin.fields import evolve, frozen
from sim.errors import RosError


@frozen(error=RosError, eq=True)
class Counts:
    """How often something happened since the node began.

    Attributes:
        malformed: peers that were sent away because of what they sent, or did not send in time.
        refused: connections refused for a reason that was told to the peer, as another md5 sum.
        dropped: messages that were replaced by newer ones before a slow reader took them.
        reconnects: connections to publishers that were made anew after they broke.
        registrations: how often everything was registered anew at a master that had forgotten it.
        faults: errors in callbacks and handlers; each is in the log.
    """

    malformed: int = 0
    refused: int = 0
    dropped: int = 0
    reconnects: int = 0
    registrations: int = 0
    faults: int = 0


class Tally:
    """Counts while they grow; any thread may add."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts = Counts()

    def add(self, name: str) -> None:
        """Count one more of a field of `Counts`."""
        with self._lock:
            grown: dict[str, int] = {name: getattr(self._counts, name) + 1}
            self._counts = evolve(self._counts, **grown)

    @property
    def counts(self) -> Counts:
        """What was counted so far."""
        return self._counts
