"""Recordings in npz files: all of it comes back, and nothing but what was saved."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from planner import Body, Mesh, Part
from sim import Recorder, Recording, Simulation, World, load_recording, save_recording
from sim.errors import RecordingError
from sim.recording import npz_file
from sim.view.replay import replay_html
from tests.conftest import at
from tests.sim.conftest import assert_same

ENTRIES = {"times_s", "q", "gripper_percent", "body_poses", "document"}


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory, picked: Recording) -> Path:
    path = tmp_path_factory.mktemp("npz") / "run.npz"
    save_recording(picked, path)
    return path


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory, robot: Baxter) -> bytes:
    """The bytes of three snapshots."""
    recorder = Recorder(robot)
    Simulation(World(robot), [recorder]).wait(0.02)
    path = tmp_path_factory.mktemp("small") / "small.npz"
    save_recording(recorder.recording(), path)
    return path.read_bytes()


def test_all_comes_back_to_the_bit(path: Path, picked: Recording) -> None:
    assert_same(load_recording(path), picked)


def test_it_plays_exactly_like_the_original(path: Path, picked: Recording, robot: Baxter) -> None:
    assert replay_html(load_recording(path), robot) == replay_html(picked, robot)


def test_the_same_recording_gives_the_same_bytes(path: Path, tmp_path: Path) -> None:
    save_recording(load_recording(path), str(tmp_path / "again.npz"))
    assert (tmp_path / "again.npz").read_bytes() == path.read_bytes()


def test_numpy_opens_it_too_without_pickle(path: Path, picked: Recording) -> None:
    with np.load(path, allow_pickle=False) as entries:
        assert set(entries) == ENTRIES
        assert entries["q"].tolist() == picked.q.tolist()
        document = json.loads(entries["document"].tobytes())
    assert document["format"] == "baxter-kin recording"
    assert document["version"] == 5


def test_meshes_and_colours_come_back(picked: Recording, tmp_path: Path) -> None:
    corners = 0.1 * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    mesh = Part(Mesh(corners, faces), at(0.0, 0.1, 0.0), (0.1, 0.2, 0.3, 0.4))
    odd = Body("odd \u00e9 name", (mesh,), at(1.0, 2.0, 3.0), is_movable=True)
    save_recording(evolve(picked, bodies={odd.name: odd}, body_poses={}), tmp_path / "mesh.npz")
    found = load_recording(tmp_path / "mesh.npz").bodies[odd.name]
    shape = found.parts[0].shape
    assert isinstance(shape, Mesh)
    assert shape.is_convex
    assert shape.vertices.tolist() == corners.tolist()
    assert shape.triangles.tolist() == faces.tolist()
    assert found.parts[0].rgba == mesh.rgba


@given(st.lists(st.floats(-1e6, 1e6), min_size=19, max_size=19), st.text())
def test_any_numbers_and_text_come_back(
    robot: Baxter, tmp_path_factory: pytest.TempPathFactory, q: list[float], caption: str
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.npz"
    wanted = Recording(robot.joint_names, [1.0], [q], [[0.0, 1.0]], {}, {}, ((1.0, caption),), ())  # type: ignore[arg-type]  # anything NumPy makes an array of
    save_recording(wanted, path)
    assert_same(load_recording(path), wanted)


@pytest.mark.parametrize("version", [1, 2, 3, 4])
def test_files_of_earlier_versions_are_read(path: Path, tmp_path: Path, version: int) -> None:
    """They had a checksum of the other entries besides."""
    with np.load(path) as entries:
        arrays = dict(entries)
    document = arrays["document"].tobytes().replace(b'"version":5', f'"version":{version}'.encode())
    arrays["document"] = np.frombuffer(document, np.uint8)
    np.savez(tmp_path / "old.npz", **arrays, sha256=np.zeros(32, np.uint8))
    assert_same(load_recording(tmp_path / "old.npz"), load_recording(path))


HEADERS = [
    "{'descr': '<f8', 'fortran_order': False, 'shape': (10**30,)}",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000000000000000000000,)}",
    "{'descr': '<f8', 'fortran_order': False, 'shape': ()}",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (True,)}",
    "{'descr': ((),()), 'fortran_order': False, 'shape': (1,)}",
    "{[]: 1}",
    "{(",
    "  x\n y\n",
]


def npy_header(text: str) -> bytes:
    """The beginning of an array's file, with that for a header, and one number after it."""
    header = text.encode()
    return np.lib.format.magic(1, 0) + len(header).to_bytes(2, "little") + header + bytes(8)


class TestRefused:
    """A truncated, foreign or edited file."""

    @given(st.data())
    def test_truncated_anywhere(
        self, small: bytes, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
    ) -> None:
        path = tmp_path_factory.getbasetemp() / "cut.npz"
        path.write_bytes(small[: data.draw(st.integers(0, len(small) - 1))])
        with pytest.raises(RecordingError, match=r"cut\.npz: is no npz file, or a truncated"):
            load_recording(path)

    @given(st.data())
    def test_a_changed_byte_is_refused_or_changes_nothing(
        self, small: bytes, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
    ) -> None:
        folder = tmp_path_factory.getbasetemp()
        (folder / "whole.npz").write_bytes(small)
        damaged = bytearray(small)
        damaged[data.draw(st.integers(0, len(small) - 1))] = data.draw(st.integers(0, 255))
        (folder / "damaged.npz").write_bytes(damaged)
        try:
            found = load_recording(folder / "damaged.npz")
        except RecordingError:
            return
        assert_same(found, load_recording(folder / "whole.npz"))

    def test_an_array_of_other_numbers(self, path: Path, tmp_path: Path) -> None:
        with np.load(path) as entries:
            arrays = dict(entries)
        arrays["q"] = arrays["q"].astype(np.float32)
        np.savez(tmp_path / "other.npz", **arrays)
        with pytest.raises(
            RecordingError,
            match="an entry q of float32 and 2 axes, where it must be of float64 and have 2",
        ):
            load_recording(tmp_path / "other.npz")

    @pytest.mark.parametrize("name", ["q", "body_poses", "document"])
    @pytest.mark.parametrize(
        "content",
        [b"", b"no array", *map(npy_header, HEADERS)],
        ids=lambda content: repr(content[10:40]),
    )
    def test_an_entry_that_is_no_array(
        self, small: bytes, tmp_path: Path, name: str, content: bytes
    ) -> None:
        whole = zipfile.ZipFile(io.BytesIO(small))
        with zipfile.ZipFile(tmp_path / "bad.npz", "w") as archive:
            for entry in whole.namelist():
                data = content if entry == f"{name}.npy" else whole.read(entry)
                archive.writestr(entry, data)
        with pytest.raises(RecordingError, match=r"bad\.npz: (is no npz file|has an entry)"):
            load_recording(tmp_path / "bad.npz")

    def test_another_npz(self, tmp_path: Path) -> None:
        np.savez(tmp_path / "other.npz", q=np.zeros(3))
        with pytest.raises(RecordingError, match="is no recording: it has the entries"):
            load_recording(tmp_path / "other.npz")

    def test_pickled_objects_are_never_read(self, path: Path, tmp_path: Path) -> None:
        with np.load(path) as entries:
            arrays: dict[str, Any] = dict(entries)
        arrays["q"] = np.array([{"an": "object"}], dtype=object)
        np.savez(tmp_path / "pickle.npz", **arrays)
        with pytest.raises(
            RecordingError, match=r"is no npz file, or a truncated or damaged one: .*pickle"
        ):
            load_recording(tmp_path / "pickle.npz")

    def test_an_array_that_claims_to_be_larger_than_its_bytes(
        self, path: Path, tmp_path: Path
    ) -> None:
        header = np.lib.format.magic(1, 0)
        text = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }\n"
        with zipfile.ZipFile(path) as whole, zipfile.ZipFile(tmp_path / "b.npz", "w") as bomb:
            for name in whole.namelist():
                data = header + len(text).to_bytes(2, "little") + text
                bomb.writestr(name, data if name == "q.npy" else whole.read(name))
        with pytest.raises(RecordingError, match="is no npz file, or a truncated or damaged one"):
            load_recording(tmp_path / "b.npz")

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (
                ('"version":5', '"version":6'),
                r"has version 6, but only \(1, 2, 3, 4, 5\) are read here",
            ),
            (("baxter-kin recording", "baxter-kin something"), "its format is"),
            (('"tracks":[', '"tracks":["more",'), "tracks under"),
            (('"captions":', '"titles":'), r"recording\.captions is missing"),
            (('"captions":', '"titles":[],"captions":'), "recording has an entry 'titles'"),
            (('"start_s":', '"start_s":"early","was":'), r"moves\[0\]\.start_s must be of type"),
            (('"start_s":', '"was":1.0,"start_s":'), r"moves\[0\] has an entry 'was'; a Recorded"),
            (("{", ""), "not complete JSON"),
        ],
    )
    def test_another_document(
        self,
        picked: Recording,
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
        change: tuple[str, str],
        words: str,
    ) -> None:
        made = npz_file._document(picked).replace(*change, 1)
        monkeypatch.setattr(npz_file, "_document", lambda _: made)
        save_recording(picked, tmp_path / "other.npz")
        with pytest.raises(RecordingError, match=words):
            load_recording(tmp_path / "other.npz")

    @pytest.mark.parametrize("bad", [None, 3, b"x", ["x"]])
    def test_what_is_no_path(self, picked: Recording, bad: Any) -> None:
        with pytest.raises(RecordingError, match="path"):
            load_recording(bad)
        with pytest.raises(RecordingError, match="path"):
            save_recording(picked, bad)

    @pytest.mark.parametrize("name", ["no/run.npz", "", "a\0b"])
    def test_a_path_that_leads_nowhere(self, picked: Recording, tmp_path: Path, name: str) -> None:
        path = f"{tmp_path}/{name}"
        with pytest.raises(RecordingError, match=r"cannot read|not a regular file"):
            load_recording(path)
        with pytest.raises(RecordingError, match="cannot write"):
            save_recording(picked, path)


@pytest.mark.parametrize("added", [1e-308, "x", iter(())], ids=["number", "text", "iterator"])
def test_added_arrays_must_be_a_mapping(picked: Recording, tmp_path: Path, added: Any) -> None:
    with pytest.raises(RecordingError):
        save_recording(picked, tmp_path / "run.npz", added=added)
