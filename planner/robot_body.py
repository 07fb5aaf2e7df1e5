"""RobotBody: a body for Baxter that is meant to be nowhere smaller than Rethink's meshes.

Two levels a link, both built from the meshes and both closed:

- `surface`: triangles that enclose the link's mesh and stand out from it by at most `stand_out_m`;
- `pieces`: a few convex polyhedra whose union contains the surface and all that it encloses.

A surface has no inside for a collision checker. That is enough for a proof over a motion: a body
that is outside the pieces, or nowhere inside the surface, at the start cannot be inside later
without having met the surface. What is wholly inside at the start is met by the pieces.

Links that touch things on purpose (fingers, their tips) and links that are convex anyway have
pieces only, and these are as close to the mesh as `stand_out_m` says.

All coordinates are metres in the frame of the URDF's link, where the fixed or moving joint above it
puts it. The data is a first, coarse version; its containment was measured at samples, not proven.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.errors import BodyFileError

VERSION = 1
"""Of the data file's layout; a file of another version is refused."""

FILE = "robot_body.npz"

Vertices = NDArray[np.float64]
Triangles = NDArray[np.int64]


class Polyhedron(NamedTuple):
    """A closed mesh: `vertices` (n, 3) in m, `triangles` (m, 3), counter-clockwise from outside."""

    vertices: Vertices
    triangles: Triangles


@dataclass(frozen=True, slots=True, eq=False)
class LinkBody:
    """The body of one link, in the link's frame.

    Attributes:
        name: of the URDF's link.
        mesh: stem of the mesh file it encloses, or "" where the URDF has a simple shape instead.
        surface: the enclosing triangles; without any where the pieces alone are the body.
        margin_m: what must be added to the surface so that it contains the mesh; 0 if nothing.
        stand_out_m: how far the finest level goes beyond the mesh at most, filled openings apart.
        pieces: convex polyhedra whose union contains surface and mesh.
    """

    name: str
    mesh: str
    surface: Polyhedron
    margin_m: float
    stand_out_m: float
    pieces: tuple[Polyhedron, ...]

    @property
    def is_touching(self) -> bool:
        """Whether the pieces alone are the body, exact enough to touch with."""
        return len(self.surface.triangles) == 0


@dataclass(frozen=True, slots=True, eq=False)
class RobotBody:
    """The bodies of all links, and the pairs of them that need no check.

    Attributes:
        links: link name -> its body; links without any shape are absent.
        skipped_pairs: two link names -> why they are not checked against each other.
    """

    links: Mapping[str, LinkBody]
    skipped_pairs: Mapping[frozenset[str], str]

    @classmethod
    def load(cls) -> RobotBody:
        """Read the data file that comes with the package.

        Raises:
            BodyFileError: when the file is missing, unreadable or of another version.
        """
        arrays = _arrays()
        if int(arrays["version"]) != VERSION:
            raise BodyFileError(
                f"{FILE} has version {int(arrays['version'])}, this code reads {VERSION}:"
                " install the package again"
            )
        links = {name: _link(arrays, row) for row, name in enumerate(arrays["link/name"].tolist())}
        pairs = zip(arrays["pair/links"].tolist(), arrays["pair/reason"].tolist(), strict=True)
        reasons = {frozenset(names): reason for names, reason in pairs}
        return cls(MappingProxyType(links), MappingProxyType(reasons))


def _arrays() -> dict[str, NDArray[Any]]:
    try:
        file = resources.files("planner").joinpath(FILE)
        with file.open("rb") as stream, np.load(stream, allow_pickle=False) as data:
            return dict(data)
    except (OSError, ValueError) as error:
        raise BodyFileError(f"{FILE} cannot be read: {error}") from error


def _link(arrays: dict[str, NDArray[Any]], row: int) -> LinkBody:
    """The body in a row of the table of links: a shape, brought to the frame of the link."""
    shape = str(arrays["link/shape"][row])
    R, p = arrays["link/R_link_shape"][row], arrays["link/p_link_shape"][row]
    margin_m, stand_out_m = arrays[f"{shape}/margin_standout"].tolist()
    counts = arrays[f"{shape}/piece_counts"]
    polyhedra = _split(
        arrays[f"{shape}/vertices"] @ R.T + p, arrays[f"{shape}/triangles"].astype(np.int64), counts
    )
    return LinkBody(
        name=str(arrays["link/name"][row]),
        mesh=str(arrays["link/mesh"][row]),
        surface=polyhedra[0],
        margin_m=margin_m,
        stand_out_m=stand_out_m,
        pieces=polyhedra[1:],
    )


def _split(
    vertices: Vertices, triangles: Triangles, counts: NDArray[np.int64]
) -> tuple[Polyhedron, ...]:
    """Polyhedra stored one after the other; `counts` (k, 2): their vertices and triangles."""
    parts = []
    ends = np.cumsum(counts, axis=0)
    for (v_end, t_end), (v_count, t_count) in zip(ends.tolist(), counts.tolist(), strict=True):
        parts.append(
            Polyhedron(
                _frozen(vertices[v_end - v_count : v_end]),
                _frozen(triangles[t_end - t_count : t_end]),
            )
        )
    return tuple(parts)


def _frozen(array: NDArray[Any]) -> NDArray[Any]:
    array = np.ascontiguousarray(array)
    array.setflags(write=False)
    return array
