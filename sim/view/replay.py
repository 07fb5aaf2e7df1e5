"""One self-contained HTML page that replays a recording: no network, no server, no installation.

Meshcat's viewer, the robot, the bodies and their motion are all inside. Motion is kept as keyframes
of joints and bodies, so a page of a minute weighs little more than the robot it shows. It goes to a
file with `write_replay`, or into a notebook with `Replay`.
"""

from __future__ import annotations

import html
import math
from collections.abc import Collection

from baxter_kin import Baxter
from baxter_kin.display import OneLine, shown_path
from baxter_kin.files import PathLike, replace_file
from baxter_kin.model import given_or_stock
from baxter_kin.validation import positive_scalar
from planner import Plan
from planner.collision.robot.robot_body import RobotBody
from sim.errors import RecordingError
from sim.files import explained
from sim.recording.recorder import planned_recording
from sim.recording.recording import Recording
from sim.view.appearance import Appearance
from sim.view.replay_content import check_replayed, encoded_content
from sim.view.webpage import inside_script, page, viewer_bundle

__all__ = ["Replay", "encoded_content", "replay_html", "write_replay"]

TITLE = "Baxter: pick and place"

FRAME_HEIGHT_PX = 520
"""Height of a replay in a notebook."""


class Replay(OneLine):
    """A replay that shows itself where a notebook prints it.

    The page is in the notebook, as the `srcdoc` of a frame: it needs no file and no server beside
    it, so it also plays in notebooks exported to HTML and with kernels on other machines.

    Attributes:
        html: the page, as `replay_html` gives it.
        height_px: how high the frame is; it is as wide as the cell.
    """

    def __init__(
        self,
        recording: Recording | Plan,
        robot: Baxter | None = None,
        *,
        height_px: int = FRAME_HEIGHT_PX,
        title: str = TITLE,
        body: RobotBody | None = None,
        compare: Recording | Plan | None = None,
        uncounted: Collection[str] = (),
    ) -> None:
        """Make the page.

        Args:
            recording: what happened; or a valid plan, which is then shown as if it had happened,
                in the world that it was made for.
            robot: the robot it happened to, or is for; the stock robot when not given.
            height_px: how high the frame shall be.
            title: shown on the page.
            body: what plans are made with, to be seen instead of the meshes, or with them.
            compare: a recording or plan of the same robot, seen as a ghost; both begin at once.
            uncounted: names of bodies that are drawn only, and are no part of the clearance.

        Raises:
            RecordingError: when there is nothing to replay, it is of another robot, a plan is not
                valid, or the height is not a positive number.
        """
        self.height_px = math.ceil(positive_scalar(height_px, "height_px", RecordingError))
        self.html = replay_html(
            recording, robot, title=title, body=body, compare=compare, uncounted=uncounted
        )

    def _facts(self) -> tuple[str, ...]:
        return f"page of {len(self.html) / 1e6:.1f} MB", f"{self.height_px} px high"

    def _repr_html_(self) -> str:
        """The page in a frame, where it runs scripts but reaches neither notebook nor server."""
        escaped = self.html.replace("&", "&amp;").replace('"', "&quot;")
        return (
            f'<iframe srcdoc="{escaped}" width="100%" height="{self.height_px}" '
            'style="border: 0" sandbox="allow-scripts" title="Replay"></iframe>'
        )


def write_replay(
    path: PathLike,
    recording: Recording | Plan,
    robot: Baxter | None = None,
    *,
    title: str = TITLE,
    body: RobotBody | None = None,
    compare: Recording | Plan | None = None,
) -> None:
    """Write the replay to a file, all of it or nothing.

    Args:
        path: the HTML file; an older one is replaced.
        recording: what happened; or a valid plan, shown as if it had happened.
        robot: the robot it happened to, or is for; the stock robot when not given.
        title: shown on the page, and its name in the browser.
        body: what plans are made with; the page then shows it or the meshes or both, as chosen
            there, and is 2 MB larger.
        compare: a recording or plan of the same robot, seen as a ghost; both begin at once.

    Raises:
        RecordingError: when there is nothing to replay, it is of another robot, a plan is not
            valid, or the file cannot be written.
    """
    text = replay_html(recording, robot, title=title, body=body, compare=compare)
    with explained(f"cannot write the replay to {shown_path(path)}"):
        replace_file(path, text.encode())


def replay_html(
    recording: Recording | Plan,
    robot: Baxter | None = None,
    *,
    title: str = TITLE,
    body: RobotBody | None = None,
    compare: Recording | Plan | None = None,
    uncounted: Collection[str] = (),
) -> str:
    """The replay as the text of a page; arguments as of `Replay`."""
    known = given_or_stock(robot, RecordingError)
    hint = "; give that robot as robot=..." if robot is None else ""
    happened = _recording(recording, known, body, hint)
    other = None if compare is None else _recording(compare, known, body, hint)
    data = encoded_content(happened, known, body=body, compare=other, uncounted=uncounted)
    return page(
        "replay.html",
        title=html.escape(str(title)),
        notice=html.escape(Appearance.of(known).notice),
        bundle=inside_script(viewer_bundle()),
        data=data,
    )


def _recording(
    shown: Recording | Plan, robot: Baxter, body: RobotBody | None, hint: str
) -> Recording:
    """What is to be replayed, if it is of that robot; a plan as it would be recorded."""
    check_replayed(shown, robot, hint)
    if isinstance(shown, Recording):
        return shown
    return planned_recording(shown, robot, body=body)
