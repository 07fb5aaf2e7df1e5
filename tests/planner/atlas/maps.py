"""Maps that tests copy, change and build again."""

from __future__ import annotations

import hashlib
import json
import resource
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from baxter_kin.parallel import Engine, Serial
from planner.atlas import BlockReport
from planner.atlas.block_map import BlockMap, MapDefinition
from planner.atlas.building import build


class BuiltMap(NamedTuple):
    """A map, and what it takes to build it."""

    map: BlockMap
    definition: MapDefinition

    @property
    def path(self) -> Path:
        return self.map.path

    def copied(self, path: Path) -> BuiltMap:
        """A copy that may be changed."""
        return self._replace(map=type(self.map)(shutil.copytree(self.path, path)))

    def build(
        self,
        path: Path,
        *,
        engine: Engine | None = None,
        progress: Callable[[int, int, BlockReport], object] | None = None,
    ) -> BlockMap:
        """Build what is missing of a map at a path, in this process by default."""
        return build(
            type(self.map),
            path,
            self.definition,
            engine=Serial() if engine is None else engine,
            progress=progress,
        )


def digests(path: Path) -> dict[str, str]:
    """SHA-256 of every file of a map."""
    return {
        str(file.relative_to(path)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(path.rglob("*"))
        if file.is_file()
    }


def chunk(found: BlockMap, block: tuple[int, ...], layer: int = 0) -> Path:
    """The file of a block."""
    file = found.path.joinpath(found.KIND.layers[layer], "c", *map(str, block))
    while file.is_dir():
        file /= "0"
    return file


def damage(file: Path) -> None:
    """Change one bit."""
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 4
    file.write_bytes(content)


def change_attributes(path: Path, **changes: Any) -> None:
    """Change what a map says of itself; None removes an attribute."""
    file = path / "zarr.json"
    facts = json.loads(file.read_text())
    attributes = facts["attributes"] | changes
    facts["attributes"] = {name: v for name, v in attributes.items() if v is not None}
    file.write_text(json.dumps(facts))


@contextmanager
def small_files(room: int) -> Iterator[None]:
    """The system itself refuses to write more into a file, here and in processes that begin.

    Python would keep modules that it compiles meanwhile, cut off, for all later processes.
    """
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "dont_write_bytecode", True)
        patch.setenv("PYTHONDONTWRITEBYTECODE", "1")
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
