"""Reach maps on disk: Zarr v3 groups (Zarr enters here).

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
is computed, but which kinds of machines compute blocks, if there are several: the same block has
the same bytes whoever computes it, on the same kind of machine. `zarr.json` comes last when a map
is made: without it the folder is no map yet. Other kinds of maps have other arrays (`Layout`), and
the same rules.
"""

from __future__ import annotations

import errno
import os
import warnings
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from baxter_kin.display import shown_path
from baxter_kin.distribution.extras import run_to_install, run_to_install_extra
from baxter_kin.errors import MissingLibraryError
from planner.atlas.blocks import REACH_MAP, Block, Chunked, Layout
from planner.errors import AtlasError

COMPRESSION = 3
"""Level of Zstandard: a third of the bytes; higher levels save little and take longer."""


def _zarr_library() -> Any:
    """Zarr, which only who builds or reads maps needs."""
    try:
        import zarr  # noqa: PLC0415
    except ImportError as cause:
        raise MissingLibraryError(
            f"maps need zarr, and it Python 3.11 or later; {run_to_install_extra('atlas')}"
        ) from cause
    if int(zarr.__version__.split(".")[0]) < 3:
        raise MissingLibraryError(
            f"maps need zarr 3, and it Python 3.11 or later; this is zarr {zarr.__version__};"
            f" {run_to_install('--upgrade', 'zarr')}"
        )
    return zarr


def create_arrays(
    path: Path,
    attributes: dict[str, Any],
    whole: Mapping[str, Any],
    chunked: Sequence[Chunked],
    *,
    shape: tuple[int, ...],
    block_edge: int,
) -> None:
    """A group for a new map of any kind, with nothing computed.

    Args:
        path: a folder that does not exist, is empty, or has what is left of such a call that was
            killed.
        attributes: what the group says of itself.
        whole: arrays that are there from the beginning, by name.
        chunked: those that are computed block by block.
        shape: how many arms, and positions along x, y and z.
        block_edge: positions along each side of a block.
    """
    check_vacant(path, (*whole, *(array.name for array in chunked)))
    zarr = _zarr_library()
    with explained(path):
        for name, values in whole.items():
            zarr.create_array(
                str(path / name),
                data=np.array(values),
                compressors=_checked(zarr),
                overwrite=True,
            )
        for array in chunked:
            zarr.create_array(
                str(path / array.name),
                shape=(*shape, *array.inner.values()),
                chunks=(1, *[block_edge] * 3, *array.inner.values()),
                dtype=array.dtype,
                fill_value=array.fill,
                compressors=_checked(zarr),
                dimension_names=("arm", "x", "y", "z", *array.inner),
                overwrite=True,
            )
        zarr.create_group(str(path), zarr_format=3, attributes=attributes)


def stored_bytes(parts: Iterable[Any]) -> int:
    """What arrays take on disk."""
    zarr = _zarr_library()
    stored = 0
    for part in parts:
        made = zarr.create_array(
            zarr.storage.MemoryStore(), data=part, chunks=part.shape, compressors=_checked(zarr)
        )
        stored += int(made.nbytes_stored())
    return stored


def check_vacant(path: Path, left: Collection[str] = ()) -> None:
    """Refuse a path where something is already.

    Args:
        path: which.
        left: arrays that a call which was killed may have left there.
    """
    with explained(path):
        is_taken = path.exists() and (not path.is_dir() or not _has_only(path, left))
        there = nearest_folder(path)
        if not is_taken and not there.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, f"{shown_path(there)} is no folder")
    if is_taken:
        raise AtlasError(f"{shown_path(path)} exists and is no map; choose another path")
    check_writable(path, there)


def check_writable(path: Path, folder: Path) -> None:
    """Refuse a map when the folder that blocks go to cannot be written, before much is done."""
    with explained(path):
        if not os.access(folder, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


def nearest_folder(path: Path) -> Path:
    """A path, or the nearest folder above it that exists."""
    return next(each for each in (path, *path.absolute().parents) if each.exists())


def is_map(path: Path) -> bool:
    """Whether there is a map at that path, or at least what may be one."""
    with explained(path):
        return (path / "zarr.json").exists()


def open_group(path: Path, layout: Layout = REACH_MAP) -> Any:
    """The group of a map that exists."""
    zarr = _zarr_library()
    if not is_map(path):
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
    path: Path, shape: tuple[int, ...], layout: Layout = REACH_MAP
) -> Iterator[Block]:
    """Blocks that are complete, of so many along each axis; takes no longer than they are."""
    folder = path / layout.last / "c"
    for arm in _numbers(folder, shape[0]):
        for x in _numbers(folder / str(arm), shape[1]):
            for y in _numbers(folder / str(arm) / str(x), shape[2]):
                for z in _numbers(folder / str(arm) / str(x) / str(y), shape[3]):
                    if _is_written(_file_of(path, (arm, x, y, z), layout)):
                        yield arm, x, y, z


def has_witnesses(path: Path, block: Block) -> bool:
    """Whether the witnesses of a block are there; they are not where nothing of it is reachable."""
    return path.joinpath("witnesses", "c", *map(str, block), "0", "0").is_file()


def remove_block(path: Path, block: Block, layout: Layout = REACH_MAP) -> None:
    """Forget a block, such as a damaged one, so that it is computed again."""
    _file_of(path, block, layout).unlink(missing_ok=True)


def remove_leftovers(path: Path) -> None:
    """Remove what processes that were killed had not put in place yet."""
    for folder, _, names in os.walk(path):
        for name in names:
            if name.endswith(".partial"):
                Path(folder, name).unlink(missing_ok=True)


def bytes_on_disk(path: Path) -> int:
    """Of all files of a map."""
    sizes = 0
    for folder, _, names in os.walk(path):
        for name in names:
            with suppress(FileNotFoundError):  # as when a build puts it in place meanwhile
                sizes += os.lstat(os.path.join(folder, name)).st_size
    return sizes


@contextmanager
def explained(path: Path, what: str = "the map") -> Iterator[None]:
    """Say in one sentence what is wrong with files."""
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


def _numbers(folder: Path, end: int) -> list[int]:
    """Names in a folder that are numbers below the end, ascending; none where it is not there."""
    try:
        names = os.listdir(folder)
    except (FileNotFoundError, NotADirectoryError):
        return []
    return sorted(int(name) for name in names if name.isdecimal() and int(name) < end)


def _has_only(path: Path, names: Collection[str]) -> bool:
    """Whether a folder has nothing but arrays of these names, or parts of files."""
    return all(each.name in names or each.suffix == ".partial" for each in path.iterdir())


def _is_written(file: Path) -> bool:
    """Whether a file has something in it; where the power was lost there may be empty ones."""
    return file.is_file() and file.stat().st_size > 0


def _file_of(path: Path, block: Block, layout: Layout) -> Path:
    return path.joinpath(layout.last, "c", *map(str, block), *["0"] * layout.inner)


def _checked(zarr: Any) -> list[Any]:
    return [zarr.codecs.ZstdCodec(level=COMPRESSION), zarr.codecs.Crc32cCodec()]
