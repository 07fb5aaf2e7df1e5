"""Executes plans on a kinematic world, records what happens, and shows it."""

from sim.errors import RecordingError, SimulationError, ViewerError
from sim.events import Event, EventKind, Observer, Snapshot
from sim.gripper import Gripper, GripperState
from sim.recording import CsvRecorder, Recorder, Recording
from sim.simulation import Dwell, Outcome, Simulation
from sim.world import World

__all__ = [
    "CsvRecorder",
    "Dwell",
    "Event",
    "EventKind",
    "Gripper",
    "GripperState",
    "Observer",
    "Outcome",
    "Recorder",
    "Recording",
    "RecordingError",
    "Simulation",
    "SimulationError",
    "Snapshot",
    "ViewerError",
    "World",
]
