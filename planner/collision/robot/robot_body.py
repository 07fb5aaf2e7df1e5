"""RobotBody: the geometry of Baxter's links, derived from Rethink's meshes.

A link has three parts, in metres in the frame of the URDF's link:

- `surface`: triangles, fewer than in the mesh of example-robot-data. No point of the mesh is
  farther from them than `margin_m`, which is subtracted from every distance. So a distance of the
  body is at most that of the mesh.
- `enclosure`: a closed surface around the volume that the link's covers enclose. Distances to
  triangles do not reveal that a shape is wholly inside; where motions begin and end, the enclosure
  does. In between, nothing gets inside without touching triangles, except through the openings of
  the covers where the next link enters, as in the meshes.
- `pieces`: a few convex polyhedra, each triangle wholly in one of them: bounds, from which the
  proofs that pairs of links stay apart are made.

Fingers and their tips have all triangles of their meshes, with a margin of 0.1 mm so that
independent code can prove a plan again that goes as near as allowed. They touch what they grasp
with their pieces, because depths in these are known. The pieces contain the mesh and fill its
pockets: at the foot of a finger by up to 5.7 mm, and in the pads the holes of screws and the gaps
between the ribs of a paddle. Ribs are 0.2 mm high and 1.8 mm apart; the pads are at the highest
rib, for half of a paddle at most 0.15 mm before the nearest rib. A link without a mesh is the
URDF's shape, as one piece.

`test_robot_body.py` shows the margin for every triangle of the meshes. Pairs of links are skipped
where they are rigid to each other, where a proof over all angles of the joints between them finds
them apart (`skipped_pairs` gives the reason), or where one joint connects them and they touched in
each of 10,000 configurations. The meshes, and so the body, do not contain cables, covers added
later, and anything mounted on the robot.

`fitted` is the body of a robot with its own hands. The body that comes with the package is that of
the stock robot. A finger or tip of another mesh has the body of that mesh, which is on the same
finger of some hand and therefore has the same pose there. A tool becomes polyhedra around its
shapes: boxes as they are, cylinders and spheres circumscribed, which are larger by at most 0.13 %
and 1.9 % of their radius.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping
from functools import cache, lru_cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin import Baxter
from baxter_kin.description import RobotDescription, RobotIdentity
from baxter_kin.description.hands import is_finger, is_tool
from baxter_kin.description.urdf import ShapeKind, UrdfJoint, UrdfShape
from baxter_kin.display import count, millimetres, shown_path
from baxter_kin.errors import FileError
from baxter_kin.fields import evolve, frozen, mapping
from baxter_kin.files import open_to_read
from baxter_kin.validation import FloatArray, finite_scalar
from planner.errors import BodyFileError, SceneError
from planner.scene.coal_shapes import hull_of, triangles_of

VERSION = 3
"""Version of the data file's layout; a file of another version is refused."""

FILE = Path(__file__).with_name("robot_body.npz")

DIGEST_STEP_M = 1e-7
"""Vertices are rounded to this for a digest, as the last digits depend on the processor."""

PRISM_SIDES = 64
"""Sides of the prism around a cylinder: larger by 1 / cos(pi / 64) - 1 of its radius."""

BALL_POINTS = 200
"""Corners of the polyhedron around a ball: larger by at most 1.9 % of its radius."""

Vertices = NDArray[np.float64]
Triangles = NDArray[np.int64]


class Triangulated(NamedTuple):
    """Triangles: `vertices` (n, 3) in m, `triangles` (m, 3), counter-clockwise from outside."""

    vertices: Vertices
    triangles: Triangles


_NOTHING = Triangulated(np.empty((0, 3)), np.empty((0, 3), np.int64))


@frozen(error=SceneError)
class LinkBody:
    """The body of one link, in the link's frame.

    Attributes:
        name: of the URDF's link.
        mesh: stem of the mesh file it comes from, or "" where the URDF has a simple shape instead.
        surface: triangles close to the mesh's; empty where the pieces are the whole body.
        margin_m: amount subtracted from distances, at least the distance of the mesh from the
            triangles.
        enclosure: closed surface around the volume that the link encloses; empty for none.
        pieces: convex polyhedra around the surface.
        is_touching: whether its intended contacts are those of the pieces.
        padding_m: additional thickness where it must not touch anything.
    """

    name: str
    mesh: str
    surface: Triangulated
    margin_m: float
    enclosure: Triangulated
    pieces: tuple[Triangulated, ...]
    is_touching: bool = False
    padding_m: float = 0.0

    @property
    def has_surface(self) -> bool:
        """Whether it has triangles in addition to the pieces."""
        return len(self.surface.triangles) > 0

    @property
    def is_in_pieces(self) -> bool:
        """Whether its pieces count: in intended contacts, or because it has nothing else."""
        return self.is_touching or not self.has_surface

    @property
    def whole(self) -> Triangulated:
        """All of its triangles: the surface, or without one those of all pieces."""
        if self.has_surface:
            return self.surface
        starts = np.cumsum([0, *(len(piece.vertices) for piece in self.pieces)])
        triangles = [
            piece.triangles + start for piece, start in zip(self.pieces, starts, strict=False)
        ]
        vertices = np.concatenate([piece.vertices for piece in self.pieces])
        return Triangulated(vertices, np.concatenate(triangles))


@frozen(error=SceneError)
class RobotBody:
    """The bodies of all links, and the pairs of them that need no check.

    Attributes:
        links: link name -> its body; links without any shape are absent. A mesh that may replace
            that of a link has the key `<link>:<mesh>`; `fitted` uses these.
        skipped_pairs: two link names -> the reason why they are not checked against each other.
    """

    links: Mapping[str, LinkBody] = mapping()
    skipped_pairs: Mapping[frozenset[str], str] = mapping()

    def __reduce__(self) -> tuple[Any, ...]:
        is_stored = _stored.cache_info().currsize > 0 and self is _stored()
        return (_stored, ()) if is_stored else (RobotBody, (self.links, self.skipped_pairs))

    @property
    def digest(self) -> str:
        """SHA-256 of all links and skipped pairs, 64 hexadecimal digits."""
        return _digest(self)

    @classmethod
    def load(cls) -> RobotBody:
        """The body that comes with the package; its file is read once.

        Raises:
            BodyFileError: when the file is missing, unreadable or of another version.
        """
        return _stored()

    @classmethod
    def read(cls, file: Path) -> RobotBody:
        """The body in a file written by `scripts/build_body.py`.

        Raises:
            BodyFileError: when the file is missing, unreadable or of another version.
        """
        arrays = _arrays(file)
        if "version" not in arrays:
            raise BodyFileError(f"{shown_path(file)} is not a robot body: it has no version")
        if int(arrays["version"]) != VERSION:
            raise BodyFileError(
                f"{shown_path(file)} has version {int(arrays['version'])}, this code reads "
                f"{VERSION}: install the package again"
            )
        links = {name: _link(arrays, row) for row, name in enumerate(arrays["link/name"].tolist())}
        pairs = zip(arrays["pair/links"].tolist(), arrays["pair/reason"].tolist(), strict=True)
        reasons = {frozenset(names): reason for names, reason in pairs}
        return cls(links, reasons)

    def padded(self, padding_m: float) -> RobotBody:
        """The same body, every link thicker by `padding_m` where it must not touch anything.

        Intended contacts of fingers do not change.

        Raises:
            SceneError: when the padding is not finite or negative.
        """
        padding_m = finite_scalar(padding_m, "padding_m", SceneError)
        if padding_m < 0.0:
            raise SceneError(f"padding_m must not be negative, got {padding_m:g}")
        links = {
            name: evolve(link, padding_m=link.padding_m + padding_m)
            for name, link in self.links.items()
        }
        return RobotBody(links, self.skipped_pairs)

    def _facts(self) -> tuple[str, ...]:
        links = [link for name, link in self.links.items() if ":" not in name]
        triangles = sum(len(link.surface.triangles) for link in links)
        size = count(len(links), "link"), count(triangles, "triangle")
        padding_m = max((link.padding_m for link in self.links.values()), default=0.0)
        return *size, f"padded {millimetres(padding_m)}" if padding_m > 0.0 else ""


def identity_of(robot: Baxter, body: RobotBody) -> RobotIdentity:
    """The identity of a robot, including the digest of its body."""
    return evolve(robot.description.identity, body=body.digest)


@lru_cache(maxsize=8)
def _digest(body: RobotBody) -> str:
    lines = [_words(link) for _, link in sorted(body.links.items())]
    lines += sorted(" ".join(sorted(pair)) for pair in body.skipped_pairs)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def _words(link: LinkBody) -> str:
    """A link's name, numbers and shapes; arrays are represented by the digest of their bytes."""
    parts = hashlib.sha256()
    for part in (link.surface, link.enclosure, *link.pieces):
        parts.update(np.array([len(part.vertices), len(part.triangles)], "<i8").tobytes())
        parts.update(np.rint(part.vertices / DIGEST_STEP_M).astype("<i8").tobytes())
        parts.update(part.triangles.astype("<i8").tobytes())
    numbers = f"{link.margin_m!r} {link.padding_m!r} {link.is_touching!r}"
    return f"{link.name} {numbers} {parts.hexdigest()}"


@cache
def _stored() -> RobotBody:
    return RobotBody.read(FILE)


def _arrays(file: Path) -> dict[str, NDArray[Any]]:
    try:
        with open_to_read(file) as stream, np.load(stream, allow_pickle=False) as data:
            return dict(data)
    except FileError as cause:
        raise BodyFileError(f"{shown_path(file)} cannot be read: {cause.reason}") from cause
    except (OSError, ValueError, TypeError, EOFError, BadZipFile) as error:
        raise BodyFileError(f"{shown_path(file)} cannot be read: {error}") from error


def _link(arrays: dict[str, NDArray[Any]], row: int) -> LinkBody:
    """The body in a row of the table of links: a shape, transformed to the frame of the link."""
    shape = str(arrays["link/shape"][row])
    R, p = arrays["link/R_link_shape"][row], arrays["link/p_link_shape"][row]
    vertices = np.concatenate([arrays[f"{shape}/vertices"], arrays[f"{shape}/corners"]]) @ R.T + p
    triangles = arrays[f"{shape}/triangles"].astype(np.int64)
    surface, enclosure, *pieces = _split(vertices, triangles, arrays[f"{shape}/counts"])
    return LinkBody(
        name=str(arrays["link/name"][row]),
        mesh=str(arrays["link/mesh"][row]),
        surface=surface,
        margin_m=float(arrays[f"{shape}/margin_m"]),
        enclosure=enclosure,
        pieces=tuple(pieces),
        is_touching=bool(arrays[f"{shape}/is_touching"]),
    )


def _split(
    vertices: Vertices, triangles: Triangles, counts: NDArray[np.int64]
) -> tuple[Triangulated, ...]:
    """Meshes stored one after the other; `counts`, (k, 2): numbers of vertices and triangles."""
    parts = []
    ends = np.cumsum(counts, axis=0)
    for (v_end, t_end), (v_count, t_count) in zip(ends.tolist(), counts.tolist(), strict=True):
        parts.append(
            Triangulated(
                _frozen(vertices[v_end - v_count : v_end]),
                _frozen(triangles[t_end - t_count : t_end]),
            )
        )
    return tuple(parts)


def _frozen(array: NDArray[Any]) -> NDArray[Any]:
    array = np.ascontiguousarray(array)
    array.setflags(write=False)
    return array


@lru_cache(maxsize=8)
def fitted(body: RobotBody, description: RobotDescription) -> RobotBody:
    """The body with the robot's own hands; the same object where these are the body's.

    It keeps links that the robot lacks.
    """
    other = {link.name: link for link in _other_links(body, description)}
    if not other:
        return body
    return RobotBody({**body.links, **other}, body.skipped_pairs)


def _other_links(body: RobotBody, description: RobotDescription) -> Iterator[LinkBody]:
    for joint in description.tree.joints:
        known = body.links.get(joint.child)
        if is_tool(joint.child):
            yield _tool(joint, body)
        elif known is not None and is_finger(joint.child) and joint.shapes[0].mesh != known.mesh:
            found = _of_mesh(body, joint.child, joint.shapes[0].mesh)
            yield evolve(found, name=known.name, padding_m=known.padding_m)


def _of_mesh(body: RobotBody, link: str, mesh: str) -> LinkBody:
    """A finger or tip with a mesh, on the same finger of its hand as a link."""
    finger = "_l_finger" if "_l_finger" in link else "_r_finger"
    for other in body.links.values():
        if other.mesh == mesh and finger in other.name:
            return other
    raise SceneError(f"the link {link} has the mesh {mesh}, but the body has no shape of it")


def _tool(joint: UrdfJoint, body: RobotBody) -> LinkBody:
    """A shape of a tool, with the padding of the hand that it is on."""
    (shape,) = joint.shapes
    hand = body.links.get(joint.parent)
    piece = polyhedron_around(shape)
    padding_m = hand.padding_m if hand else 0.0
    return LinkBody(joint.child, "", _NOTHING, 0.0, _NOTHING, (piece,), padding_m=padding_m)


def polyhedron_around(shape: UrdfShape) -> Triangulated:
    """A convex polyhedron around a box, cylinder or sphere, in the frame of its link."""
    if shape.kind is ShapeKind.BOX:
        points = np.array(list(product((-0.5, 0.5), repeat=3))) * shape.size_m
    elif shape.kind is ShapeKind.CYLINDER:
        radius, length = shape.size_m
        angles = 2 * math.pi * np.arange(PRISM_SIDES) / PRISM_SIDES
        rim = radius / math.cos(math.pi / PRISM_SIDES) * np.array([np.cos(angles), np.sin(angles)])
        ends = (np.full(PRISM_SIDES, z) for z in (-length / 2, length / 2))
        points = np.concatenate([np.column_stack([*rim, end]) for end in ends])
    else:
        (radius,) = shape.size_m
        on_ball = _directions(BALL_POINTS)
        vertices, triangles = triangles_of(hull_of(on_ball))
        a, b, c = vertices[triangles].swapaxes(0, 1)
        normals = np.cross(b - a, c - a)
        depths = np.einsum("ij,ij->i", normals, a) / np.linalg.norm(normals, axis=1)
        points = radius / depths.min() * on_ball
    R = pin.rpy.rpyToMatrix(np.array(shape.rpy))
    vertices, triangles = triangles_of(hull_of(points))
    placed = np.ascontiguousarray(vertices @ R.T + np.array(shape.xyz))
    return Triangulated(placed, triangles.astype(np.int64))


def _directions(count: int) -> FloatArray:
    """Unit vectors spread over a ball, shape (n, 3): a spiral by the golden angle (Vogel 1979)."""
    number = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * number / count, math.pi * (1.0 + math.sqrt(5.0)) * number
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)
