"""Make `sim/view/appearance.npz`: what Baxter looks like, light enough for a web page.

    python scripts/build_appearance.py [--out FILE]

Reads the COLLADA meshes of example-robot-data (Rethink Robotics, BSD-3-Clause) and, link by link,
keeps the colours of their materials, thins the triangles out (quadric edge collapse: Garland and
Heckbert, SIGGRAPH 1997), and gives every corner a normal that is smooth on curved surfaces and
sharp at edges. Where a link's mesh belongs is taken from Pinocchio, so the picture agrees with the
model.
Needs the `dev` extra; running it again gives the same file, byte for byte.
"""

from __future__ import annotations

import argparse
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import coal
import collada
import fast_simplification
import numpy as np
import pinocchio as pin
from collada.common import DaeBrokenRefError, DaeUnsupportedError
from collada.triangleset import BoundTriangleSet
from numpy.typing import NDArray

from baxter_kin.description import StockFiles
from baxter_kin.fields import evolve
from baxter_kin.files import replace_file

TARGET = Path(__file__).resolve().parent.parent / "sim" / "view" / "appearance.npz"

CREASE_COS = float(np.cos(np.deg2rad(38.0)))
"""Faces that meet at less than this angle share a normal; beyond it their edge stays sharp."""

WELD_M = 1e-5
"""Corners closer than this are one vertex; CAD exports repeat them along every seam."""

HIDDEN = ("collision_head", "hand_accelerometer")
"""Visuals that are markers (red spheres around the head) or buried inside the wrist."""

THINNING_M = 2e-3
"""Edges collapse while the root of the quadric error, a sum over the planes around, is below this.

Judged by eye at 1600 pixels; what is seen of the surface moves far less. Borders stay as they are:
where two colours meet, each would otherwise shrink away from the other.
"""

FINENESS = 4095
"""Vertices are rounded to this part of half a mesh's longest extent: 0.1 mm on the torso."""

IN_PLACE_OF = {"extended_narrow": "extended_wide"}
"""Meshes of the stock robot's hands, and what may be mounted instead."""

Rgb = tuple[float, float, float]

PEDESTAL = "meshes/base/pedestal_link_collision.DAE"
"""The pedestal's collision mesh: the visual one, 75 000 triangles, falls apart when thinned."""

UNPAINTED: dict[str, Rgb] = {
    "torso": (0.25, 0.25, 0.26),
    "pedestal": (0.19, 0.19, 0.20),
    "sonar_ring": (0.25, 0.25, 0.26),
    "display": (0.05, 0.07, 0.11),
    "left_hand_camera": (0.06, 0.06, 0.08),
    "right_hand_camera": (0.06, 0.06, 0.08),
    "left_hand_range": (0.06, 0.06, 0.08),
    "right_hand_range": (0.06, 0.06, 0.08),
}
"""Colours of links without a painted mesh: the URDF's grey, and glass for its pure blue sensors."""


GREY: Rgb = (0.5, 0.5, 0.5)

DARKEST = 0.09
"""Pure black has no shape: the fingers are painted with this instead."""

_SQUARE = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])
_CIRCLE = np.array([(np.cos(a), np.sin(a)) for a in np.linspace(0.0, 2.0 * np.pi, 48, False)])


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Triangles of one colour: `vertices` (n, 3) in metres, `faces` (m, 3)."""

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    rgb: Rgb


def main() -> None:
    """Write the asset and say how large it became."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--out", type=Path, default=TARGET, help="default: %(default)s")
    out = parser.parse_args().out
    arrays = build(StockFiles.installed())
    content = io.BytesIO()
    np.savez_compressed(content, allow_pickle=False, **arrays)
    replace_file(out, content.getvalue())
    triangles = sum(len(array) for name, array in arrays.items() if name.endswith("/faces"))
    print(f"{out}: {out.stat().st_size / 1e3:.0f} kB, {triangles} triangles")


def build(description: StockFiles) -> dict[str, NDArray[Any]]:
    """Every array of the asset, as `sim.view.appearance` documents them."""
    model = pin.buildModelFromUrdf(str(description.urdf))
    arrays: dict[str, NDArray[Any]] = {}
    parts: dict[str, list[tuple[str, str, Rgb, pin.SE3]]] = {"part": [], "spare": []}
    for visual in _visuals(model, description):
        joint = model.names[visual.parentJoint]
        surfaces = [("part", surface) for surface in _surfaces(visual, description)]
        surfaces += [("spare", surface) for surface in _spares(visual, joint)]
        for kind, surface in surfaces:
            if f"{surface.name}/faces" not in arrays:
                arrays.update(_packed(_thinned(surface)))
            parts[kind].append((surface.name, joint, surface.rgb, visual.placement))
    for kind, rows in parts.items():
        arrays[f"{kind}_mesh"] = np.array([mesh for mesh, _, _, _ in rows])
        arrays[f"{kind}_joint"] = np.array([joint for _, joint, _, _ in rows])
        arrays[f"{kind}_rgb"] = np.array([rgb for _, _, rgb, _ in rows])
        arrays[f"{kind}_xyz_quat_xyzw"] = np.array([pin.SE3ToXYZQUAT(T) for _, _, _, T in rows])
    arrays["notice"] = np.array(_license(description))
    return arrays


def _spares(visual: pin.GeometryObject, joint: str) -> list[Surface]:
    """The surfaces of what may be mounted in place of a visual of the left hand."""
    file = Path(visual.meshPath)
    mesh = IN_PLACE_OF.get(file.stem) if joint.startswith("l_gripper") else None
    return [] if mesh is None else _read(file.with_name(f"{mesh}.DAE"))


def _license(description: StockFiles) -> str:
    return (description.urdf.parent.parent / "LICENSE").read_text(encoding="utf-8")


def _visuals(model: pin.Model, description: StockFiles) -> Iterator[pin.GeometryObject]:
    """The URDF's visuals with joint and placement, sorted by name."""
    urdf, folder = str(description.urdf), str(description.package_dir)
    geometry = pin.buildGeomFromUrdf(model, urdf, pin.GeometryType.VISUAL, package_dirs=[folder])
    for visual in sorted(geometry.geometryObjects, key=lambda visual: visual.name):
        if not any(marker in visual.name for marker in HIDDEN):
            yield visual


def _surfaces(visual: pin.GeometryObject, description: StockFiles) -> list[Surface]:
    """The coloured surfaces of one visual, in the frame of its mesh."""
    link = visual.name.rsplit("_", 1)[0].removesuffix("_link")
    if link == "pedestal":
        surfaces = _read(description.urdf.parent.parent / PEDESTAL)
    elif Path(visual.meshPath).suffix:
        surfaces = _read(Path(visual.meshPath))
        _check_bounds(surfaces, visual)
    else:
        surfaces = [_primitive(visual.geometry, link)]
    return [evolve(surface, rgb=UNPAINTED.get(link, surface.rgb)) for surface in surfaces]


def _primitive(shape: Any, link: str) -> Surface:
    """The mesh of a box or cylinder of the URDF, around its own centre."""
    name = link.removeprefix("left_").removeprefix("right_")
    if isinstance(shape, coal.Box):
        return _prism(name, _SQUARE * shape.halfSide[:2], shape.halfSide[2])
    return _prism(name, _CIRCLE * shape.radius, shape.halfLength)


def _prism(name: str, outline: NDArray[np.float64], half_length: float) -> Surface:
    """The convex `outline` (n, 2) in x and y, drawn out along z to both sides."""
    n = len(outline)
    here, there = np.arange(n), np.roll(np.arange(n), -1)
    sides = [
        np.stack([here, there, here + n], axis=1),
        np.stack([there, there + n, here + n], axis=1),
    ]
    fan = np.stack([np.zeros(n - 2, dtype=np.int64), here[1:-1], there[1:-1]], axis=1)
    vertices = np.concatenate(
        [np.column_stack([outline, np.full(n, z)]) for z in (-half_length, half_length)]
    )
    return Surface(name, vertices, np.concatenate([*sides, fan[:, ::-1], fan + n]), GREY)


def _read(file: Path) -> list[Surface]:
    """The triangles of a COLLADA file by material, lines and points left out."""
    document = collada.Collada(str(file), ignore=[DaeUnsupportedError, DaeBrokenRefError])
    surfaces: list[Surface] = []
    for geometry in document.scene.objects("geometry"):
        for primitive in map(_triangulated, geometry.primitives()):
            if isinstance(primitive, BoundTriangleSet) and len(primitive):
                name = f"{file.stem}.{len(surfaces)}"
                vertices = np.asarray(primitive.vertex, dtype=np.float64)
                faces = np.asarray(primitive.vertex_index, dtype=np.int64).reshape(-1, 3)
                surfaces.append(Surface(name, vertices, faces, _diffuse(primitive.material)))
    return surfaces


def _triangulated(primitive: Any) -> Any:
    return primitive.triangleset() if hasattr(primitive, "triangleset") else primitive


def _diffuse(material: Any) -> Rgb:
    """The diffuse colour as a screen shows it.

    The files' greys are linear light (Blender's export), which a screen would show far too dark;
    the reds look like the robot's as they are.
    """
    if material is None:
        return GREY
    red, green, blue = (float(channel) for channel in material.effect.diffuse[:3])
    if red == green == blue:
        red = green = blue = max(_screen(red), DARKEST)
    return (red, max(green, 0.02), max(blue, 0.02))


def _screen(linear: float) -> float:
    """Linear light to sRGB (IEC 61966-2-1)."""
    return 12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1 / 2.4) - 0.055


def _check_bounds(surfaces: list[Surface], visual: pin.GeometryObject) -> None:
    """Units and axes of a file are read as Pinocchio reads them, or the robot falls apart."""
    shown = np.concatenate([s.vertices[s.faces].reshape(-1, 3) for s in surfaces])
    wanted = np.asarray(visual.geometry.vertices())
    for bound in (np.min, np.max):
        difference = np.abs(bound(shown, axis=0) - bound(wanted, axis=0)).max()
        if difference > WELD_M:
            raise SystemExit(f"{visual.name}: mesh and Pinocchio differ by {difference:.6f} m")


def _thinned(surface: Surface) -> Surface:
    """The surface welded, and without triangles that add nothing to its shape."""
    vertices, faces = _welded(surface)
    unit = np.sqrt(np.finfo(np.float64).eps) / THINNING_M
    vertices, faces = fast_simplification.simplify(
        vertices * unit, faces, target_count=1, lossless=True, preserve_border=True
    )
    return evolve(surface, vertices=vertices / unit, faces=np.asarray(faces, dtype=np.int64))


def _welded(surface: Surface) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices and faces with equal vertices merged, and without empty or repeated faces."""
    corners = surface.vertices[surface.faces].reshape(-1, 3)
    keys = np.rint(corners / WELD_M).astype(np.int64)
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    faces = inverse.reshape(-1, 3)
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    _, kept = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return corners[first], faces[np.sort(kept)]


def _packed(surface: Surface) -> dict[str, NDArray[Any]]:
    """The arrays of one mesh: 16-bit vertices on a uniform scale, 8-bit normals, 16-bit faces."""
    corners = surface.vertices[surface.faces].reshape(-1, 3)
    low, high = corners.min(axis=0), corners.max(axis=0)
    centre, scale = (low + high) / 2.0, float((high - low).max()) / 2.0
    vertices = np.rint((corners - centre) / scale * FINENESS).astype(np.int16)
    normals = np.rint(_corner_normals(surface) * 127.0).astype(np.int8)
    both = np.concatenate([vertices, normals.astype(np.int16)], axis=1)
    unique, first, inverse = np.unique(both, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return {
        f"{surface.name}/vertices": unique[order, :3],
        f"{surface.name}/normals": unique[order, 3:].astype(np.int8),
        f"{surface.name}/faces": rank[inverse.reshape(-1)].reshape(-1, 3).astype(np.uint16),
        f"{surface.name}/centre_scale": np.array([*centre, scale / FINENESS]),
    }


def _corner_normals(surface: Surface) -> NDArray[np.float64]:
    """One unit normal for each corner of each face, shape (3 m, 3).

    The mean of the faces around the vertex, weighted by their area, as far as they meet the
    corner's own face at less than the crease angle.
    """
    edges = np.diff(surface.vertices[surface.faces], axis=1)
    directions = np.cross(edges[:, 0], edges[:, 1])
    areas = np.linalg.norm(directions, axis=1)
    directions /= np.maximum(areas, 1e-300)[:, None]
    around = _faces_around_vertices(surface)[surface.faces.reshape(-1)]
    own = np.repeat(directions, 3, axis=0)
    alike = np.einsum("ci,cki->ck", own, directions[around]) > CREASE_COS
    weights = np.where((around >= 0) & alike, areas[around], 0.0)
    normals = np.einsum("ck,cki->ci", weights, directions[around]) + 1e-15 * own
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.maximum(lengths, 1e-300))


def _faces_around_vertices(surface: Surface) -> NDArray[np.int64]:
    """For each vertex the faces that use it, shape (n, most faces around one), filled with -1."""
    vertex_of_corner = surface.faces.reshape(-1)
    order = np.argsort(vertex_of_corner, kind="stable")
    valence = np.bincount(vertex_of_corner, minlength=len(surface.vertices))
    column = np.arange(len(order)) - np.repeat(np.cumsum(valence) - valence, valence)
    table = np.full((len(surface.vertices), valence.max()), -1)
    table[vertex_of_corner[order], column] = order // 3
    return table


if __name__ == "__main__":
    main()
