"""Runs a notebook in a new kernel: of this Python or another one, with few settings."""

from __future__ import annotations

import asyncio
import json
import os
import re
import subprocess
import sys
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractAsyncContextManager, asynccontextmanager, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest import mock

import nbformat
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError
from nbformat import NotebookNode

from notebook_runs.notebooks import FOLDER

CHECKOUT = Path(__file__).parents[2]
LONGEST_CELL_S = 300
FILL_FONT_CACHE = "from matplotlib import font_manager; font_manager.get_font_names()"
"""Else the first kernel says on stderr that it does."""

AfterCell = Callable[[NotebookNode], Awaitable[None]]
"""Called with a code cell that has just run, while the kernel lives."""

Watching = Callable[[], AbstractAsyncContextManager[AfterCell]]

ATTEMPTS = 3
TOO_LATE = re.compile(r"NotReadyError.*(comes at .* Hz|the last state of)", re.DOTALL)
"""What a driver says on a machine that has too much else to do; then the notebook runs again."""


@asynccontextmanager
async def nobody() -> AsyncIterator[AfterCell]:
    """Leaves the cells as they are."""

    async def leave(_: NotebookNode) -> None:
        pass

    yield leave


def executed(
    notebook: NotebookNode,
    folder: Path,
    *,
    python: Path | None = None,
    watching: Watching = nobody,
) -> NotebookNode:
    """A copy of a notebook with its outputs.

    Args:
        notebook: what to run.
        folder: where its cells write to.
        python: an interpreter with the package and ipykernel installed; None for this one, with the
            packages of this checkout.
        watching: gives what is called after each cell, and ends with the kernel.
    """
    for _ in range(ATTEMPTS - 1):
        try:
            return _executed_once(notebook, folder, python, watching)
        except CellExecutionError as error:  # noqa: PERF203 - each turn takes seconds
            if not TOO_LATE.search(str(error)):
                raise
    return _executed_once(notebook, folder, python, watching)


def _executed_once(
    notebook: NotebookNode, folder: Path, python: Path | None, watching: Watching
) -> NotebookNode:
    notebook = nbformat.from_dict(notebook)
    with (
        TemporaryDirectory() as settings,
        _surroundings(Path(settings), python),
        ThreadPoolExecutor(1) as thread,  # a browser's loop may run in ours
    ):
        manager = AsyncKernelManager(kernel_spec_manager=_specs(Path(settings), python))
        running = _run(notebook, folder, manager, watching)
        thread.submit(asyncio.run, running).result()
    return notebook


async def _run(
    notebook: NotebookNode,
    folder: Path,
    manager: AsyncKernelManager,
    watching: Watching,
) -> None:
    client = NotebookClient(
        notebook,
        km=manager,
        timeout=LONGEST_CELL_S,
        record_timing=False,
        resources={"metadata": {"path": str(folder)}},
    )
    async with client.async_setup_kernel(cleanup_kc=True), watching() as after_cell:
        for index, cell in enumerate(notebook.cells):
            if cell.cell_type == "code":
                await client.async_execute_cell(cell, index)
                await after_cell(cell)
        client.set_widgets_metadata()


def _specs(settings: Path, python: Path | None) -> KernelSpecManager:
    """The one kernel that there is to start.

    Without folders to search it is ipykernel's own, which is this Python.
    """
    if python is None:
        return KernelSpecManager(kernel_dirs=[])
    kernel = settings / "kernels" / "python3"
    kernel.mkdir(parents=True)
    command = [str(python), "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    spec = {"argv": command, "display_name": "Python 3", "language": "python"}
    (kernel / "kernel.json").write_text(json.dumps(spec), "utf-8")
    return KernelSpecManager(kernel_dirs=[str(kernel.parent)], ensure_native_kernel=False)


@contextmanager
def _surroundings(settings: Path, python: Path | None) -> Iterator[None]:
    """What kernels inherit: the lessons, this checkout without `python`, and no settings."""
    paths = [FOLDER] if python is not None else [CHECKOUT, FOLDER]
    inherited = {
        "IPYTHONDIR": str(settings / "ipython"),
        "JUPYTER_RUNTIME_DIR": str(settings / "runtime"),
        "JUPYTER_PLATFORM_DIRS": "1",  # or jupyter_core warns that its folders will change
        "PYTHONPATH": os.pathsep.join(map(str, paths)),
    }
    with mock.patch.dict(os.environ, inherited):
        interpreter = sys.executable if python is None else str(python)
        subprocess.run([interpreter, "-c", FILL_FONT_CACHE], check=True, cwd=settings)
        yield
