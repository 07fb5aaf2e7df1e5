"""The demo's live view: served, opened in a browser where there is one, and left as it ended."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

from sim.demo.narration import Narrator
from sim.demo.options import DemoOptions
from sim.view.live.in_browser import can_open, open_page, where_to_look
from sim.world.world import World

if TYPE_CHECKING:  # a headless run needs no web server
    from sim.view.live.viewer import Viewer


def live_view(
    options: DemoOptions, world: World, narrator: Narrator, cleanup: ExitStack
) -> tuple[Viewer, ...]:
    """The view, once a page watches or the wait for one is over; empty when headless.

    Args:
        options: what the user asked for.
        world: the scene that is shown first.
        narrator: reports where it is served.
        cleanup: closes the view.

    Raises:
        ViewerError: when it cannot be served.
    """
    if options.is_headless:
        return ()
    from sim.view.live.viewer import Viewer  # noqa: PLC0415 - a headless run needs no web server

    viewer = cleanup.enter_context(Viewer(world.robot, port=options.port))
    viewer.show(world.q, {}, "ready")
    is_opened = not options.no_browser and can_open(os.environ, sys.platform)
    for line in where_to_look(viewer.url, os.environ, is_opened, options.wait_s):
        narrator.say(line)
    if is_opened:
        open_page(viewer.url)
    viewer.wait_for_client(options.wait_s)
    return (viewer,)


@contextmanager
def shown(views: Iterable[Viewer], failure: Callable[[], str | None]) -> Iterator[None]:
    """Keep pages live inside the block; afterwards they replay what was shown and name the failure.

    Args:
        views: the live view, if there is one.
        failure: returns at the end what failed, or None.
    """
    with ExitStack() as cleanup:
        for viewer in views:
            cleanup.enter_context(viewer)  # shows what is raised
        yield
        for viewer in views:
            viewer.close(failure() or "")
