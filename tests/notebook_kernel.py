"""The notebooks, and how they are run: each in a new kernel of this very Python, in a folder."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

import nbformat
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from matplotlib import font_manager
from nbclient import NotebookClient
from nbformat import NotebookNode

import baxter_kin

FOLDER = Path(__file__).parents[1] / "notebooks"
NAMES = (
    "1_meet_baxter",
    "2_inverse_kinematics",
    "3_time_optimal_motion",
    "4_pick_and_place",
    "5_your_own_task",
    "6_a_baxter_on_the_network",
)
LONGEST_CELL_S = 300


def read(name: str) -> NotebookNode:
    """A notebook as it is stored."""
    return nbformat.read(FOLDER / f"{name}.ipynb", as_version=nbformat.NO_CONVERT)


def executed(name: str, folder: Path) -> NotebookNode:
    """A notebook with its outputs; what its cells write goes to the folder.

    Raises:
        nbclient.exceptions.CellExecutionError: when a cell fails.
    """
    client = NotebookClient(
        read(name),
        km=_kernel_manager(),
        timeout=LONGEST_CELL_S,
        resources={"metadata": {"path": str(folder)}},
    )
    with _surroundings(folder), ThreadPoolExecutor(1) as thread:  # a browser's loop may run in ours
        return thread.submit(asyncio.run, client.async_execute(cleanup_kc=True)).result()


def _kernel_manager() -> AsyncKernelManager:
    """Starts `sys.executable`, whichever kernels are installed elsewhere.

    Without folders to search, the only kernel is ipykernel's own, which is that.
    """
    return AsyncKernelManager(kernel_spec_manager=KernelSpecManager(kernel_dirs=[]))


@contextmanager
def _surroundings(folder: Path) -> Iterator[None]:
    """What kernels inherit: the packages under test first, and nobody's settings or history."""
    font_manager.get_font_names()  # fills its cache, or the first kernel says that it does
    packages = [str(Path(baxter_kin.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    inherited = {
        "PYTHONPATH": os.pathsep.join(filter(None, packages)),
        "IPYTHONDIR": str(folder / ".ipython"),
        "JUPYTER_RUNTIME_DIR": str(folder / ".jupyter"),
        "JUPYTER_PLATFORM_DIRS": "1",  # or jupyter_core warns that its folders will change
    }
    with mock.patch.dict(os.environ, inherited):
        yield
