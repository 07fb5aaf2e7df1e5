"""What happened, as data and files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import loader

if TYPE_CHECKING:
    from sim.recording.csv_writing import PlanCsvFile, write_csv
    from sim.recording.recorded_motion import ArmMotion, RecordedMove
    from sim.recording.recording import Commands, NotedRecording
    from sim.recording.response import fit_response

__all__ = [
    "ArmMotion",
    "Commands",
    "NotedRecording",
    "PlanCsvFile",
    "RecordedMove",
    "fit_response",
    "write_csv",
]

__getattr__ = loader(
    __name__,
    (
        "sim.recording.response",
        "sim.recording.csv_writing",
        "sim.recording.recorded_motion",
        "sim.recording.recording",
    ),
)
