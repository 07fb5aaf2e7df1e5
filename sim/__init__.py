"""Executes plans on a kinematic world, records what happens, and shows it.

Names are loaded when they are first used, as those of `baxter_kin`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import loader

if TYPE_CHECKING:
    from sim.closed_loop import Attempt, ClosedLoop, LoopResult, Transfer
    from sim.closing import Closing
    from sim.contacts import Contact
    from sim.errors import RecordingError, SimulationError, ViewerError
    from sim.events import Event, EventKind, Observer, Snapshot
    from sim.falling import Rest
    from sim.gripper import Gripper, GripperState
    from sim.log_reading import read_log
    from sim.mcap_file import McapRecorder
    from sim.noisy_poses import Noise, NoisyPoses
    from sim.outcome import Dwell, Outcome
    from sim.pose_log import LoggedPoses, Look, ReplayedPoses, read_looks
    from sim.pose_source import PoseSource, Sighting, TruePoses
    from sim.recorded_motion import ArmMotion, RecordedMove
    from sim.recorder import Recorder
    from sim.recording import NotedRecording, Recording
    from sim.recording_log import LogRecorder
    from sim.retelling import retell
    from sim.rsdk_csv import CsvRecorder
    from sim.rsdk_reading import read_rsdk_csv
    from sim.simulation import Simulation
    from sim.squeeze import Push
    from sim.world import World

__all__ = [
    "ArmMotion",
    "Attempt",
    "ClosedLoop",
    "Closing",
    "Contact",
    "CsvRecorder",
    "Dwell",
    "Event",
    "EventKind",
    "Gripper",
    "GripperState",
    "LogRecorder",
    "LoggedPoses",
    "Look",
    "LoopResult",
    "McapRecorder",
    "Noise",
    "NoisyPoses",
    "NotedRecording",
    "Observer",
    "Outcome",
    "PoseSource",
    "Push",
    "RecordedMove",
    "Recorder",
    "Recording",
    "RecordingError",
    "ReplayedPoses",
    "Rest",
    "Sighting",
    "Simulation",
    "SimulationError",
    "Snapshot",
    "Transfer",
    "TruePoses",
    "ViewerError",
    "World",
    "read_log",
    "read_looks",
    "read_rsdk_csv",
    "retell",
]

__getattr__ = loader(
    __name__,
    (
        "baxter_kin.pinocchio_loading",
        "sim.closed_loop",
        "sim.closing",
        "sim.contacts",
        "sim.errors",
        "sim.events",
        "sim.falling",
        "sim.gripper",
        "sim.log_reading",
        "sim.mcap_file",
        "sim.noisy_poses",
        "sim.outcome",
        "sim.pose_log",
        "sim.pose_source",
        "sim.recorded_motion",
        "sim.recorder",
        "sim.recording",
        "sim.recording_log",
        "sim.retelling",
        "sim.rsdk_csv",
        "sim.rsdk_reading",
        "sim.simulation",
        "sim.squeeze",
        "sim.world",
    ),
)
