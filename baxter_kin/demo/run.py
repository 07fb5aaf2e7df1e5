"""The demo itself: scene, start, picks, places, clean-up; the choices of all layers meet here."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import count
from pathlib import Path

import numpy as np
import pinocchio as pin

from baxter_kin.demo.interrupt import Interrupt
from baxter_kin.demo.live import LiveView
from baxter_kin.demo.narration import Narrator
from baxter_kin.demo.options import Options
from baxter_kin.demo.report import Point, Report
from baxter_kin.errors import BaxterError
from baxter_kin.frames import T_world_base, pose_from_quaternion
from baxter_kin.model import Baxter
from planner import (
    Body,
    Box,
    Manipulator,
    Part,
    PickAndPlace,
    Plan,
    load_object,
    plan_pick_and_place,
    plan_start_move,
    save_plan,
    transfer_bound_s,
)
from sim import (
    CsvRecorder,
    LogRecorder,
    McapRecorder,
    Observer,
    Recorder,
    RecordingError,
    Simulation,
    Snapshot,
    World,
)

OVERHEAD_XYZW = (-0.0249590815779, 0.999649402929, 0.00737916180073, 0.00486450832011)
"""The original demo's tool orientation: pointing down, tilted by 1 degree."""

TABLE_WORLD_M = (1.0, 0.0, 0.0)
BLOCK_WORLD_M = (0.6725, 0.1265, 0.7825)
"""Where the original spawns table and block, for its left arm; the block drops 7.5 mm."""

BLOCK = "block"
BLOCK_EDGE_M = 0.05
OBSTACLE_RGBA = (0.35, 0.42, 0.5, 1.0)
WAIT_FOR_BROWSER_S = 15.0
REPLAY_SNAPSHOTS = 12_000
"""The replay shows the last two minutes; only --forever ever has more."""


def run_demo(options: Options, interrupt: Interrupt) -> int:
    """Run it; returns the exit status, and raises KeyboardInterrupt once all is cleaned up."""
    narrator = Narrator(options.verbosity)
    try:
        failure = _Demo(options, interrupt, narrator).run()
    except BaxterError as error:
        failure = str(error)
    if failure is not None:
        narrator.complain(f"baxter-demo: {failure}")
    return 0 if failure is None else 1


class _Demo:
    """One run: a simulation, those who watch it, and what is reported of it."""

    def __init__(self, options: Options, interrupt: Interrupt, narrator: Narrator) -> None:
        self._options = options
        self._interrupt = interrupt
        self._narrator = narrator
        self._report = Report(options)
        self._started_s = time.perf_counter()
        self._robot = Baxter.load()
        self._arm = self._robot.arm(options.limb)
        self._world = World(self._robot)
        self._manipulator = Manipulator.of(
            self._robot, options.limb, speed_ratio=options.speed_ratio, q_others=self._world.q
        )
        self._bounds_s: dict[tuple[bytes, bytes], float] = {}

    def run(self) -> str | None:
        """Everything; returns None, or why it failed. Outputs are written however it ends."""
        try:
            self._run()
        except KeyboardInterrupt:
            self._report.failure = "stopped by Ctrl-C"
            raise
        except BaxterError as error:
            self._report.failure = str(error)
        except OSError as error:
            self._report.failure = f"cannot write its output: {error.strerror}"
            raise
        finally:
            self._write_report()
        return self._report.failure

    def _run(self) -> None:
        with ExitStack() as cleanup:
            simulation = Simulation(self._world, self._observers(cleanup))
            with self._scene(simulation):
                self._go(simulation)
            self._report.totals.wall_time_s = time.perf_counter() - self._started_s
            self._narrator.finish(self._report.totals)

    def _go(self, simulation: Simulation) -> None:
        """Enable, move to start, then pick and place until done, failed or stopped."""
        simulation.enable()
        start = self._planned(
            lambda: plan_start_move(
                self._manipulator,
                self._world.scene,
                self._arm_q(),
                self._arm.start,
                margin_m=self._options.margin_m,
            )
        )
        if start.failure is not None:
            self._report.failure = str(start.failure)
            return
        simulation.execute(start)
        cycles = self._options.cycles
        for number in count(1) if cycles is None else range(1, cycles + 1):
            failure = self._cycle(number, simulation)
            if failure is not None:
                self._report.failure = failure
                return
        self._report.failure = None

    def _cycle(self, number: int, simulation: Simulation) -> str | None:
        """One pick and place; returns why it failed, or None."""
        poses = self._options.poses_m
        pick, place = poses[(number - 1) % len(poses)], poses[number % len(poses)]
        self._narrator.start_cycle(number, pick, place)
        task = PickAndPlace(BLOCK, _overhead(pick), _overhead(place), self._options.hover_m)
        plan = self._planned(
            lambda: plan_pick_and_place(
                task,
                self._manipulator,
                self._world.scene,
                self._arm_q(),
                margin_m=self._options.margin_m,
            )
        )
        if number == 1 and self._options.plan is not None:
            save_plan(plan, self._options.plan)
        bound_s = self._transfer_bound_s(task)
        entry = self._report.add_cycle(number, (pick, place), plan, bound_s)
        if plan.failure is not None:
            return f"cycle {number}, {plan.failure}"
        outcome = simulation.execute(plan, f"cycle {number}, ")
        self._report.totals.add(plan, outcome, bound_s)
        entry["success"], entry["failure"] = outcome.is_success, outcome.failure
        entry["duration_s"], entry["block_m"] = outcome.duration_s, self._block_m()
        return None if outcome.is_success else f"cycle {number}, {outcome.failure}"

    def _planned(self, make_plan: Callable[[], Plan]) -> Plan:
        started_s = time.perf_counter()
        with self._interrupt.deferred():
            plan = make_plan()
        self._report.totals.planning_time_s += time.perf_counter() - started_s
        return plan

    def _transfer_bound_s(self, task: PickAndPlace) -> float:
        """What the way from grasp to release takes at least; the same for the same two poses."""
        pick, place = task.T_base_pick, task.T_base_place
        key = pick.homogeneous.tobytes(), place.homogeneous.tobytes()
        if key not in self._bounds_s:
            with self._interrupt.deferred():
                arm = self._manipulator
                self._bounds_s[key] = transfer_bound_s(arm.ik, arm.limits, pick, place)
        return self._bounds_s[key]

    @contextmanager
    def _scene(self, simulation: Simulation) -> Iterator[None]:
        """Table and block are there while the demo runs, and gone when it ends, however it ends."""
        try:
            for body in (
                *obstacles(self._options.obstacles_m),
                *demo_bodies(self._options.limb),
            ):
                simulation.spawn(body)
            self._report.totals.block_start_m = self._block_m()
            yield
        finally:
            self._report.totals.block_final_m = self._block_m()
            for name in reversed(tuple(self._world.scene.bodies)):
                simulation.delete(name)

    def _observers(self, cleanup: ExitStack) -> list[Observer]:
        """Who watches: the watch for Ctrl-C first, the live view, which waits, last."""
        observers: list[Observer] = [_StopWatch(self._interrupt), self._narrator, self._report]
        if self._options.csv is not None:
            csv = CsvRecorder(self._options.csv, self._robot)
            cleanup.callback(csv.close)
            observers.append(csv)
        if self._options.record is not None:
            observers.append(self._recorder(self._options.record, cleanup))
        if self._options.html is not None:
            recorder = Recorder(self._robot, keep=REPLAY_SNAPSHOTS)
            cleanup.callback(self._write_replay, self._options.html, recorder)
            observers.append(recorder)
        if not self._options.is_headless:
            observers.append(self._live(cleanup))
        return observers

    def _recorder(self, path: Path, cleanup: ExitStack) -> Observer:
        """What writes everything that happens, in the format that the suffix says."""
        if path.suffix == ".npz":
            recorder = Recorder(self._robot)
            cleanup.callback(_save, recorder, path)
            return recorder
        make = LogRecorder if path.suffix == ".jsonl" else McapRecorder
        stream = make(path, self._robot)
        cleanup.callback(stream.close)
        return stream

    def _live(self, cleanup: ExitStack) -> LiveView:
        from sim.viewer import Viewer  # noqa: PLC0415 - a headless run needs no web server

        viewer = cleanup.enter_context(Viewer(self._robot))
        viewer.show(self._world.q, {}, "ready")
        self._narrator.say(f"open {viewer.url} in a browser to watch")
        self._narrator.say(f"(starts when the page is open, or in {WAIT_FOR_BROWSER_S:.0f} s)")
        viewer.wait_for_client(WAIT_FOR_BROWSER_S)
        return LiveView(viewer)

    def _write_replay(self, path: Path, recorder: Recorder) -> None:
        from sim.replay import write_replay  # noqa: PLC0415 - only when asked for

        if recorder.has_snapshots:
            write_replay(path, recorder.recording(), self._robot)
            self._narrator.say(f"replay: {path}")

    def _write_report(self) -> None:
        totals = self._report.totals
        totals.wall_time_s = time.perf_counter() - self._started_s
        if self._options.report is None:
            return
        try:
            self._report.write(self._options.report)
        except OSError as cause:
            path, reason = self._options.report, cause.strerror
            raise RecordingError(f"cannot write {path}: {reason}") from cause

    def _arm_q(self) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        return self._world.arm_q(self._options.limb)

    def _block_m(self) -> Point | None:
        if BLOCK not in self._world.scene.bodies:
            return None
        return tuple(self._world.body(BLOCK).centre_base.tolist())


class _StopWatch(Observer):
    """Looks at every tick whether Ctrl-C was pressed."""

    def __init__(self, interrupt: Interrupt) -> None:
        self._interrupt = interrupt

    def on_snapshot(self, snapshot: Snapshot) -> None:  # noqa: ARG002 - only its coming matters
        self._interrupt.check()


def _save(recorder: Recorder, path: Path) -> None:
    if recorder.has_snapshots:
        recorder.recording().save(path)


def _overhead(position_m: Point) -> pin.SE3:
    return pose_from_quaternion(position_m, OVERHEAD_XYZW)


def demo_bodies(limb: str) -> tuple[Body, Body]:
    """Table and block, as spawned; the block on the side of the arm."""
    x, y, z = BLOCK_WORLD_M
    if limb == "right":  # the mirror image of a block whose origin is its corner
        y = -y - BLOCK_EDGE_M
    return (
        load_object("table", _in_base(TABLE_WORLD_M)),
        load_object(BLOCK, _in_base((x, y, z)), is_movable=True),
    )


def obstacles(boxes_m: Sequence[tuple[float, ...]]) -> Iterator[Body]:
    """Boxes that stand in the way, each given by centre in base and size."""
    for number, (x, y, z, dx, dy, dz) in enumerate(boxes_m, start=1):
        centre = pin.SE3(np.eye(3), np.array([x, y, z]))
        part = Part(Box((dx, dy, dz)), pin.SE3.Identity(), OBSTACLE_RGBA)
        yield Body(f"obstacle {number}", (part,), centre)


def _in_base(position_world_m: Point) -> pin.SE3:
    return T_world_base().inverse() * pin.SE3(np.eye(3), np.array(position_world_m))
