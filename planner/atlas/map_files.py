"""Maps on disk: Zarr v3 groups (Zarr enters here).

A reach map has

```
zarr.json            attributes: format, grid, arms, the robot and its digest, who computed it
directions           float64, (d, 3, 3): the tip at roll zero
rolls                float64, (k,)
margins              int16, (arm, x, y, z, rotation): steps of RAD_PER_MARGIN, or a code
witnesses            int32, (arm, x, y, z, joint, rotation): steps of RAD_PER_STEP
```

A block of positions is one chunk of both arrays. One task computes and writes it whole, and each
file is put in place at once; the margins come last, so that a block that has them is complete. A
chunk ends with its checksum (CRC-32C) and is not read without. Nothing else is written while a map
is computed: the same block has the same bytes whoever computes it, on the same kind of machine.
Other kinds of maps have other arrays (`Layout`), and the same rules.
"""

from __future__ import annotations

import platform
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from baxter_kin.distribution.extras import run_to_install_extra
from baxter_kin.errors import MissingLibraryError, shown_path
from planner.atlas.positions import BLOCK_EDGE
from planner.atlas.reach_search import NOT_COMPUTED
from planner.errors import AtlasError

FORMAT, VERSION = "baxter-kin reach map", 1


class Layout(NamedTuple):
    """A kind of map.

    Attributes:
        format: what its group says that it is.
        version: of the format.
        name: what messages call it.
        last: the array whose chunk is written last: a block that has it is complete.
        inner: how many axes that array has beside the arm's and those of positions.
    """

    format: str
    version: int
    name: str
    last: str
    inner: int


REACH_MAP = Layout(FORMAT, VERSION, "reach map", "margins", 1)


class Chunked(NamedTuple):
    """An array of cells, of which a block of positions is one chunk.

    Attributes:
        name: its name.
        dtype: of its numbers.
        fill: what stands where nothing is computed.
        inner: names and sizes of the axes beside the arm's and those of positions.
    """

    name: str
    dtype: str
    fill: int
    inner: dict[str, int]


COMPRESSION = 3
"""Level of Zstandard: a third of the bytes; higher levels save little and take longer."""

Block: TypeAlias = tuple[int, int, int, int]
"""Index of the arm, then of the block along x, y and z."""


def zarr_library() -> Any:
    """Zarr, which only who builds or reads maps needs.

    Raises:
        MissingLibraryError: when it is not installed, or is older than version 3.
    """
    try:
        import zarr  # noqa: PLC0415
    except ImportError as cause:
        raise MissingLibraryError(
            f"maps need zarr, and it Python 3.11 or later; {run_to_install_extra('atlas')}"
        ) from cause
    if int(zarr.__version__.split(".")[0]) < 3:
        raise MissingLibraryError(
            f"maps need zarr 3, this is {zarr.__version__}; {run_to_install_extra('atlas')}"
        )
    return zarr


def kind_of_machine(backend: str) -> str:
    """What the last bits of a result depend on: processor, NumPy, and where searches run."""
    config: Any = np.show_config(mode="dicts")
    found = config["SIMD Extensions"].get("found", [])
    return f"{platform.machine()} {' '.join(found)}, numpy {np.__version__}, {backend}"


def create_group(
    path: Path, attributes: dict[str, Any], directions: Any, rolls: Any, shape: tuple[int, ...]
) -> Any:
    """A group for a new reach map, with nothing computed.

    Args:
        path: a folder that does not exist, or is empty.
        attributes: what the group says of itself.
        directions: shape (d, 3, 3).
        rolls: shape (k,).
        shape: how many arms, and positions along x, y and z.

    Raises:
        AtlasError: when there is something at that path, or it cannot be written.
    """
    rotations = len(directions) * len(rolls)
    chunked = (
        Chunked("margins", "int16", NOT_COMPUTED, {"rotation": rotations}),
        Chunked("witnesses", "int32", 0, {"joint": 7, "rotation": rotations}),
    )
    whole = {"directions": directions, "rolls": rolls}
    return create_arrays(path, attributes, whole, chunked, shape=shape, block_edge=BLOCK_EDGE)


def create_arrays(
    path: Path,
    attributes: dict[str, Any],
    whole: Mapping[str, Any],
    chunked: Sequence[Chunked],
    *,
    shape: tuple[int, ...],
    block_edge: int,
) -> Any:
    """A group for a new map of any kind, with nothing computed.

    Args:
        path: a folder that does not exist, or is empty.
        attributes: what the group says of itself.
        whole: arrays that are there from the beginning, by name.
        chunked: those that are computed block by block.
        shape: how many arms, and positions along x, y and z.
        block_edge: positions along each side of a block.

    Raises:
        AtlasError: when there is something at that path, or it cannot be written.
    """
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise AtlasError(f"{shown_path(path)} exists and is no map; choose another path")
    zarr = zarr_library()
    with explained(path):
        group = zarr.create_group(str(path), zarr_format=3)
        for name, values in whole.items():
            group.create_array(name, data=np.array(values), compressors=_checked(zarr))
        for array in chunked:
            group.create_array(
                array.name,
                shape=(*shape, *array.inner.values()),
                chunks=(1, *[block_edge] * 3, *array.inner.values()),
                dtype=array.dtype,
                fill_value=array.fill,
                compressors=_checked(zarr),
                dimension_names=("arm", "x", "y", "z", *array.inner),
            )
        group.attrs.put(attributes)  # last: without them it is no map
    return group


def stored_bytes(parts: Iterable[Any]) -> int:
    """What arrays take on disk."""
    zarr = zarr_library()
    stored = 0
    for part in parts:
        made = zarr.create_array(
            zarr.storage.MemoryStore(), data=part, chunks=part.shape, compressors=_checked(zarr)
        )
        stored += int(made.nbytes_stored())
    return stored


def open_group(path: Path, layout: Layout = REACH_MAP) -> Any:
    """The group of a map that exists.

    Raises:
        AtlasError: when there is none, or it is of another format or version.
    """
    zarr = zarr_library()
    if not (path / "zarr.json").is_file():
        raise AtlasError(f"there is no map at {shown_path(path)}; build one there first")
    with explained(path):
        group = zarr.open_group(str(path), mode="r+", zarr_format=3)
    found = group.attrs.get("format"), group.attrs.get("version")
    if found[0] != layout.format:
        raise AtlasError(
            f"{shown_path(path)} is a Zarr group, but no {layout.name} of this toolkit"
        )
    if found[1] != layout.version:
        raise AtlasError(
            f"the map {shown_path(path)} is of version {found[1]}, this toolkit reads "
            f"{layout.version}; build it anew at another path"
        )
    return group


def blocks_stored(
    path: Path, arms: int, blocks: tuple[int, ...], layout: Layout = REACH_MAP
) -> Iterator[Block]:
    """Blocks that are complete."""
    for arm, x, y, z in product(range(arms), *map(range, blocks)):
        if _file_of(path, (arm, x, y, z), layout).is_file():
            yield arm, x, y, z


def remove_block(path: Path, block: Block, layout: Layout = REACH_MAP) -> None:
    """Forget a block, such as a damaged one, so that it is computed again."""
    _file_of(path, block, layout).unlink(missing_ok=True)


def remove_leftovers(path: Path) -> None:
    """Remove what processes that were killed had not put in place yet."""
    for left in path.glob("*/**/*.partial"):
        left.unlink(missing_ok=True)


@contextmanager
def explained(path: Path, what: str = "the map") -> Iterator[None]:
    """Say in one sentence what is wrong with files.

    Raises:
        AtlasError: when they cannot be read or written, or are damaged.
    """
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", category=UserWarning, module="zarr")
            yield
    except OSError as cause:
        reason = cause.strerror or str(cause)
        raise AtlasError(
            f"{what} {shown_path(path)} cannot be read or written: {reason}"
        ) from cause
    except (ValueError, RuntimeError, KeyError, TypeError) as cause:
        raise AtlasError(
            f"{what} {shown_path(path)} is damaged: {str(cause).splitlines()[0]}"
        ) from cause


def _file_of(path: Path, block: Block, layout: Layout) -> Path:
    return path.joinpath(layout.last, "c", *map(str, block), *["0"] * layout.inner)


def _checked(zarr: Any) -> list[Any]:
    return [zarr.codecs.ZstdCodec(level=COMPRESSION), zarr.codecs.Crc32cCodec()]
