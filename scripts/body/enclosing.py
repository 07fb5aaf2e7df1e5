"""What a link encloses: the volume inside a closed surface a little outside its mesh.

Links are hollow covers, open where the next link enters. Plugs close these openings, a filling
keeps slits and seams from being entered, and CGAL's alpha wrapping (Portaneri et al., "Alpha
wrapping with an offset", SIGGRAPH 2022; here through pymeshlab) puts a closed surface around all
of it. It is only asked what is wholly inside, so it need not be as near to the mesh as the
triangles are.
"""

from __future__ import annotations

import numpy as np
import pymeshlab

from body.filling import filling
from body.meshes import triangles
from body.openings import plugs
from body.thinning import Mesh, thinned_closed

ALPHA = 5.0
"""Radius of the wrap's probe, mm: it enters no opening that is narrower than twice that."""

OFFSET = 0.5
"""Of the wrap from the mesh, mm."""

DEVIATION = {"base_link": 2.0, "PEDESTAL": 3.0}
"""By how much the wrap may be thinned, mm, 0.5 where not named; a point may be missed so far inside
the mesh, and what is there and touches nothing is smaller still."""

FILL = {"base_link": (2.5, 12.0, 6.0), "PEDESTAL": (4.0, 24.0, 11.0)}
"""Voxel, ball and rim of `filling`, mm, where the mesh is large."""


def enclosure(mesh: str) -> Mesh:
    """The closed surface around what a mesh encloses; vertices in mm."""
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
