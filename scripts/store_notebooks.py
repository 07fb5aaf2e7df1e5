"""Run the notebooks and store their outputs: `python scripts/store_notebooks.py [NAME ...]`.

Each runs from top to bottom in a new kernel; then replays and live views are replaced by still
pictures (`notebook_runs.stills`), so that a notebook of a megabyte at most shows on the web what it
does. It also holds a digest of its code, by which a test finds outputs that are out of date.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import nbformat
from nbformat import NotebookNode
from notebook_runs.notebooks import (
    DIGEST,
    FOLDER,
    NAMES,
    code_cells,
    digest,
    executed,
    faults,
    read,
)
from notebook_runs.stills import photographer

from baxter_kin.files import replace_file

LARGEST_BYTES = 1_000_000


def main(argv: Sequence[str] | None = None) -> int:
    """Store all notebooks, or those that are named; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("names", nargs="*", default=NAMES, metavar="NAME", help=", ".join(NAMES))
    complaints = []
    for name in parser.parse_args(argv).names:
        notebook = with_outputs(read(name))
        complaints += [f"{name}: {fault}" for fault in (*faults(notebook), *unlucky(notebook))]
        content = (nbformat.writes(notebook) + "\n").encode()
        replace_file(FOLDER / f"{name}.ipynb", content)
        print(f"{name}: {len(content) / 1e3:.0f} kB", flush=True)
        if len(content) > LARGEST_BYTES:
            complaints.append(f"{name} is larger than {LARGEST_BYTES / 1e6:g} MB")
    print(*complaints, sep="\n", end="\n" if complaints else "", file=sys.stderr)
    return 1 if complaints else 0


def with_outputs(notebook: NotebookNode) -> NotebookNode:
    """The notebook as it is stored after it has run."""
    with TemporaryDirectory() as folder:
        ran = executed(notebook, Path(folder), after_cell=photographer())
    ran.metadata = notebook.metadata
    ran.metadata[DIGEST] = digest(notebook)
    for number, cell in enumerate(code_cells(ran), start=1):
        cell.execution_count = number
        for output in cell.outputs:
            if "execution_count" in output:
                output.execution_count = number
    return ran


def unlucky(notebook: NotebookNode) -> Iterator[str]:
    """What succeeds on a quiet machine and did not here, such as a driver that came too late."""
    for cell in code_cells(notebook):
        said = "".join(output.get("text", "") for output in cell.outputs)
        if 'print("success" if' in cell.source and not re.search(r"^success", said, re.MULTILINE):
            yield f"cell {cell.id!r} should tell a success; run this again: {said.splitlines()[0]}"
        if re.search(r"the last state of|comes at .* Hz", said):
            yield f"cell {cell.id!r} came too late on this machine; run this again, with less to do"


if __name__ == "__main__":
    sys.exit(main())
