"""What a map holds, arm by arm: counted block by block, so that memory does not grow with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from planner.atlas.blocks import Block
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import NOT_COMPUTED, UNDECIDED, UNREACHABLE
from planner.errors import AtlasError


@dataclass(slots=True)
class ArmContents:
    """Cells of one arm.

    Attributes:
        side: of the arm.
        cells: how many there are.
        reachable: how many have a witness.
        unreachable: how many are proven so.
        undecided: how many are neither.
        missing_blocks: how many blocks are not computed.
        damaged: of blocks that cannot be read, the reasons.
    """

    side: str
    cells: int
    reachable: int
    unreachable: int
    undecided: int
    missing_blocks: int
    damaged: list[str]

    @property
    def computed(self) -> int:
        """Cells of which something is known."""
        return self.reachable + self.unreachable + self.undecided


def count_contents(
    found: ReachMap, progress: Callable[[Block], object] | None = None
) -> tuple[ArmContents, ...]:
    """Count the cells of a map; witnesses are not read.

    Args:
        found: the map.
        progress: called with each block after it was read.
    """
    computed, cells = found.computed_blocks(), len(found) // len(found.arms)
    blocks = len(found.blocks) // len(found.arms)
    contents = [ArmContents(side, cells, 0, 0, 0, blocks, []) for side in found.arms]
    for block in computed:
        _count(found, block, contents[block[0]])
        if progress is not None:
            progress(block)
    return tuple(contents)


def _count(found: ReachMap, block: Block, arm: ArmContents) -> None:
    arm.missing_blocks -= 1
    try:
        codes = found.read_margins(block)
    except AtlasError as cause:
        arm.damaged.append(str(cause))
        return
    arm.reachable += int((codes >= 0).sum())
    arm.unreachable += int((codes == UNREACHABLE).sum())
    arm.undecided += int((codes == UNDECIDED).sum())
    if (codes == NOT_COMPUTED).any():
        arm.damaged.append(f"block {block} of the map has cells that are not computed")
