"""Blocks: which blocks of a map, in the order in which they are computed, as runs of numbers.

The blocks of a map number up to millions, and what is computed of them, or missing, is a few runs
of neighbours in nearly all cases. So no list of them is ever held.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, TypeAlias, overload

import numpy as np
from numpy.typing import NDArray

from baxter_kin.display import OneLine, count

Block: TypeAlias = tuple[int, int, int, int]
"""Index of the arm, then of the block along x, y and z."""


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


REACH_MAP = Layout("baxter-kin reach map", 1, "reach map", "margins", 1)


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


class Blocks(Sequence[Block], OneLine):
    """A set of blocks in order; blocks are numbered arm by arm, then along x, y and z.

    Attributes:
        shape: how many arms, and blocks along x, y and z, the whole map has.
    """

    def __init__(self, shape: tuple[int, ...], runs: NDArray[np.int64] | None = None) -> None:
        """Choose some, or all when not told.

        Args:
            shape: of the whole map.
            runs: first number and that behind the last, run by run, ascending, shape (n, 2).
        """
        self.shape = shape
        whole = np.array([[0, math.prod(shape)]], np.int64)
        self._runs = whole if runs is None else runs
        lengths = self._runs[:, 1] - self._runs[:, 0]
        self._before = np.concatenate([[0], np.cumsum(lengths)])

    @classmethod
    def of(cls, shape: tuple[int, ...], blocks: Iterable[Block]) -> Blocks:
        """Some blocks, in any order."""
        numbers = np.fromiter((_number(shape, block) for block in blocks), np.int64)
        numbers.sort()
        begins = np.flatnonzero(np.diff(numbers, prepend=-2) != 1)
        ends = np.append(begins[1:], len(numbers)) - 1
        return cls(shape, np.stack([numbers[begins], numbers[ends[: len(begins)]] + 1], axis=1))

    def others(self) -> Blocks:
        """Those of the map that are not among these."""
        inner = np.concatenate([[0], self._runs.ravel(), [math.prod(self.shape)]])
        runs = inner.reshape(-1, 2)
        return Blocks(self.shape, runs[runs[:, 0] < runs[:, 1]])

    def index(self, block: object, start: int = 0, stop: int | None = None) -> int:
        """Where a block stands among these."""
        run = self._run_of(block)
        if run is not None:
            begin = int(self._before[run] - self._runs[run, 0])
            at = begin + _number(self.shape, block)  # type: ignore[arg-type]
            if at in range(len(self))[start:stop]:
                return at
        raise ValueError(f"{block} is not among these blocks")

    def __len__(self) -> int:
        return int(self._before[-1])

    def __contains__(self, block: object) -> bool:
        return self._run_of(block) is not None

    @overload
    def __getitem__(self, at: int) -> Block: ...

    @overload
    def __getitem__(self, at: slice) -> tuple[Block, ...]: ...

    def __getitem__(self, at: int | slice) -> Block | tuple[Block, ...]:
        if isinstance(at, slice):
            return tuple(self[i] for i in range(*at.indices(len(self))))
        place = range(len(self))[at]
        run = int(np.searchsorted(self._before, place, side="right")) - 1
        return self._block(int(self._runs[run, 0]) + place - int(self._before[run]))

    def __iter__(self) -> Iterator[Block]:
        for begin, end in self._runs:
            for number in range(begin, end):
                yield self._block(number)

    def _run_of(self, block: object) -> int | None:
        if not (isinstance(block, tuple) and len(block) == 4):
            return None
        number = _number(self.shape, block)
        run = int(np.searchsorted(self._runs[:, 0], number, side="right")) - 1
        return run if run >= 0 and number < int(self._runs[run, 1]) else None

    def _block(self, number: int) -> Block:
        arm, x, y, z = np.unravel_index(number, self.shape)
        return int(arm), int(x), int(y), int(z)

    def _facts(self) -> tuple[str, ...]:
        return f"{len(self):,} of {count(math.prod(self.shape), 'block')}", f"shape {self.shape}"


class BlockTask(NamedTuple):
    """What a worker needs to know.

    Attributes:
        path: the map's folder.
        block: which.
        identity: of the map, so that no worker takes another one at that path for it.
    """

    path: str
    block: Block
    identity: str


class BlockTasks(Sequence[BlockTask]):
    """One for each of some blocks."""

    def __init__(self, path: Path, identity: str, blocks: Blocks) -> None:
        self._path, self._identity, self._blocks = str(path.resolve()), identity, blocks

    def __len__(self) -> int:
        return len(self._blocks)

    @overload
    def __getitem__(self, at: int) -> BlockTask: ...

    @overload
    def __getitem__(self, at: slice) -> list[BlockTask]: ...

    def __getitem__(self, at: int | slice) -> BlockTask | list[BlockTask]:
        if isinstance(at, slice):
            return [self[i] for i in range(*at.indices(len(self)))]
        return BlockTask(self._path, self._blocks[at], self._identity)


def _number(shape: tuple[int, ...], block: tuple[int, ...]) -> int:
    number = 0
    for size, index in zip(shape, block, strict=True):
        number = number * size + index
    return number
