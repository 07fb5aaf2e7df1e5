"""What happened, as data and files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import loader

if TYPE_CHECKING:
    from sim.recording.recorded_motion import ArmMotion, RecordedMove
    from sim.recording.recording import NotedRecording

__all__ = ["ArmMotion", "NotedRecording", "RecordedMove"]

__getattr__ = loader(
    __name__,
    (
        "sim.recording.recorded_motion",
        "sim.recording.recording",
    ),
)
