"""The volume that a link encloses: the inside of a closed surface a little outside its mesh.

Links are hollow covers, open where the next link enters. Plugs close these openings, a filling
keeps slits and seams from being entered, and CGAL's alpha wrapping (Portaneri et al., "Alpha
wrapping with an offset", SIGGRAPH 2022; here through pymeshlab) puts a closed surface around all
of it. It only decides what is completely inside, so it may be less exact than the triangles.

A plug is the hull of what the mesh has inside a box, so it ends flush with the opening's rim, or a
cylinder a little larger than the disc that turns in a slot. There the other link's cover stands, so
nothing is lost by closing it; wrapped open, the surface would line the inside of every cover.
All lengths in mm, in the frame of the mesh.
"""

from __future__ import annotations

import manifold3d
import numpy as np
import pymeshlab
import trimesh
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, label

from body.meshes import samples, triangles
from body.pieces import clipped, convex_hull
from body.thinning import Mesh, thinned_closed

F = NDArray[np.float64]

INF = 1e6

RIMS: dict[str, list[tuple[tuple[float, float, float], tuple[float, float, float]]]] = {
    "S0": [((-INF, -INF, 33), (INF, INF, 38))],
    "S1": [((114, -INF, -INF), (119, INF, INF))],
    "E0": [((-INF, -INF, 14), (INF, INF, 19))],
    "E1": [((86, -INF, -INF), (90, INF, INF))],
    "W0": [((-INF, -INF, -16), (INF, INF, -10)), ((-50, -36, 222), (INF, 36, 340))],
    "W1": [((162, -INF, -INF), (167, INF, INF))],
    "H0": [((-INF, -INF, 20), (INF, INF, 28)), ((40, -INF, -23), (INF, INF, 28))],
    "H1": [((-30, -26, -26), (3, 26, 26))],
    "base_link": [
        ((-16, 182, 152), (144, 340, 156.5)),
        ((-16, -340, 152), (144, -182, 156.5)),
        ((-15, -90, 714), (INF, 90, 724)),
        ((-200, -200, -58), (200, 200, -50)),
    ],
}
"""Boxes (low, high corner) around rims: the hull of the mesh inside one closes the opening."""

DISCS: dict[str, tuple[str, tuple[float, float, float], float, float]] = {
    "S1": ("z", (0.0, 0.0, 0.0), 66.5, 60.0),
    "E1": ("z", (0.0, 0.0, 0.0), 64.5, 60.0),
    "W1": ("z", (0.0, 0.0, 0.0), 54.5, 60.0),
    "S0": ("y", (69.0, 0.0, 270.35), 62.0, 34.5),
    "E0": ("y", (69.0, 0.0, 262.42), 61.0, 34.5),
    "PEDESTAL": ("z", (0.0, 0.0, -370.0), 100.3, 280.0),
}
"""Cylinders: axis, centre, radius, half length. For slots, the radius of the rotating disc."""

CORES: dict[str, list[tuple[tuple[float, float, float], tuple[float, float, float], float]]] = {
    "W2": [((-INF, -INF, 90), (INF, INF, 112), 0.92)],
    "electric_gripper_base": [((-21.5, -24.5, -44), (20, 9, 44), 0.95)],
}
"""Boxes: the hull of the mesh inside, shrunk by the factor, fills a housing."""

BLOCKS: dict[str, list[tuple[tuple[float, float, float], tuple[float, float, float]]]] = {
    "electric_gripper_base": [((-19, 8, -43), (18, 16.5, 43))],
}
"""Boxes that are filled completely."""

FLOORS = {"PEDESTAL": (-734.0, 4.0)}
"""Height and thickness of a plate across the outermost outline; the foot is open below."""


def plugs(mesh: str) -> F:
    """The triangles of all plugs of a mesh, shape (n, 3, 3), mm."""
    soup = triangles(mesh)
    found = [
        convex_hull(clipped(soup, np.array(low), np.array(high)).reshape(-1, 3))
        for low, high in RIMS.get(mesh, [])
    ]
    if mesh in DISCS:
        found.append(_cylinder(*DISCS[mesh]))
    found += [_core(soup, *core) for core in CORES.get(mesh, [])]
    for block in BLOCKS.get(mesh, []):
        corners = np.array(np.meshgrid(*np.array(block).T)).reshape(3, -1).T
        found.append(convex_hull(corners.astype(np.float64)))
    solids = [vertices[faces] for vertices, faces in found]
    if mesh in FLOORS:
        solids.append(_floor(soup, *FLOORS[mesh]))
    return np.concatenate(solids) if solids else np.zeros((0, 3, 3))


def _cylinder(
    axis: str, centre: tuple[float, float, float], radius: float, half: float
) -> tuple[F, NDArray[np.int64]]:
    angles = np.arange(96) * 2.0 * np.pi / 96
    circle = np.column_stack([radius * np.cos(angles), radius * np.sin(angles)])
    ring = np.concatenate([np.insert(circle, "xyz".index(axis), z, axis=1) for z in (-half, half)])
    return convex_hull(ring + centre)


def _core(
    soup: F,
    low: tuple[float, float, float],
    high: tuple[float, float, float],
    factor: float,
) -> tuple[F, NDArray[np.int64]]:
    points = clipped(soup, np.array(low), np.array(high)).reshape(-1, 3)
    centre = (points.min(axis=0) + points.max(axis=0)) / 2.0
    return convex_hull((points - centre) * factor + centre)


def _floor(soup: F, height: float, thickness: float) -> F:
    """A plate inside the largest outline of the mesh at that height, half a millimetre smaller."""
    mesh = trimesh.Trimesh(soup.reshape(-1, 3), np.arange(3 * len(soup)).reshape(-1, 3))
    section = mesh.section((0.0, 0.0, 1.0), (0.0, 0.0, height))
    if section is None:
        raise SystemExit("the foot has no outline at its floor")
    loops = [np.asarray(loop)[:-1, :2] for loop in section.discrete]
    outline = max(loops, key=lambda loop: abs(_area(loop)))
    outline = outline if _area(outline) > 0 else outline[::-1]
    inset = manifold3d.CrossSection([outline]).offset(-0.5, manifold3d.JoinType.Round)
    plate = manifold3d.Manifold.extrude(inset, thickness).to_mesh()
    vertices = np.asarray(plate.vert_properties, dtype=np.float64)[:, :3] + [0.0, 0.0, height]
    return np.asarray(vertices[plate.tri_verts])


def _area(loop: F) -> float:
    ahead = np.roll(loop, -1, axis=0)
    return float(0.5 * np.sum(loop[:, 0] * ahead[:, 1] - ahead[:, 0] * loop[:, 1]))


def filling(soup: F, voxel: float, ball: float, rim: float) -> F:
    """The boundary of the filled voxels as triangles (n, 3, 3), mm."""
    points = samples(soup, 0.6 * voxel)
    low = points.min(axis=0) - ball - 4.0 * voxel
    shape = np.ceil((points.max(axis=0) + ball + 4.0 * voxel - low) / voxel).astype(int)
    full = np.zeros(shape, dtype=bool)
    full[tuple(((points - low) / voxel).astype(int).T)] = True
    centres = distance_transform_edt(~full) * voxel > ball
    regions, _ = label(centres)
    swept = distance_transform_edt(regions != regions[0, 0, 0]) * voxel <= ball
    core = distance_transform_edt(~swept) * voxel > rim
    return np.asarray(np.concatenate(_sides(core)) * voxel + low)


def _sides(core: NDArray[np.bool_]) -> list[F]:
    """Two triangles for every voxel side between core and the rest, in voxels."""
    padded = np.pad(core, 1)
    triangles = []
    for axis in range(3):
        along, across = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        for side in (0, 1):
            neighbour = np.roll(padded, 1 - 2 * side, axis=axis)[1:-1, 1:-1, 1:-1]
            corner = np.argwhere(core & ~neighbour).astype(np.float64)
            corner[:, axis] += side
            square = [corner, corner + along, corner + along + across, corner + across]
            triangles.append(np.stack([square[0], square[1], square[2]], axis=1))
            triangles.append(np.stack([square[0], square[2], square[3]], axis=1))
    return triangles


ALPHA = 5.0
"""Radius of the wrap's probe, mm: it enters no opening that is narrower than twice that."""

OFFSET = 0.5
"""Distance of the wrap from the mesh, mm."""

DEVIATION = {"base_link": 2.0, "PEDESTAL": 3.0}
"""Maximum deviation of the thinned wrap, mm, by default 0.5; points inside the mesh may be missed
up to this depth."""

FILL = {"base_link": (2.5, 12.0, 6.0), "PEDESTAL": (4.0, 24.0, 11.0)}
"""Voxel, ball and rim of `filling`, mm, where the mesh is large."""


def enclosure(mesh: str) -> Mesh:
    """The closed surface around the volume that a mesh encloses; vertices in mm."""
    solid = np.concatenate([triangles(mesh), plugs(mesh)])
    core = filling(solid, *FILL.get(mesh, (1.5, 8.0, 7.0)))
    vertices, faces = np.unique(
        np.concatenate([solid, core]).reshape(-1, 3), axis=0, return_inverse=True
    )
    scene = pymeshlab.MeshSet()
    scene.add_mesh(pymeshlab.Mesh(vertices * 1e-3, faces.reshape(-1, 3)))
    scene.generate_alpha_wrap(
        alpha=pymeshlab.PureValue(ALPHA * 1e-3), offset=pymeshlab.PureValue(OFFSET * 1e-3)
    )
    wrap = scene.current_mesh()
    corners = (wrap.vertex_matrix() * 1e3)[wrap.face_matrix()]
    return thinned_closed(corners, DEVIATION.get(mesh, 0.5), spacing=4.0)
