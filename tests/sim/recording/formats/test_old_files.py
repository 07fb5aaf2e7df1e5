"""Files of earlier versions; `old/run.*` are of one run, by the last version that wrote them."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Baxter
from sim import EventKind, read_recording, save_recording
from sim.errors import RecordingError
from tests.sim.recording.identical import differences

OLD = Path(__file__).parent / "old"
NPZ, LOG, MCAP = (OLD / f"run{suffix}" for suffix in (".npz", ".jsonl", ".mcap"))
VALUES = ("q_sent", "q_measured", "q_path", "v_measured", "age_s", "lateness_s", "has_error")


@pytest.fixture(scope="module")
def log() -> list[dict[str, Any]]:
    """The lines of the log, by the standard library."""
    return [json.loads(line) for line in LOG.read_text("ascii").splitlines()]


class TestWhatTheyHave:
    """Everything that they have is read, to the bit."""

    def test_npz_and_log_of_a_run_are_the_same_recording(self) -> None:
        """A log has all of the samples, an npz file set-points and measured positions alone."""
        one, other = (read_recording(path) for path in (NPZ, LOG))
        assert one.notes == other.notes == ()
        found = list(differences(one.recording, other.recording))
        assert all(".samples[" in each and "NoneType" in each for each in found), found

    def test_arrays_are_those_that_numpy_finds(self) -> None:
        found = read_recording(NPZ).recording
        with np.load(NPZ, allow_pickle=False) as entries:
            for name in ("times_s", "q", "gripper_percent"):
                assert getattr(found, name).tobytes() == entries[name].tobytes()
            document = json.loads(entries["document"].tobytes())
            tracks = dict(zip(document["tracks"], entries["body_poses"], strict=True))
            sent = entries["added_commands_left"]
        assert {n: x.tobytes() for n, x in found.body_poses.items()} == {
            n: x.tobytes() for n, x in tracks.items()
        }
        commands = found.commands["left"]
        assert np.column_stack(
            [commands.times_s, commands.q_sent, commands.q_measured]
        ).tolist() == (sent.tolist())
        assert [list(caption) for caption in found.captions] == document["captions"]

    def test_a_log_is_what_its_lines_say(self, log: list[dict[str, Any]]) -> None:
        found = read_recording(LOG).recording
        shots = [line["snapshot"] for line in log if "snapshot" in line]
        assert found.times_s.tolist() == [shot["time_s"] for shot in shots]
        assert found.q.tolist() == [shot["q"] for shot in shots]
        events = [line["event"] for line in log if "event" in line]
        assert [(e.time_s, e.kind.name, e.text, e.side) for e in found.events] == [
            (e["time_s"], e["kind"], e["text"], e["side"]) for e in events
        ]
        (move,) = (line["move"] for line in log if "move" in line)
        assert found.moves[0].trajectory.q.tolist() == move["trajectory"]["q"]
        assert found.moves[0].label == move["label"]
        samples = [line["sample"] for line in log if "sample" in line]
        for name in VALUES:
            values = [getattr(sample, name) for sample in found.samples]
            assert np.array(values).tolist() == [sample[name] for sample in samples]
        there = np.isfinite(found.body_poses["block"]).all(axis=1)
        assert there.tolist() == [1 <= i < 9 for i in range(11)]
        block = next(e.body for e in found.events if e.kind is EventKind.GRASPED)
        assert same(block, found.bodies["block"])

    def test_mcap_with_messages_of_ros_1_has_its_joints(self, robot: Baxter) -> None:
        found = read_recording(MCAP, robot, topic="/joint_states").recording
        wanted = read_recording(LOG).recording
        assert found.q.tolist() == wanted.q.tolist()
        assert found.times_s == pytest.approx(wanted.times_s, abs=1.1e-9)
        assert [event.text for event in found.events] == [event.text for event in wanted.events]

    @pytest.mark.parametrize("path", [NPZ, LOG], ids=["npz", "log"])
    def test_they_move_to_mcap_to_the_bit(self, path: Path, tmp_path: Path) -> None:
        old = read_recording(path).recording
        save_recording(old, tmp_path / "new.mcap")
        assert list(differences(read_recording(tmp_path / "new.mcap").recording, old)) == []


def same(one: object, other: object) -> bool:
    return not list(differences(one, other))


def rewritten(path: Path, change: Callable[[dict[str, Any]], dict[str, Any]]) -> Path:
    """The npz file with other arrays."""
    with np.load(NPZ) as entries:
        arrays = dict(entries)
    np.savez(path, **change(arrays))
    return path


@pytest.mark.parametrize("version", [1, 2, 3, 4])
def test_npz_files_of_earlier_versions_are_read(tmp_path: Path, version: int) -> None:
    """They had a checksum of the other entries besides."""

    def change(arrays: dict[str, Any]) -> dict[str, Any]:
        content = arrays["document"].tobytes()
        older = content.replace(b'"version":5', f'"version":{version}'.encode())
        checksum = np.zeros(32, np.uint8)
        return {**arrays, "document": np.frombuffer(older, np.uint8), "sha256": checksum}

    found = read_recording(rewritten(tmp_path / "old.npz", change)).recording
    assert same(found, read_recording(NPZ).recording)


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


class TestRefusedNpz:
    """A truncated, foreign or edited file."""

    @settings(max_examples=20)
    @given(st.data())
    def test_truncated_anywhere(
        self, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
    ) -> None:
        path = tmp_path_factory.getbasetemp() / "cut.npz"
        path.write_bytes(NPZ.read_bytes()[: data.draw(st.integers(0, len(NPZ.read_bytes()) - 1))])
        with pytest.raises(RecordingError, match=r"cut\.npz: is no npz file"):
            read_recording(path)

    @settings(max_examples=25)
    @given(st.data())
    def test_a_changed_byte_is_refused_or_changes_nothing(
        self, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
    ) -> None:
        folder = tmp_path_factory.getbasetemp()
        damaged = bytearray(NPZ.read_bytes())
        damaged[data.draw(st.integers(0, len(NPZ.read_bytes()) - 1))] = data.draw(
            st.integers(0, 255)
        )
        (folder / "damaged.npz").write_bytes(damaged)
        try:
            found = read_recording(folder / "damaged.npz")
        except RecordingError:
            return
        assert same(found.recording, read_recording(NPZ).recording)

    @pytest.mark.parametrize("name", ["q", "body_poses", "document"])
    def test_an_entry_that_is_no_array(self, tmp_path: Path, name: str) -> None:
        whole = zipfile.ZipFile(io.BytesIO(NPZ.read_bytes()))
        for content in (b"", b"no array", *map(npy_header, HEADERS)):
            with zipfile.ZipFile(tmp_path / "bad.npz", "w") as archive:
                for entry in whole.namelist():
                    data = content if entry == f"{name}.npy" else whole.read(entry)
                    archive.writestr(entry, data)
            with pytest.raises(RecordingError, match=r"bad\.npz: (is no npz file|has an entry)"):
                read_recording(tmp_path / "bad.npz")

    def test_another_npz_or_one_with_other_arrays(self, tmp_path: Path) -> None:
        path = tmp_path / "other.npz"
        np.savez(path, q=np.zeros(3))
        with pytest.raises(RecordingError, match="entries"):
            read_recording(path)
        float32 = rewritten(path, lambda arrays: {**arrays, "q": arrays["q"].astype(np.float32)})
        with pytest.raises(RecordingError, match=r"q of float32 .* float64"):
            read_recording(float32)
        unsafe = np.array([{"an": "object"}], dtype=object)
        pickled = rewritten(path, lambda arrays: {**arrays, "q": unsafe})
        with pytest.raises(RecordingError, match="pickle"):
            read_recording(pickled)

    def test_an_array_that_claims_to_be_larger_than_its_bytes(self, tmp_path: Path) -> None:
        header = np.lib.format.magic(1, 0)
        text = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }\n"
        with zipfile.ZipFile(NPZ) as whole, zipfile.ZipFile(tmp_path / "b.npz", "w") as bomb:
            for name in whole.namelist():
                data = header + len(text).to_bytes(2, "little") + text
                bomb.writestr(name, data if name == "q.npy" else whole.read(name))
        with pytest.raises(RecordingError, match="is no npz file, or a truncated or damaged one"):
            read_recording(tmp_path / "b.npz")

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (('"version":5', '"version":6'), "version 6"),
            (("baxter-kin recording", "baxter-kin something"), "format"),
            (('"tracks":[', '"tracks":["more",'), "tracks"),
            (('"captions":', '"titles":'), "captions is missing"),
            (('"captions":', '"titles":[],"captions":'), "titles"),
            (('"start_s":', '"start_s":"early","was":'), r"moves\[0\]\.start_s"),
            (('"start_s":', '"was":1.0,"start_s":'), r"moves\[0\] has an entry 'was'"),
            (("{", ""), "not complete JSON"),
        ],
    )
    def test_another_document(self, tmp_path: Path, change: tuple[str, str], words: str) -> None:
        def changed(arrays: dict[str, Any]) -> dict[str, Any]:
            content = arrays["document"].tobytes().decode().replace(*change, 1)
            return {**arrays, "document": np.frombuffer(content.encode(), np.uint8)}

        with pytest.raises(RecordingError, match=words):
            read_recording(rewritten(tmp_path / "other.npz", changed))


@settings(max_examples=25)
@given(st.data())
def test_a_log_cut_anywhere_keeps_the_lines_before(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = tmp_path_factory.getbasetemp() / "cut.jsonl"
    content = LOG.read_bytes()[: data.draw(st.integers(0, len(LOG.read_bytes()) - 1))]
    path.write_bytes(content)
    complete = [line for line in content.split(b"\n")[:-1] if b"snapshot" in line]
    if not complete:
        with pytest.raises(RecordingError):
            read_recording(path)
        return
    found, notes = read_recording(path)
    assert len(found.times_s) == len(complete)
    assert "the run was cut short" in notes[-1]
    assert ("half written" in notes[0]) == (not content.endswith(b"\n"))


def test_nul_bytes_after_a_power_failure_are_a_half_written_line(tmp_path: Path) -> None:
    path = tmp_path / "run.jsonl"
    path.write_bytes(LOG.read_bytes()[: LOG.read_bytes().rindex(b'{"end"')] + bytes(512))
    found, notes = read_recording(path)
    assert len(found.times_s) == 11
    assert len(notes) == 2


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"baxter-kin log", b"something", "no log"),
        (b'"version":4', b'"version":"1"', "version"),
        (b'{"snapshot"', b'{"picture"', "line 4: .*picture"),
        (b'{"snapshot":', b'{"event":', "line 4: event"),
        (b'"q":[', b'"q":[0.5,', r"line 4: q .*20"),
        (b'"q":[', b'"q":[NaN,', "line 4: .*NaN"),
        (b'"q":[', b'"q":[1e999,', "line 4: .*1e999"),
        (b'"q":[', b'"q":[1e99,', r"line 4: snapshot\.q"),
        (b'"q":[', b'"q":[' + 400 * b"1" + b",", r"line 4: snapshot\.q"),
        (b'"q":[', b'"q":' + 100_000 * b"[", "nested|JSON"),
        (b'{"snapshot":{"time_s":0.01', b'{"snapshot":{"time_s":0.0', "after one at 0 s"),
        (b'{"snapshot"', b'[1,2]\n{"snapshot"', "line 4: .*one entry"),
        (b'{"snapshot"', b'{"end":0}\n{"snapshot"', "line 5: .*end"),
        (b'{"snapshot"', b'\n{"snapshot"', "line 4: .*JSON"),
        (b'"kind":"SPAWNED"', b'"kind":"HATCHED"', "line 6: event.kind"),
        (b'"is_movable"', b'"has_legs"', "line 2: .*has_legs"),
    ],
)
def test_a_damaged_line_is_refused_with_its_number(
    tmp_path: Path, old: bytes, new: bytes, words: str
) -> None:
    path = tmp_path / "run.jsonl"
    path.write_bytes(LOG.read_bytes().replace(old, new, 1))
    with pytest.raises(RecordingError, match=words):
        read_recording(path)


def test_snapshots_that_are_missing_are_noted(tmp_path: Path) -> None:
    lines = LOG.read_bytes().splitlines(keepends=True)
    fewer = [line for line in lines if b'{"snapshot":{"time_s":0.05' not in line]
    (tmp_path / "run.jsonl").write_bytes(b"".join(fewer))
    assert read_recording(tmp_path / "run.jsonl").notes == ("1 of 11 snapshots are missing",)


def test_a_body_that_nobody_introduced_is_noted(tmp_path: Path) -> None:
    lines = LOG.read_bytes().splitlines(keepends=True)
    (tmp_path / "run.jsonl").write_bytes(b"".join(line for line in lines if b'{"body"' not in line))
    found, notes = read_recording(tmp_path / "run.jsonl")
    assert found.bodies == {}
    assert notes == ("left out, as their shapes are not in the file: ['table', 'block']",)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"\n", "is no log"),
        (b"time,left_s0\n", "is no log"),
        (b"[]\n", "is no log"),
        (b"PK\x03\x04\xff\n", "is no text"),
    ],
)
def test_what_is_no_log_is_refused(tmp_path: Path, content: bytes, words: str) -> None:
    (tmp_path / "run.jsonl").write_bytes(content)
    with pytest.raises(RecordingError, match=words):
        read_recording(tmp_path / "run.jsonl")
