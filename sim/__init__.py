"""Executes plans on a kinematic world, records what happens, and shows it.

Names are loaded when they are first used, as those of `baxter_kin`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import loader

if TYPE_CHECKING:
    from sim.errors import SimulationError
    from sim.events import Event, EventKind, Observer, Snapshot
    from sim.outcome import Dwell, Outcome
    from sim.perception.closed_loop import ClosedLoop
    from sim.perception.noisy_poses import Noise, NoisyPoses
    from sim.perception.pose_source import PoseSource, TruePoses
    from sim.perception.transfer import Transfer
    from sim.recording.csv_writing import write_csv
    from sim.recording.log_recorder import LogRecorder
    from sim.recording.npz_file import load_recording, save_recording
    from sim.recording.playback import retell
    from sim.recording.plot import plot_recording
    from sim.recording.reading.bag_reading import read_bag
    from sim.recording.reading.by_suffix import read_recording
    from sim.recording.reading.log_reading import read_log
    from sim.recording.reading.mcap_reading import read_mcap
    from sim.recording.reading.rsdk_reading import read_rsdk_csv
    from sim.recording.recorder import Recorder
    from sim.recording.recording import Recording
    from sim.recording.ros1_files.bag_file import BagRecorder, write_bag
    from sim.recording.ros1_files.mcap_file import McapRecorder, write_mcap
    from sim.recording.rsdk_csv import CsvRecorder
    from sim.simulation import Simulation
    from sim.view.live.tip_target import TipTarget
    from sim.view.live.viewer import Viewer
    from sim.view.replay import Replay, write_replay
    from sim.workbench.task_result import TaskResult
    from sim.workbench.workbench import Workbench
    from sim.world.gripper import Closing
    from sim.world.world import World

__all__ = [
    "BagRecorder",
    "ClosedLoop",
    "Closing",
    "CsvRecorder",
    "Dwell",
    "Event",
    "EventKind",
    "LogRecorder",
    "McapRecorder",
    "Noise",
    "NoisyPoses",
    "Observer",
    "Outcome",
    "PoseSource",
    "Recorder",
    "Recording",
    "Replay",
    "Simulation",
    "SimulationError",
    "Snapshot",
    "TaskResult",
    "TipTarget",
    "Transfer",
    "TruePoses",
    "Viewer",
    "Workbench",
    "World",
    "load_recording",
    "plot_recording",
    "read_bag",
    "read_log",
    "read_mcap",
    "read_recording",
    "read_rsdk_csv",
    "retell",
    "save_recording",
    "write_bag",
    "write_csv",
    "write_mcap",
    "write_replay",
]

__getattr__ = loader(
    __name__,
    (
        "baxter_kin.kinematics.pinocchio_loading",
        "sim.perception.closed_loop",
        "sim.perception.transfer",
        "sim.world.contacts",
        "sim.errors",
        "sim.events",
        "sim.world.falling",
        "sim.world.gripper",
        "sim.recording.reading.bag_reading",
        "sim.recording.reading.by_suffix",
        "sim.recording.reading.log_reading",
        "sim.recording.reading.mcap_reading",
        "sim.recording.ros1_files.bag_file",
        "sim.recording.ros1_files.mcap_file",
        "sim.perception.noisy_poses",
        "sim.outcome",
        "sim.perception.pose_log",
        "sim.perception.pose_source",
        "sim.recording.recorded_motion",
        "sim.recording.recorder",
        "sim.recording.recording",
        "sim.recording.log_recorder",
        "sim.recording.npz_file",
        "sim.recording.playback",
        "sim.recording.plot",
        "sim.recording.csv_writing",
        "sim.recording.rsdk_csv",
        "sim.recording.reading.rsdk_reading",
        "sim.simulation",
        "sim.world.world",
        "sim.view.replay",
        "sim.view.live.tip_target",
        "sim.view.live.viewer",
        "sim.workbench.task_result",
        "sim.workbench.workbench",
    ),
)
