"""Make `planner/robot_body.npz`: what the planner takes Baxter to be, never smaller than its meshes.

    python scripts/build_body.py [--out FILE] [--surfaces DIR] [--only MESH ...] [--table]

Reads the COLLADA meshes of example-robot-data (Rethink Robotics, BSD-3-Clause). Around every link's
mesh it puts a closed surface, thinned out without touching the mesh, cuts it into convex pieces that
contain it, and finds out which pairs of links need no check (`body/` has the steps).
Needs the `body` extra and about half an hour; `--surfaces` keeps finished surfaces in a folder and
takes those that are there. `--table` prints what the existing file holds, and writes nothing.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from baxter_kin.description import RobotDescription

TARGET = Path(__file__).resolve().parent.parent / "planner" / "robot_body.npz"


def main() -> None:
    """Build the file, or tell what is in it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--out", type=Path, default=TARGET, help="default: %(default)s")
    parser.add_argument("--surfaces", type=Path, help="folder of finished surfaces")
    parser.add_argument("--only", nargs="+", metavar="MESH", help="these surfaces, no file")
    parser.add_argument("--table", action="store_true", help="print figures of the file")
    options = parser.parse_args()
    if options.table:
        from body.table import table

        print(table())
        return
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.surfaces or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        if options.only:
            for mesh in options.only:
                _surface(mesh, folder)
            return
        _build(options.out, folder)


def _surface(mesh: str, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    from body.wrapping import surface

    file = folder / f"{mesh}.npz"
    if not file.exists():
        vertices, faces = surface(mesh)
        np.savez(file, vertices=vertices, faces=faces)
        print(f"{mesh}: {len(faces)} triangles", flush=True)
    with np.load(file) as data:
        return data["vertices"], data["faces"]


def _build(out: Path, folder: Path) -> None:
    from body.meshes import placed_shapes
    from body.packing import packed, primitive, shape_name
    from body.pairs import reasons
    from body.shapes import OTHER_FINGERS, hand, link

    from planner.robot_body import RobotBody

    links = list(placed_shapes())
    shapes = {}
    for placed in links:
        name = shape_name(placed)
        if name in shapes:
            continue
        if not placed.mesh:
            shapes[name] = primitive(*placed.primitive)
        elif "finger" in placed.link:
            shapes[name] = hand(name)
        else:
            shapes[name] = link(name, *_surface(name, folder))
        print(f"{name}: {len(shapes[name].pieces)} pieces", flush=True)
    shapes |= {name: hand(name) for name in OTHER_FINGERS}
    notice = (RobotDescription.installed().urdf.parent.parent / "LICENSE").read_text("utf-8")
    np.savez_compressed(out, allow_pickle=False, **packed(shapes, links, {}, notice))
    pairs = reasons(RobotBody.load(out).links)
    np.savez_compressed(out, allow_pickle=False, **packed(shapes, links, pairs, notice))
    print(f"{out}: {out.stat().st_size / 1e3:.0f} kB, {len(pairs)} pairs skipped")


if __name__ == "__main__":
    main()
