"""Executes plans on a kinematic world, records what happens, and shows it.

Names are loaded when they are first used, as those of `baxter_kin`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import lazy

if TYPE_CHECKING:
    from sim.errors import SimulationError as SimulationError
    from sim.events import Event as Event
    from sim.events import EventKind as EventKind
    from sim.events import Observer as Observer
    from sim.events import Snapshot as Snapshot
    from sim.outcome import Dwell as Dwell
    from sim.outcome import Outcome as Outcome
    from sim.perception.closed_loop import ClosedLoop as ClosedLoop
    from sim.perception.closed_loop import Transfer as Transfer
    from sim.perception.pose_source import Noise as Noise
    from sim.perception.pose_source import NoisyPoses as NoisyPoses
    from sim.perception.pose_source import PoseSource as PoseSource
    from sim.perception.pose_source import TruePoses as TruePoses
    from sim.recording.csv_writing import write_csv as write_csv
    from sim.recording.log_recorder import LogRecorder as LogRecorder
    from sim.recording.npz_file import load_recording as load_recording
    from sim.recording.npz_file import save_recording as save_recording
    from sim.recording.playback import retell as retell
    from sim.recording.plot import plot_recording as plot_recording
    from sim.recording.reading.bag_reading import read_bag as read_bag
    from sim.recording.reading.by_suffix import read_recording as read_recording
    from sim.recording.reading.log_reading import read_log as read_log
    from sim.recording.reading.mcap_reading import read_mcap as read_mcap
    from sim.recording.reading.rsdk_reading import read_rsdk_csv as read_rsdk_csv
    from sim.recording.recorder import Recorder as Recorder
    from sim.recording.recording import Recording as Recording
    from sim.recording.ros1_files.bag_file import BagRecorder as BagRecorder
    from sim.recording.ros1_files.bag_file import write_bag as write_bag
    from sim.recording.ros1_files.mcap_file import McapRecorder as McapRecorder
    from sim.recording.ros1_files.mcap_file import write_mcap as write_mcap
    from sim.recording.rsdk_csv import CsvRecorder as CsvRecorder
    from sim.simulation import Simulation as Simulation
    from sim.view.live.tip_target import TipTarget as TipTarget
    from sim.view.live.viewer import Viewer as Viewer
    from sim.view.replay import Replay as Replay
    from sim.view.replay import write_replay as write_replay
    from sim.workbench.task_result import TaskResult as TaskResult
    from sim.workbench.workbench import Workbench as Workbench
    from sim.world.gripper import Closing as Closing
    from sim.world.world import World as World

__all__, __getattr__ = lazy(
    __name__,
    {
        "BagRecorder": "sim.recording.ros1_files.bag_file",
        "ClosedLoop": "sim.perception.closed_loop",
        "Closing": "sim.world.gripper",
        "CsvRecorder": "sim.recording.rsdk_csv",
        "Dwell": "sim.outcome",
        "Event": "sim.events",
        "EventKind": "sim.events",
        "LogRecorder": "sim.recording.log_recorder",
        "McapRecorder": "sim.recording.ros1_files.mcap_file",
        "Noise": "sim.perception.pose_source",
        "NoisyPoses": "sim.perception.pose_source",
        "Observer": "sim.events",
        "Outcome": "sim.outcome",
        "PoseSource": "sim.perception.pose_source",
        "Recorder": "sim.recording.recorder",
        "Recording": "sim.recording.recording",
        "Replay": "sim.view.replay",
        "Simulation": "sim.simulation",
        "SimulationError": "sim.errors",
        "Snapshot": "sim.events",
        "TaskResult": "sim.workbench.task_result",
        "TipTarget": "sim.view.live.tip_target",
        "Transfer": "sim.perception.closed_loop",
        "TruePoses": "sim.perception.pose_source",
        "Viewer": "sim.view.live.viewer",
        "Workbench": "sim.workbench.workbench",
        "World": "sim.world.world",
        "load_recording": "sim.recording.npz_file",
        "plot_recording": "sim.recording.plot",
        "read_bag": "sim.recording.reading.bag_reading",
        "read_log": "sim.recording.reading.log_reading",
        "read_mcap": "sim.recording.reading.mcap_reading",
        "read_recording": "sim.recording.reading.by_suffix",
        "read_rsdk_csv": "sim.recording.reading.rsdk_reading",
        "retell": "sim.recording.playback",
        "save_recording": "sim.recording.npz_file",
        "write_bag": "sim.recording.ros1_files.bag_file",
        "write_csv": "sim.recording.csv_writing",
        "write_mcap": "sim.recording.ros1_files.mcap_file",
        "write_replay": "sim.view.replay",
    },
)
