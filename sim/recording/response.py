"""The response of an arm, fitted to the set-points that it was sent and the positions measured.

A `Recorder` that observes an execution on a robot keeps both, and so do npz files and logs that
`python -m sim.ros1.execute --record` writes. A simulation sends no set-points: its arms are where
they are commanded.
"""

from __future__ import annotations

from baxter_kin.errors import UnknownNameError
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import expect
from planner import Response
from planner import fit_response as fit_arrays
from sim.errors import RecordingError
from sim.recording.recording import Recording


def fit_response(recording: Recording, limb: str) -> Response:
    """Bounds on how an arm follows its set-points, from the recording of an execution.

    Args:
        recording: with the commands of that arm.
        limb: "left" or "right".

    Returns:
        What `planner.fit_response` finds in them.

    Raises:
        RecordingError: when no commands of that arm were recorded.
        UnknownNameError: when there is no such limb.
        ResponseError: when they do not tell the response; says why.
    """
    expect(recording, Recording, "recording", RecordingError)
    if not isinstance(limb, str) or limb not in LIMBS:
        raise UnknownNameError("limb", limb, LIMBS)
    if limb not in recording.commands:
        raise RecordingError(
            f"the recording has no set-points of the {limb} arm: a simulation sends none, and of "
            "files only npz and logs keep them; let a Recorder observe an execution on a robot, or "
            "execute with --record FILE.npz"
        )
    sent = recording.commands[limb]
    return fit_arrays(sent.times_s, sent.q_sent, sent.q_measured)
