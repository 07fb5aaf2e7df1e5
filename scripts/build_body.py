"""Make `planner/collision/robot/robot_body.npz`: what Baxter is taken to be, from its meshes.

    python scripts/build_body.py [--out FILE] [--keep DIR]

Reads the COLLADA meshes of example-robot-data (Rethink Robotics, BSD-3-Clause). Of every link it
makes triangles that are fewer, what they enclose, and convex pieces around them; then it finds out
which pairs of links need no check (`body/` has the steps). Needs the `body` extra; `--keep` puts
finished triangles and enclosures into a folder and takes those there.
`tests/planner/collision/robot/test_robot_body.py` shows again, by its own code, what the file
contains.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from body.enclosure import enclosure
from body.hands import hand
from body.meshes import placed_shapes, triangles
from body.pairs import reasons
from body.pieces import Shape, cover, packed, primitive, shape_name
from body.thinning import Mesh, thinned

from baxter_kin.description import StockFiles
from planner.collision.robot.robot_body import RobotBody

TARGET = (
    Path(__file__).resolve().parent.parent / "planner" / "collision" / "robot" / "robot_body.npz"
)

MARGIN = 0.5
"""What the planner adds to a link's triangles, mm."""

FINGERS_MARGIN = 0.1
"""What it adds to those of fingers and pads, which are all kept, mm: room for another proof."""

PROVEN = 0.499
"""How far no point of a mesh is from them, mm; the rest is for rounding in the file."""

DEVIATION = 0.43
"""By how much they may deviate at samples, mm."""

SPACING = {"base_link": 4.0, "PEDESTAL": 4.0}
"""Of these samples, mm; 2 where not named."""

MOST_PIECES = {"H0": 1, "H1": 2, "electric_gripper_base": 3, "W2": 3}
"""Of a link; five of those not named."""


def main() -> None:
    """Build the file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--out", type=Path, default=TARGET, help="default: %(default)s")
    parser.add_argument("--keep", type=Path, help="folder of what takes long to make")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        build(options.out, folder)


def build(out: Path, folder: Path) -> None:
    """Write the file, once without pairs to find these with it."""
    links = list(placed_shapes())
    shapes: dict[str, Shape] = {}
    for placed in links:
        name = shape_name(placed)
        if name in shapes:
            continue
        if not placed.mesh:
            shapes[name] = primitive(*placed.primitive)
        elif "finger" in placed.link:
            shapes[name] = _finger(name, folder)
        else:
            shapes[name] = _link(name, folder)
        shape = shapes[name]
        counts = [len(mesh[1]) for mesh in (shape.surface, shape.enclosure)]
        print(f"{name}: {counts} triangles, {len(shape.pieces)} pieces", flush=True)
    notice = (StockFiles.installed().urdf.parent.parent / "LICENSE").read_text("utf-8")
    np.savez_compressed(out, allow_pickle=False, **packed(shapes, links, {}, notice))
    on_robot = {name: link for name, link in RobotBody.read(out).links.items() if ":" not in name}
    pairs = reasons(on_robot)
    np.savez_compressed(out, allow_pickle=False, **packed(shapes, links, pairs, notice))
    print(f"{out}: {out.stat().st_size / 1e3:.0f} kB, {len(pairs)} pairs skipped")


def _link(mesh: str, folder: Path) -> Shape:
    def fewer() -> Mesh:
        return thinned(triangles(mesh), DEVIATION, PROVEN, SPACING.get(mesh, 2.0))

    vertices, faces = _kept(folder / f"{mesh}_triangles.npz", fewer)
    pieces = cover(vertices[faces], MOST_PIECES.get(mesh, 5))
    inside = _kept(folder / f"{mesh}_enclosure.npz", lambda: enclosure(mesh))
    return Shape(pieces, (vertices, faces), inside, MARGIN)


def _finger(mesh: str, folder: Path) -> Shape:
    """All of its triangles, and the pieces that it touches with."""
    vertices, faces = np.unique(triangles(mesh).reshape(-1, 3), axis=0, return_inverse=True)
    inside = _kept(folder / f"{mesh}_enclosure.npz", lambda: enclosure(mesh))
    return Shape(
        hand(mesh), (vertices, faces.reshape(-1, 3)), inside, FINGERS_MARGIN, is_touching=True
    )


def _kept(file: Path, make: Callable[[], Mesh]) -> Mesh:
    if not file.exists():
        vertices, faces = make()
        np.savez(file, vertices=vertices, faces=faces)
    with np.load(file) as data:
        return data["vertices"], data["faces"]


if __name__ == "__main__":
    main()
