"""What inverse kinematics answered for the waypoints, and where the tip was to go."""

from __future__ import annotations

import pinocchio as pin

from baxter_kin import Baxter
from sim.recording.recorded_motion import RecordedMove
from sim.recording.recording import Recording
from sim.view.meshcat_commands import Command


def recorded_waypoints(recording: Recording, robot: Baxter) -> list[Command]:
    """One for each recorded move, in order; times in seconds from the start of the recording.

    A move that was stopped ends where the next one of its arm begins.
    """
    zero_s, last_s = float(recording.times_s[0]), float(recording.times_s[-1])
    moves = sorted(recording.moves, key=lambda move: move.start_s)
    told = []
    for number, move in enumerate(moves):
        later = [other.start_s for other in moves[number + 1 :] if other.limb == move.limb]
        end_s = min([move.end_s, last_s, *later[:1]])
        if end_s >= zero_s:
            start_s = max(move.start_s, zero_s) - zero_s
            told.append(waypoint(robot, move, start_s, end_s - zero_s))
    return told


def waypoint(robot: Baxter, recorded: RecordedMove, start_s: float, end_s: float | None) -> Command:
    """A move as the page takes it.

    Seed and errors are those of the answer of inverse kinematics, "" and None where it was not
    asked. The goal is the tip's pose at the end of the planned move: x, y, z and quaternion
    x, y, z, w in base.

    Args:
        robot: the robot that moves.
        recorded: the move.
        start_s: when it begins, on the page's clock.
        end_s: when it ends; None while it is under way.
    """
    ik = recorded.ik
    return {
        "start": start_s,
        "end": end_s,
        "side": recorded.limb,
        "label": recorded.label,
        "seed": "" if ik is None else recorded.move.seed_label,
        "position_error_m": None if ik is None else float(ik.position_error_m),
        "orientation_error_rad": None if ik is None else float(ik.orientation_error_rad),
        "goal": pin.SE3ToXYZQUAT(goal_of(robot, recorded)).tolist(),
    }


def goal_of(robot: Baxter, recorded: RecordedMove) -> pin.SE3:
    """Where the tip is at the end of a planned move, in base."""
    arm = robot.arm(recorded.limb)
    order = [recorded.joint_names.index(name) for name in arm.joint_names]
    return arm.T_base_tip(recorded.trajectory.q_goal[order])
