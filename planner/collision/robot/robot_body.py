"""RobotBody: what Baxter is taken to be, from Rethink's meshes.

A link has three parts, in metres in the frame of the URDF's link:

- `surface`: triangles, fewer than the mesh of example-robot-data has, and no point of the mesh is
  farther from them than `margin_m`, which is taken from every distance. So a distance of the body
  is at most that of the mesh.
- `enclosure`: a closed surface around the volume that the link's covers enclose. Distances to
  triangles do not tell that something is wholly inside; where motions begin and end, a point of it
  is looked for there. In between nothing gets in without touching triangles, but through the
  openings that covers have where the next link enters, as through those of the meshes.
- `pieces`: a few convex polyhedra, every triangle whole in one of them: bounds, of which the proofs
  that pairs of links stay apart are made.

Fingers and their tips have all triangles of their meshes, with a margin of 0.1 mm so that other
code can prove a plan again that goes as near as it may. What they grasp they touch with their
pieces, of which it is known how deep something is inside: these contain the mesh, and fill its
pockets, at the foot of a finger by up to 5.7 mm, in the pads the holes of screws and what is
between the ribs of a paddle. Ribs are 0.2 mm high and 1.8 mm apart; pads stand on the highest, half
of a paddle at most 0.15 mm before the rib that is nearest. A link without a mesh is the URDF's
shape, as one piece.

`test_robot_body.py` shows the margin for every triangle of the meshes. Pairs of links
are left out where they are rigid to each other, where a proof over all angles of the joints between
finds them apart (as far as `skipped_pairs` says), or where one joint joins them and they touched in
each of 10,000 configurations. Not in the meshes, and so not in the body: cables, covers put on
later, and whatever is mounted on the robot.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from baxter_kin import Baxter
from baxter_kin.description import RobotIdentity
from baxter_kin.display import OneLine, count, millimetres, shown_path
from baxter_kin.errors import FileError
from baxter_kin.fields import Frozen, FrozenMapping, evolve
from baxter_kin.files import open_to_read
from baxter_kin.validation import Checked, finite_scalar
from planner.errors import BodyFileError, SceneError

VERSION = 3
"""Of the data file's layout; a file of another version is refused."""

FILE = Path(__file__).with_name("robot_body.npz")

DIGEST_STEP_M = 1e-7
"""To which vertices are rounded for a digest: the last digits depend on the processor."""

Vertices = NDArray[np.float64]
Triangles = NDArray[np.int64]


class Triangulated(NamedTuple):
    """Triangles: `vertices` (n, 3) in m, `triangles` (m, 3), counter-clockwise from outside."""

    vertices: Vertices
    triangles: Triangles


@dataclass(frozen=True, slots=True, eq=False)
class LinkBody(Checked, Frozen, error=SceneError):
    """The body of one link, in the link's frame.

    Attributes:
        name: of the URDF's link.
        mesh: stem of the mesh file it comes from, or "" where the URDF has a simple shape instead.
        surface: triangles near the mesh's; without any where the pieces are all there is.
        margin_m: what is taken from distances, at least how far the mesh may be from them.
        enclosure: closed surface around what the link encloses; without any where there is none.
        pieces: convex polyhedra around the surface.
        is_touching: whether the pieces are what it touches things with on purpose.
        padding_m: how much thicker than that it counts as, where it must not touch anything.
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
        """Whether there are triangles beside the pieces."""
        return len(self.surface.triangles) > 0

    @property
    def is_in_pieces(self) -> bool:
        """Whether it touches with its pieces, or has nothing else."""
        return self.is_touching or not self.has_surface

    @property
    def whole(self) -> Triangulated:
        """All of its triangles: the surface, or those of all pieces where it has none."""
        if self.has_surface:
            return self.surface
        starts = np.cumsum([0, *(len(piece.vertices) for piece in self.pieces)])
        triangles = [
            piece.triangles + start for piece, start in zip(self.pieces, starts, strict=False)
        ]
        vertices = np.concatenate([piece.vertices for piece in self.pieces])
        return Triangulated(vertices, np.concatenate(triangles))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RobotBody(Checked, Frozen, OneLine, error=SceneError):
    """The bodies of all links, and the pairs of them that need no check.

    Attributes:
        links: link name -> its body; links without any shape are absent. What may be mounted in
            place of a link's mesh is there as `<link>:<mesh>`; see
            `planner.collision.robot.hand_body`.
        skipped_pairs: two link names -> why they are not checked against each other.
    """

    links: Mapping[str, LinkBody]
    skipped_pairs: Mapping[frozenset[str], str]

    def __reduce__(self) -> tuple[Any, ...]:
        is_stored = _stored.cache_info().currsize > 0 and self is _stored()
        return (_stored, ()) if is_stored else Frozen.__reduce__(self)

    @property
    def digest(self) -> str:
        """SHA-256 over all links and pairs that are skipped, 64 hexadecimal digits."""
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
        """The body in a file as `scripts/build_body.py` writes it.

        Raises:
            BodyFileError: as `load`.
        """
        arrays = _arrays(file)
        if "version" not in arrays:
            raise BodyFileError(f"{shown_path(file)} is no body: it names no version")
        if int(arrays["version"]) != VERSION:
            raise BodyFileError(
                f"{shown_path(file)} has version {int(arrays['version'])}, this code reads "
                f"{VERSION}: install the package again"
            )
        links = {name: _link(arrays, row) for row, name in enumerate(arrays["link/name"].tolist())}
        pairs = zip(arrays["pair/links"].tolist(), arrays["pair/reason"].tolist(), strict=True)
        reasons = {frozenset(names): reason for names, reason in pairs}
        return cls(FrozenMapping(links), FrozenMapping(reasons))

    def padded(self, padding_m: float) -> RobotBody:
        """The same body, every link thicker by `padding_m` where it must not touch anything.

        What fingers grasp they still touch where they are.

        Raises:
            SceneError: when the padding is not finite or negative.
        """
        padding_m = finite_scalar(padding_m, "padding_m", SceneError)
        if padding_m < 0.0:
            raise SceneError(f"padding_m is {padding_m:g}; a body cannot be made thinner")
        links = {
            name: replace(link, padding_m=link.padding_m + padding_m)
            for name, link in self.links.items()
        }
        return RobotBody(FrozenMapping(links), self.skipped_pairs)

    def _facts(self) -> tuple[str, ...]:
        links = [link for name, link in self.links.items() if ":" not in name]
        triangles = sum(len(link.surface.triangles) for link in links)
        size = count(len(links), "link"), count(triangles, "triangle")
        padding_m = max((link.padding_m for link in self.links.values()), default=0.0)
        return *size, f"padded {millimetres(padding_m)}" if padding_m > 0.0 else ""


def identity_of(robot: Baxter, body: RobotBody) -> RobotIdentity:
    """Which robot it is, with the body that it is taken to be."""
    return evolve(robot.description.identity, body=body.digest)


@lru_cache(maxsize=8)
def _digest(body: RobotBody) -> str:
    lines = [_words(link) for _, link in sorted(body.links.items())]
    lines += sorted(" ".join(sorted(pair)) for pair in body.skipped_pairs)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def _words(link: LinkBody) -> str:
    """A link's name, numbers and shapes; of the arrays, the digest of their bytes."""
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
    """The body in a row of the table of links: a shape, brought to the frame of the link."""
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
    """Meshes stored one after the other; `counts` (k, 2): their vertices and triangles."""
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
