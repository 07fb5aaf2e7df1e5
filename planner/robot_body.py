"""RobotBody: a draft of a body for Baxter, from Rethink's meshes; it does not contain them yet.

Two levels a link:

- `surface`: triangles around the link's mesh;
- `pieces`: a few convex polyhedra around the surface.

Links that touch things on purpose (fingers, their tips) and links that are convex anyway have
pieces only. All coordinates are metres in the frame of the URDF's link.

What the stored data is short of, measured with up to 150,000 samples a mesh: the mesh stands out
of the surface by 9.9 mm on E0 (upper elbow), 6.9 mm on the torso where the margin is 4 mm, 1.0 mm
on the gripper base, 0.1 to 0.6 mm on the others but S0, where no sample does; the 1.3 mm of the
pedestal are within its margin. The surfaces of torso, pedestal and gripper base are not closed, so
what is inside them is not told reliably. That the pieces cover what a surface encloses is not
shown. `stand_out_m` holds placeholders. Pairs of links one joint apart are skipped without a proof
that they cannot meet.
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
        mesh: stem of the mesh file it comes from, or "" where the URDF has a simple shape instead.
        surface: triangles around the mesh; without any where the pieces alone are the body.
        margin_m: what is added to the surface.
        stand_out_m: how far the finest level shall go beyond the mesh; not measured yet.
        pieces: convex polyhedra around the surface.
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
