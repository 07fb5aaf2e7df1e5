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
    from sim.perception.closed_loop import ClosedLoop as ClosedLoop
    from sim.perception.closed_loop import Transfer as Transfer
    from sim.perception.pose_source import Noise as Noise
    from sim.perception.pose_source import NoisyPoses as NoisyPoses
    from sim.perception.pose_source import PoseSource as PoseSource
    from sim.perception.pose_source import TruePoses as TruePoses
    from sim.recording.formats.rsdk_csv import write_csv as write_csv
    from sim.recording.plot import plot_recording as plot_recording
    from sim.recording.record_file import read_recording as read_recording
    from sim.recording.record_file import save_recording as save_recording
    from sim.recording.recorder import Recorder as Recorder
    from sim.recording.recording import Recording as Recording
    from sim.recording.recording import play_back as play_back
    from sim.simulation import Dwell as Dwell
    from sim.simulation import Outcome as Outcome
    from sim.simulation import Simulation as Simulation
    from sim.view.live.tip_target import TipTarget as TipTarget
    from sim.view.live.viewer import Viewer as Viewer
    from sim.view.replay import Replay as Replay
    from sim.view.replay import write_replay as write_replay
    from sim.workbench.lettering import text_strokes as text_strokes
    from sim.workbench.workbench import TaskResult as TaskResult
    from sim.workbench.workbench import Workbench as Workbench
    from sim.world.gripper import Closing as Closing
    from sim.world.world import World as World

__all__, __getattr__ = lazy(
    __name__,
    {
        "ClosedLoop": "sim.perception.closed_loop",
        "Closing": "sim.world.gripper",
        "Dwell": "sim.simulation",
        "Event": "sim.events",
        "EventKind": "sim.events",
        "Noise": "sim.perception.pose_source",
        "NoisyPoses": "sim.perception.pose_source",
        "Observer": "sim.events",
        "Outcome": "sim.simulation",
        "PoseSource": "sim.perception.pose_source",
        "Recorder": "sim.recording.recorder",
        "Recording": "sim.recording.recording",
        "Replay": "sim.view.replay",
        "Simulation": "sim.simulation",
        "SimulationError": "sim.errors",
        "Snapshot": "sim.events",
        "TaskResult": "sim.workbench.workbench",
        "TipTarget": "sim.view.live.tip_target",
        "Transfer": "sim.perception.closed_loop",
        "TruePoses": "sim.perception.pose_source",
        "Viewer": "sim.view.live.viewer",
        "Workbench": "sim.workbench.workbench",
        "World": "sim.world.world",
        "play_back": "sim.recording.recording",
        "plot_recording": "sim.recording.plot",
        "read_recording": "sim.recording.record_file",
        "save_recording": "sim.recording.record_file",
        "text_strokes": "sim.workbench.lettering",
        "write_csv": "sim.recording.formats.rsdk_csv",
        "write_replay": "sim.view.replay",
    },
)
