"""Executes plans on a kinematic world, records what happens, and shows it."""

import baxter_kin.pinocchio_loading  # noqa: F401 - says what it lacks, before all others
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
