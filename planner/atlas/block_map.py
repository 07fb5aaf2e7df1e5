"""Block maps: arrays over arms and positions that are computed block by block, on disk as Zarr.

A map is a Zarr v3 group (Zarr enters here). `zarr.json` says what the map is of; constant arrays
are there from the beginning; layers have the axes arm, x, y, z and inner ones. The names of axes
are stored, so that `xarray.open_zarr(path, consolidated=False)` opens a map. A block of positions
of one arm is one chunk of each layer.

- One task computes a block and writes it whole. Each file is put in place at once, and the chunk
  of the first layer comes last: a block that has it is complete.
- A chunk ends with its checksum (CRC-32C), without which it is not read.
- A block depends on nothing but what the map is of: its bytes are the same whoever computes it, on
  the same kind of machine. Other kinds that have computed blocks are named in `zarr.json`, and
  nothing else of it changes.
- `zarr.json` is written last when a map is created: without it the folder is no map yet.
"""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import warnings
from bisect import bisect_left
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Protocol, TypeAlias, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from baxter_kin.display import OneLine, count, shown_path
from baxter_kin.distribution.extras import run_to_install, run_to_install_extra
from baxter_kin.distribution.software import difference, kind_of_machine, versions
from baxter_kin.errors import MissingLibraryError, UnknownNameError
from baxter_kin.validation import Indices
from planner.atlas.reach_search import NOT_COMPUTED, UNDECIDED, UNREACHABLE
from planner.errors import AtlasError

Block: TypeAlias = tuple[int, int, int, int]
"""Index of the arm, then of the block along x, y and z."""

Rows: TypeAlias = tuple[NDArray[Any], ...]
"""Values of some positions: for each layer an array with one row for each position."""

STATUSES = {UNREACHABLE: "unreachable", UNDECIDED: "undecided", NOT_COMPUTED: "not computed"}
"""Of cells that have a code in the first layer in place of a value."""

EDGE = 8
"""Positions along each side of a block in most maps; one task computes one block."""

MIN_LARGE_BLOCKS = 4096
"""Minimum number of blocks with an edge above `EDGE`, so that workers can share them."""

COMPRESSION = 3
"""Level of Zstandard: a third of the bytes; higher levels save little and take longer."""

_OTHER_MACHINES = "other_machines"  # the one attribute that may change while a map is computed

_Map = TypeVar("_Map", bound="BlockMap")


# Blocks ------------------------------------------------------------------------------------------


class Blocks(Sequence[Block], OneLine):
    """A set of blocks in the order in which they are computed: by arm, then along x, y and z.

    Attributes:
        shape: number of arms, and of blocks along x, y and z, of the whole map.
    """

    def __init__(self, shape: tuple[int, ...], numbers: Indices | None = None) -> None:
        """Choose some blocks, or all.

        Args:
            shape: of the whole map.
            numbers: of the blocks in that order, ascending.
        """
        self.shape = shape
        self._numbers = range(math.prod(shape)) if numbers is None else numbers

    @classmethod
    def of(cls, shape: tuple[int, ...], blocks: Iterable[Block]) -> Blocks:
        """Some blocks, in any order."""
        numbers = (_number(shape, block) for block in blocks)
        return cls(shape, np.sort(np.fromiter(numbers, np.intp)))

    def others(self) -> Blocks:
        """The blocks of the map that are not among these."""
        is_other = np.ones(math.prod(self.shape), bool)
        is_other[np.asarray(self._numbers, np.intp)] = False
        return Blocks(self.shape, np.flatnonzero(is_other))

    def index(self, block: object, start: int = 0, stop: int | None = None) -> int:
        """The place of a block among these."""
        at = self._place(block)
        if at is None or at not in range(len(self))[start:stop]:
            raise ValueError(f"{block} is not among these blocks")
        return at

    def as_array(self) -> Indices:
        """The same blocks as rows of an array, shape (n, 4)."""
        return np.stack(np.unravel_index(np.asarray(self._numbers, np.intp), self.shape), axis=1)

    def __len__(self) -> int:
        return len(self._numbers)

    def __contains__(self, block: object) -> bool:
        return self._place(block) is not None

    @overload
    def __getitem__(self, at: int) -> Block: ...

    @overload
    def __getitem__(self, at: slice) -> Blocks: ...

    def __getitem__(self, at: int | slice) -> Block | Blocks:
        if isinstance(at, slice):
            return Blocks(self.shape, np.asarray(self._numbers[at], np.intp))
        arm, x, y, z = np.unravel_index(self._numbers[at], self.shape)
        return int(arm), int(x), int(y), int(z)

    def _place(self, block: object) -> int | None:
        if not (isinstance(block, tuple) and len(block) == 4):
            return None
        number = _number(self.shape, block)
        at = bisect_left(self._numbers, number)
        return at if at < len(self) and self._numbers[at] == number else None

    def _facts(self) -> tuple[str, ...]:
        return f"{len(self):,} of {count(math.prod(self.shape), 'block')}", f"shape {self.shape}"


def _number(shape: tuple[int, ...], block: tuple[int, ...]) -> int:
    number = 0
    for size, index in zip(shape, block, strict=True):
        number = number * size + index
    return number


class BlockGrid(NamedTuple):
    """The outer axes of a map, cut into blocks; blocks at the end of an axis may be smaller.

    Attributes:
        shape: number of arms, and of positions along x, y and z.
        edge: positions along each side of a block.
    """

    shape: tuple[int, ...]
    edge: int

    @classmethod
    def of(cls, shape: tuple[int, ...], rotations: int, max_cells: int) -> BlockGrid:
        """Blocks that have at most so many cells, or one position.

        The edge is at most `EDGE`, except on large grids of few rotations, where that saves files.

        Args:
            shape: number of arms, and of positions along x, y and z.
            rotations: number of cells of a position.
            max_cells: maximum for a block.
        """
        edge = EDGE
        while edge > 1 and edge**3 * rotations > max_cells:
            edge //= 2
        while (2 * edge) ** 3 * rotations <= max_cells and (
            math.prod(shape[1:]) >= MIN_LARGE_BLOCKS * (2 * edge) ** 3
        ):
            edge *= 2
        return cls(shape, edge)

    @property
    def blocks(self) -> Blocks:
        """All of them."""
        arms, *positions = self.shape
        return Blocks((arms, *(-(-n // self.edge) for n in positions)))

    def slices(self, block: Block) -> tuple[slice, slice, slice]:
        """The positions of a block along x, y and z."""
        x, y, z = (
            slice(b * self.edge, min((b + 1) * self.edge, n))
            for b, n in zip(block[1:], self.shape[1:], strict=True)
        )
        return x, y, z

    def indices(self, block: Block) -> Indices:
        """The positions of a block in the order of its rows: indices, shape (n, 3)."""
        axes = (np.arange(cut.start, cut.stop) for cut in self.slices(block))
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

    def positions_of(self, blocks: Blocks) -> int:
        """Number of positions that blocks have together, each arm's counted by itself."""
        if len(blocks) == math.prod(blocks.shape):
            return math.prod(self.shape)
        at = blocks.as_array()[:, 1:]
        sizes = np.minimum(self.edge, np.array(self.shape[1:]) - at * self.edge)
        return int(sizes.prod(axis=1).sum())


# What a map is of --------------------------------------------------------------------------------


class Layer(NamedTuple):
    """An array of cells, of which each block is one chunk.

    Attributes:
        dtype: of its values.
        fill: value of what is not computed.
        inner: names and sizes of the axes after those of arms and positions.
    """

    dtype: str
    fill: int
    inner: Mapping[str, int]


class Kind(NamedTuple):
    """A kind of map.

    Attributes:
        format: what `zarr.json` names it.
        version: of the format.
        name: what messages call it.
        layers: names; a block's chunks are written from the last to the first.
        compared: attributes and constant arrays that two builds of one map have in common, by
            what messages call them.
    """

    format: str
    version: int
    name: str
    layers: tuple[str, ...]
    compared: Mapping[str, tuple[str, ...]]


class MapDefinition(Protocol):
    """What a map is of, and what computes its cells."""

    @property
    def arms(self) -> tuple[str, ...]:
        """Such as ("left", "right")."""

    @property
    def grid(self) -> BlockGrid:
        """Arms and positions in blocks."""

    @property
    def sample(self) -> int:
        """Number of positions that are efficiently computed together."""

    @property
    def sources(self) -> tuple[Path, ...]:
        """Paths of the maps that it is computed from."""

    @property
    def attributes(self) -> dict[str, Any]:
        """What `zarr.json` says of the map."""

    @property
    def constants(self) -> dict[str, Any]:
        """Arrays that are there from the beginning, by name."""

    @property
    def layers(self) -> dict[str, Layer]:
        """Layers, in the order of the map's kind."""

    @property
    def backend(self) -> str:
        """Where searches run; last bits depend on it."""

    def compute(self, arm: int, at: Indices) -> Rows:
        """Values at positions of one arm, given by their indices, shape (n, 3)."""


# On disk -----------------------------------------------------------------------------------------


class BlockMap(OneLine):
    """A map on disk.

    Attributes:
        path: its folder.
        arms: such as ("left", "right").
        grid: arms and positions in blocks.
        software: versions that compute its blocks, by name; empty if it does not name them.
        machine: kind of machine and backend that it was begun with.
        other_machines: other kinds that have computed blocks; their last bits may differ.
    """

    KIND: ClassVar[Kind]

    def __init__(self, path: str | Path) -> None:
        """Open a map.

        Raises:
            AtlasError: when there is none, or none that this toolkit reads.
            MissingLibraryError: when Zarr is not installed.
        """
        self.path = Path(path)
        self._group = _open_group(self.path, self.KIND)
        facts: dict[str, Any] = dict(self._group.attrs)
        with explained(self.path):
            self._layers = [self._group[name] for name in self.KIND.layers]
            first = self._layers[0]
            self.grid = BlockGrid(tuple(first.shape[:4]), int(first.chunks[1]))
            self.software: dict[str, str] = dict(facts.get("software", {}))
            self.machine = str(facts["machine"])
            self.other_machines: tuple[str, ...] = tuple(facts.get(_OTHER_MACHINES, ()))
            self.arms = self._read(facts)

    def _read(self, facts: Mapping[str, Any]) -> tuple[str, ...]:
        """Set what this kind of map has beside; returns the arms."""
        raise NotImplementedError

    def definition(self, *sources: str) -> MapDefinition:
        """What computes the blocks of this map.

        Args:
            sources: paths of the maps that it is computed from.
        """
        raise NotImplementedError

    @staticmethod
    def codes_of(rows: Rows) -> NDArray[Any]:
        """For each cell of some rows, its code, or a value that is not negative."""
        return rows[0]

    @classmethod
    def create_from(
        cls: type[_Map], path: str | Path, definition: MapDefinition, backend: str | None = None
    ) -> _Map:
        """Create a map with nothing computed.

        Args:
            path: a folder that does not exist, is empty, or was left by such a call that was
                killed.
            definition: what the map is of.
            backend: where searches run, if another one than the definition's.
        """
        folder, zarr = Path(path), _zarr_library()
        check_vacant(folder, (*definition.constants, *definition.layers))
        kind, codecs = cls.KIND, _codecs(zarr)
        attributes = {
            "format": kind.format,
            "version": kind.version,
            "software": dict(versions()),
            "machine": kind_of_machine(definition.backend if backend is None else backend),
            **definition.attributes,
        }
        with explained(folder):
            for name, values in definition.constants.items():
                zarr.create_array(
                    str(folder / name),
                    data=np.array(values),
                    compressors=codecs,
                    dimension_names=[f"{name}_{axis}" for axis in range(values.ndim)],
                    overwrite=True,
                )
            for name, layer in definition.layers.items():
                zarr.create_array(
                    str(folder / name),
                    shape=(*definition.grid.shape, *layer.inner.values()),
                    chunks=(1, *[definition.grid.edge] * 3, *layer.inner.values()),
                    dtype=layer.dtype,
                    fill_value=layer.fill,
                    compressors=codecs,
                    dimension_names=("arm", "x", "y", "z", *layer.inner),
                    overwrite=True,
                )
            zarr.create_group(str(folder), zarr_format=3, attributes=attributes)
        return cls(folder)

    @cached_property
    def identity(self) -> str:
        """Tells this map from another one at the same path: 64 hexadecimal digits."""
        lasting = {name: v for name, v in self._group.attrs.items() if name != _OTHER_MACHINES}
        digest = hashlib.sha256(json.dumps(lasting, sort_keys=True).encode())
        for name, values in sorted(self._constants().items()):
            digest.update(name.encode() + values.tobytes())
        return digest.hexdigest()

    def check_definition(self, definition: MapDefinition) -> None:
        """Refuse to continue with a map of something else, or begun with other software.

        A complete map has nothing that other software would compute.

        Raises:
            AtlasError: with the differences.
        """
        here = {**_as_json(definition.attributes), **definition.constants}
        there = {**self._group.attrs, **self._constants()}
        other = [
            what
            for what, names in self.KIND.compared.items()
            if not all(np.array_equal(here[name], there[name]) for name in names)
        ]
        if other:
            raise AtlasError(
                f"the map at {shown_path(self.path)} is of another {' and another '.join(other)}; "
                "nothing was changed; choose another path"
            )
        if self.missing_blocks():
            self.check_software()

    def check_software(self) -> None:
        """Refuse to compute blocks with other software than the map was begun with.

        Raises:
            AtlasError: with the versions that differ.
        """
        unnamed = "versions that it does not name"
        differs = difference(self.software, versions()) if self.software else unnamed
        if differs:
            raise AtlasError(
                f"the map at {shown_path(self.path)} was begun with other software: {differs}; "
                "nothing was changed; install that to go on, or choose another path"
            )

    @property
    def blocks(self) -> Blocks:
        """All of them, in the order in which they are computed."""
        return self.grid.blocks

    def computed_blocks(self) -> Blocks:
        """Blocks that are stored, as the folder has them now."""
        shape = self.blocks.shape
        with explained(self.path):
            return Blocks.of(shape, self._stored(shape))

    def missing_blocks(self) -> Blocks:
        """The other blocks."""
        return self.computed_blocks().others()

    def read_rows(self, block: Block, layer: int = 0) -> NDArray[Any]:
        """One layer of a block, positions in a row.

        Raises:
            AtlasError: when it is damaged.
        """
        with explained(self.path, f"block {block} of the map"):
            values = self._layers[layer][(block[0], *self.grid.slices(block))]
            return np.reshape(values, (-1, *values.shape[3:]))

    def write_rows(self, block: Block, rows: Rows) -> None:
        """Store a block.

        Raises:
            AtlasError: when it cannot be written.
        """
        pieces = self.grid.slices(block)
        sizes = tuple(piece.stop - piece.start for piece in pieces)
        with explained(self.path):
            for layer, values in reversed([*zip(self._layers, rows, strict=True)]):
                layer[(block[0], *pieces)] = values.reshape(*sizes, *values.shape[1:])

    def discard_block(self, block: Block) -> None:
        """Remove a block, so that the next build computes it."""
        self._chunk(block).unlink(missing_ok=True)

    def note_machine(self, kind: str) -> bool:
        """Store that a kind of machine has computed blocks; returns whether it is a new one.

        Raises:
            AtlasError: when it cannot be written.
        """
        if kind in (self.machine, *self.other_machines):
            return False
        self.other_machines += (kind,)
        with explained(self.path):
            self._group.attrs[_OTHER_MACHINES] = sorted(self.other_machines)
        return True

    def remove_leftovers(self) -> None:
        """Remove the partial files of processes that were killed."""
        for file in _files(self.path):
            if file.endswith(".partial"):
                Path(file).unlink(missing_ok=True)

    def check_arm(self, side: str) -> None:
        """Refuse an arm that the map does not have.

        Raises:
            UnknownNameError: when it does not.
        """
        if side not in self.arms:
            raise UnknownNameError("arm of this map", side, self.arms)

    def _arm_index(self, side: str) -> int:
        self.check_arm(side)
        return self.arms.index(side)

    def _constants(self) -> dict[str, NDArray[Any]]:
        layers = self.KIND.layers
        with explained(self.path):
            return {name: each[...] for name, each in self._group.arrays() if name not in layers}

    def _chunk(self, block: Block, layer: int = 0) -> Path:
        inner = ["0"] * (self._layers[layer].ndim - 4)
        return self.path.joinpath(self.KIND.layers[layer], "c", *map(str, block), *inner)

    def _stored(self, shape: tuple[int, ...]) -> Iterator[Block]:
        """Complete blocks; a file is empty where the power was lost."""
        folder = self.path / self.KIND.layers[0] / "c"
        for arm in _numbers(folder, shape[0]):
            for x in _numbers(folder / str(arm), shape[1]):
                for y in _numbers(folder / str(arm) / str(x), shape[2]):
                    for z in _numbers(folder / str(arm) / str(x) / str(y), shape[3]):
                        file = self._chunk((arm, x, y, z))
                        if file.is_file() and file.stat().st_size > 0:
                            yield arm, x, y, z


def is_map(path: Path) -> bool:
    """Whether there is a map at a path, or at least what may be one."""
    with explained(path):
        return (path / "zarr.json").exists()


def check_vacant(path: Path, left: Collection[str] = ()) -> None:
    """Refuse a path where something is already.

    Args:
        path: of the folder.
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
    """Refuse a map if the folder for its blocks cannot be written, before much is done."""
    with explained(path):
        if not os.access(folder, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


def nearest_folder(path: Path) -> Path:
    """A path, or the nearest folder above it that exists."""
    return next(each for each in (path, *path.absolute().parents) if each.exists())


def bytes_on_disk(path: Path) -> int:
    """Size of all files of a map."""
    sizes = 0
    for file in _files(path):
        with suppress(FileNotFoundError):  # as when a build puts it in place meanwhile
            sizes += os.lstat(file).st_size
    return sizes


def stored_bytes(parts: Iterable[NDArray[Any]]) -> int:
    """Size of chunks on disk."""
    zarr, stored = _zarr_library(), 0
    for part in parts:
        made = zarr.create_array(
            zarr.storage.MemoryStore(),
            shape=part.shape,
            chunks=part.shape,
            dtype=part.dtype,
            compressors=_codecs(zarr),
        )
        before = int(made.nbytes_stored())
        made[...] = part
        stored += int(made.nbytes_stored()) - before
    return stored


@contextmanager
def explained(path: Path, what: str = "the map") -> Iterator[None]:
    """Turn errors of reading and writing files into an `AtlasError` of one sentence."""
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


def _open_group(path: Path, kind: Kind) -> Any:
    zarr = _zarr_library()
    if not is_map(path):
        raise AtlasError(f"there is no map at {shown_path(path)}; build one there first")
    with explained(path):
        group = zarr.open_group(str(path), mode="r+", zarr_format=3)
    found = group.attrs.get("format"), group.attrs.get("version")
    if found[0] != kind.format:
        raise AtlasError(f"{shown_path(path)} is a Zarr group, but no {kind.name} of this toolkit")
    if found[1] != kind.version:
        raise AtlasError(
            f"the map {shown_path(path)} is of version {found[1]}, this toolkit reads "
            f"{kind.version}; build it anew at another path"
        )
    return group


def _zarr_library() -> Any:
    """Zarr, which only those who build or read maps need."""
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


def _codecs(zarr: Any) -> list[Any]:
    return [zarr.codecs.ZstdCodec(level=COMPRESSION), zarr.codecs.Crc32cCodec()]


def _as_json(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Attributes as they are read from a file."""
    read: dict[str, Any] = json.loads(json.dumps(attributes))
    return read


def _numbers(folder: Path, end: int) -> list[int]:
    """Names in a folder that are numbers below the end, ascending; none if it does not exist."""
    try:
        names = os.listdir(folder)
    except (FileNotFoundError, NotADirectoryError):
        return []
    return sorted(int(name) for name in names if name.isdecimal() and int(name) < end)


def _files(path: Path) -> Iterator[str]:
    for folder, _, names in os.walk(path):
        for name in names:
            yield os.path.join(folder, name)


def _has_only(path: Path, names: Collection[str]) -> bool:
    """Whether a folder has nothing but arrays of these names, or partial files."""
    return all(each.name in names or each.suffix == ".partial" for each in path.iterdir())
