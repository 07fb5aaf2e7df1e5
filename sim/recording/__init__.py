"""What happened, as data and files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import lazy

if TYPE_CHECKING:
    from sim.recording.comparison import Comparison as Comparison
    from sim.recording.comparison import compare_run as compare_run
    from sim.recording.formats.rsdk_csv import PlanCsvFile as PlanCsvFile
    from sim.recording.formats.rsdk_csv import write_csv as write_csv
    from sim.recording.recorded_motion import ArmMotion as ArmMotion
    from sim.recording.recorded_motion import RecordedMove as RecordedMove
    from sim.recording.recorded_plan import RecordedPlan as RecordedPlan
    from sim.recording.recorded_plan import motion_from as motion_from
    from sim.recording.recording import Commands as Commands
    from sim.recording.recording import NotedRecording as NotedRecording
    from sim.recording.recording import fit_response as fit_response

__all__, __getattr__ = lazy(
    __name__,
    {
        "ArmMotion": "sim.recording.recorded_motion",
        "Commands": "sim.recording.recording",
        "Comparison": "sim.recording.comparison",
        "NotedRecording": "sim.recording.recording",
        "PlanCsvFile": "sim.recording.formats.rsdk_csv",
        "RecordedMove": "sim.recording.recorded_motion",
        "RecordedPlan": "sim.recording.recorded_plan",
        "compare_run": "sim.recording.comparison",
        "fit_response": "sim.recording.recording",
        "motion_from": "sim.recording.recorded_plan",
        "write_csv": "sim.recording.formats.rsdk_csv",
    },
)
