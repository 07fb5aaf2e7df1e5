"""A first task of one's own, as the README has it: a notebook, and a page in it that watches."""

from __future__ import annotations

import asyncio
import os
import re
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import AsyncKernelManager

import sim
from tests.sim.conftest import Watched

CELLS = (
    """\
from sim import Viewer, Workbench

viewer = Viewer()
viewer
""",
    """\
bench = Workbench(observers=[viewer])
bench.add_block("red", 0.70, 0.15)
bench.add_block("blue", 0.70, -0.10)
print(bench.carry("red", to=(0.75, 0.0)))
print(bench.carry("red", onto="blue"))
""",
    """\
viewer.close()
bench.replay()
""",
)
LONGEST_CELL_S = 300
LONGEST = 15
"""Lines of code."""


async def started() -> tuple[AsyncKernelManager, Any]:
    """A kernel of this very Python, and a client of it."""
    manager = AsyncKernelManager(kernel_spec_manager=KernelSpecManager(kernel_dirs=[]))
    await manager.start_kernel()
    client: Any = manager.client()
    client.start_channels()
    await client.wait_for_ready(timeout=LONGEST_CELL_S)
    return manager, client


async def ended(manager: AsyncKernelManager) -> None:
    """No kernel, and nothing left of it."""
    await manager.shutdown_kernel(now=True)
    manager.context.destroy()


async def run(client: Any, code: str) -> dict[str, str]:
    """What a cell prints and shows, by kind."""
    shown: dict[str, str] = {}

    def take(message: dict[str, Any]) -> None:
        content = message["content"]
        if message["msg_type"] == "stream":
            shown[content["name"]] = shown.get(content["name"], "") + content["text"]
        elif message["msg_type"] == "error":
            shown["error"] = "\n".join(content["traceback"])
        elif "data" in content:
            shown.update(content["data"])

    await client.execute_interactive(code, output_hook=take, timeout=LONGEST_CELL_S)
    return shown


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[Callable[[str], Future[dict[str, str]]]]:
    """Runs a cell, in a loop of its own: a browser's runs in this thread."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()
    settings = {"IPYTHONDIR": str(tmp_path), "JUPYTER_RUNTIME_DIR": str(tmp_path)}
    settings |= {"PYTHONPATH": str(Path(sim.__file__).parents[1]), "JUPYTER_PLATFORM_DIRS": "1"}
    with mock.patch.dict(os.environ, settings):
        manager, client = asyncio.run_coroutine_threadsafe(started(), loop).result()
        yield lambda code: asyncio.run_coroutine_threadsafe(run(client, code), loop)
        client.stop_channels()
        asyncio.run_coroutine_threadsafe(ended(manager), loop).result()
    loop.call_soon_threadsafe(loop.stop)
    thread.join()
    loop.close()


def test_it_is_short() -> None:
    lines = [line for code in CELLS for line in code.splitlines() if line]
    assert len(lines) <= LONGEST


@pytest.mark.slow
def test_it_is_watched_live_and_ends_as_a_replay(
    cell: Callable[[str], Future[dict[str, str]]], watched: Watched
) -> None:
    first = cell(CELLS[0]).result()
    assert set(first) == {"text/plain", "text/html"}
    frame = re.search(r'src="(http://127\.0\.0\.1:\d+/)"', first["text/html"])
    assert frame is not None
    watched.page.goto(frame[1])
    watched.page.wait_for_function("Boolean(element('caption'))")
    working = cell(CELLS[1])
    watched.page.wait_for_function("element('caption').textContent.startsWith('red: ')")
    assert watched.run("'red' in viewer.scene_tree.find(['bodies']).children")
    second = working.result()
    assert set(second) == {"stdout"}
    assert [line.partition(" by ")[0] for line in second["stdout"].splitlines()] == [
        "carry red: done"
    ] * 2
    third = cell(CELLS[2]).result()
    assert "<iframe srcdoc=" in third["text/html"]
    assert {"error", "stderr"}.isdisjoint(first | second | third)
