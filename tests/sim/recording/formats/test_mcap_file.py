"""MCAP: everything comes back to the bit, also from a file whose writer was killed."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from planner import Body, Mesh, Part, Plan, State
from planner.grasping import Grasp
from planner.scene.bodies import Attachment, Box, Sphere
from sim import (
    Event,
    EventKind,
    Recorder,
    Recording,
    Simulation,
    World,
    read_recording,
    save_recording,
)
from sim.errors import RecordingError
from sim.recording import RecordedMove
from sim.recording.formats import mcap_file
from sim.recording.formats.mcap_file import SCHEMAS
from sim.recording.recording import RecordedSample
from sim.view.replay import replay_html
from sim.world.contacts import Contact
from tests.conftest import at
from tests.sim.recording import bags
from tests.sim.recording.identical import differences
from tests.sim.runs import Run

SIMULATED_S = 2.0
"""How much simulated time has passed when the test kills."""

DEADLINE_S = 60.0
MAGIC = b"\x89MCAP0\r\n"

ENDLESS = """
import sys
from baxter_kin import Baxter
from sim import Recorder, Simulation, World
robot = Baxter.load()
simulation = Simulation(World(robot), [Recorder(robot, path) for path in sys.argv[1:]])
while True:
    simulation.wait(0.1)
    print(simulation.time_s, flush=True)
"""
TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
NUMBERS = st.floats(-1e30, 1e30)
SMALL = st.floats(-9.0, 9.0)
SIDES = st.sampled_from(["left", "right"])


def arrays(*shape: int) -> st.SearchStrategy[Any]:
    size = int(np.prod(shape))
    flat = st.lists(NUMBERS, min_size=size, max_size=size)
    return flat.map(lambda values: np.array(values).reshape(shape))


@st.composite
def bodies(draw: st.DrawFn, name: str) -> Body:
    sizes = draw(st.tuples(*[st.floats(1e-3, 1.0)] * 3))
    corners = sizes[0] * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    mesh = Mesh(corners, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]))
    known: list[Box | Sphere | Mesh] = [Box(sizes), Sphere(sizes[0]), mesh]
    shapes = draw(st.lists(st.sampled_from(known), min_size=1, max_size=2))
    parts = tuple(Part(shape, at(0.1, draw(SMALL), 0.0)) for shape in shapes)
    return Body(name, parts, at(draw(SMALL), 0.0, draw(SMALL)), draw(st.booleans()))


@st.composite
def events(draw: st.DrawFn, known: tuple[Body, ...], moves: tuple[Any, ...]) -> Event:
    details: list[Contact | Grasp | None] = [
        Contact(draw(NUMBERS), draw(TEXTS), "table", draw(st.booleans()), draw(NUMBERS), True, 0.1),
        Grasp(draw(NUMBERS), at(draw(SMALL), 0.1, 0.2), 0.05, 0.0, draw(NUMBERS), 0.0, False),
        None,
    ]
    body: Body | None = draw(st.sampled_from([*known, None]) | bodies("another"))
    if body is not None and draw(st.booleans()):
        body = body.at(at(draw(SMALL), draw(SMALL), 0.0))
    return Event(
        draw(NUMBERS),
        draw(st.sampled_from(EventKind)),
        draw(TEXTS),
        draw(st.none() | SIDES),
        draw(st.sampled_from([*moves, None])),
        body,
        draw(st.sampled_from(details)),
    )


def time_of(each: Event | RecordedSample) -> float:
    return each.time_s


@st.composite
def samples(draw: st.DrawFn) -> RecordedSample:
    values = (draw(SIDES), draw(NUMBERS), draw(arrays(7)), draw(arrays(7)))
    if draw(st.booleans()):
        return RecordedSample(*values)
    flags = [draw(st.booleans()) for _ in range(3)]
    return RecordedSample(
        *values, draw(arrays(7)), draw(arrays(7)), draw(NUMBERS), draw(NUMBERS), *flags
    )


@st.composite
def recordings(draw: st.DrawFn, plan: Plan) -> Recording:
    """Any recording: what a simulation would never do included."""
    times = sorted(draw(st.sets(NUMBERS, min_size=1, max_size=4)))
    names = tuple(draw(st.lists(TEXTS, unique=True, max_size=3)))
    known = tuple(draw(bodies(name)) for name in ("table", "block", "wall"))
    known = known[: draw(st.integers(0, 3))]
    tracks = {body.name: draw(arrays(len(times), 7)) for body in known}
    for track in tracks.values():
        track[draw(st.integers(0, len(times) - 1))] = draw(st.sampled_from([0.0, np.nan]))
    moves = tuple(
        RecordedMove(draw(NUMBERS), draw(TEXTS), move.trajectory, move.ik, move.contacts)
        for move in draw(st.sampled_from([(), plan.moves[:1], plan.moves[:2]]))
    )
    held = (Attachment("block", "left_gripper", at(0.0, draw(SMALL), 0.0)),)
    start = State(plan.start.scene, {**plan.start.joints, "another": draw(NUMBERS)}, held)
    return Recording(
        names,
        np.array(times),
        draw(arrays(len(times), len(names))),
        draw(arrays(len(times), 2)),
        {body.name: body for body in known},
        tracks,
        tuple(sorted(draw(st.lists(st.tuples(NUMBERS, TEXTS), max_size=3)))),
        tuple(sorted(draw(st.lists(events(known, plan.moves[:2]), max_size=3)), key=time_of)),
        tuple(sorted(moves, key=lambda each: each.start_s)),
        draw(st.sampled_from([plan.robot, None])),
        draw(st.sampled_from([("left", "right"), ("left",), ("right",)])),
        tuple(sorted(draw(st.lists(samples(), max_size=3)), key=time_of)),
        draw(st.sampled_from([start, None])),
    )


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory, picked: Recording) -> Path:
    path = tmp_path_factory.mktemp("mcap") / "run.mcap"
    save_recording(picked, path)
    return path


def messages(path: Path, *topics: str) -> list[Any]:
    """What is in them, by the library's reader and the standard library."""
    with path.open("rb") as stream:
        found = make_reader(stream).iter_messages(topics=topics)
        return [json.loads(message.data) for _, _, message in found]


class TestEverythingComesBack:
    """To the bit."""

    @pytest.mark.slow
    @settings(max_examples=30)
    @given(data=st.data())
    def test_of_any_recording(
        self, plan: Plan, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
    ) -> None:
        path = tmp_path_factory.getbasetemp() / "any.mcap"
        recording = data.draw(recordings(plan))
        save_recording(recording, path)
        found, notes = read_recording(path)
        assert list(differences(found, recording)) == []
        assert notes == ()

    def test_of_a_run_written_while_it_happens(self, run: Run, robot: Baxter, path: Path) -> None:
        with Recorder(robot, path) as recorder:
            simulation = Simulation(run.world, [recorder])
            simulation.execute(run.plan(), "demo, ", unverified=True)
            simulation.delete("block")
            simulation.wait(0.1)
        kept = recorder.recording()
        found, notes = read_recording(path)
        assert list(differences(found, kept)) == []
        assert notes == ()
        details = [type(event.detail).__name__ for event in found.events if event.detail]
        assert details == ["Push", "Grasp", "Rest"]
        steps = [event.move for event in found.events if event.move is not None]
        assert all(step.state is not None for step in steps)
        assert found.start is not None
        assert set(found.start.scene.bodies) == {"table", "block"}

    @pytest.mark.slow
    def test_it_plays_like_the_original_and_is_written_again_the_same(
        self, file: Path, picked: Recording, robot: Baxter, path: Path
    ) -> None:
        found = read_recording(file).recording
        assert replay_html(found, robot) == replay_html(picked, robot)
        path.write_bytes(b"older")
        save_recording(found, str(path))
        assert path.read_bytes() == file.read_bytes()


class TestForOthers:
    """What Foxglove and other programs find."""

    def test_every_message_fits_its_schema(self, file: Path) -> None:
        validators: dict[str, Any] = {}
        with file.open("rb") as stream:
            reader = make_reader(stream)
            for schema, channel, message in reader.iter_messages():
                assert schema is not None
                assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
                assert schema.name == SCHEMAS[channel.topic][0]
                validators.setdefault(
                    channel.topic, jsonschema.Draft202012Validator(json.loads(schema.data))
                ).validate(json.loads(message.data))

    def test_joints_and_frames_are_those_that_foxglove_knows(
        self, file: Path, picked: Recording
    ) -> None:
        """Names and fields of foxglove.JointStates and foxglove.FrameTransforms."""
        states = messages(file, "/joint_states")
        assert [[joint["position"] for joint in each["joints"]] for each in states] == (
            picked.q.tolist()
        )
        assert {joint["name"] for each in states for joint in each["joints"]} == set(
            picked.joint_names
        )
        stamps = [each["timestamp"]["sec"] + 1e-9 * each["timestamp"]["nsec"] for each in states]
        assert stamps == pytest.approx(picked.times_s, abs=1.1e-9)
        frames = messages(file, "/tf")
        for row in (0, 100, len(frames) - 1):
            found = {each["child_frame_id"]: each for each in frames[row]["transforms"]}
            there = {n for n, track in picked.body_poses.items() if np.isfinite(track[row]).all()}
            assert set(found) == there
            for name, each in found.items():
                pose = [each["translation"][i] for i in "xyz"] + [
                    each["rotation"][i] for i in "xyzw"
                ]
                assert pose == picked.body_poses[name][row].tolist()
                assert each["parent_frame_id"] == "base"

    def test_events_say_what_happened_and_an_index_leads_to_every_chunk(
        self, file: Path, picked: Recording
    ) -> None:
        found = [(each["kind"], each["text"]) for each in messages(file, "/events")]
        assert found == [(event.kind.name, event.text) for event in picked.events]
        with file.open("rb") as stream:
            summary = make_reader(stream).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert len(summary.chunk_indexes) == summary.statistics.chunk_count > 1


class TestCutShort:
    """A process was killed, or a copy was not finished."""

    @pytest.mark.slow
    def test_a_killed_run_keeps_all_but_the_last_moments(
        self, robot: Baxter, tmp_path: Path
    ) -> None:
        files = [tmp_path / "run.mcap", tmp_path / "run.csv"]
        command = [sys.executable, "-c", ENDLESS, *map(str, files)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            passed_s = 0.0
            while passed_s < SIMULATED_S:
                passed_s = float(process.stdout.readline())
            process.send_signal(signal.SIGKILL)
            process.wait(DEADLINE_S)
            lines = [float(line) for line in process.stdout if line.endswith("\n")]
        assert process.returncode == -signal.SIGKILL
        passed_s = max([passed_s, *lines])
        found, notes = read_recording(files[0])
        assert found.times_s[-1] > passed_s - 2.0  # a chunk at that speed
        assert "the file was cut short" in notes[-1]
        assert read_recording(files[1], robot).recording.times_s[-1] >= passed_s - 1e-6

    def test_an_event_is_on_disk_at_once(self, robot: Baxter, block: Body, path: Path) -> None:
        with Recorder(robot, path) as recorder:
            simulation = Simulation(World(robot), [recorder])
            simulation.wait(0.05)
            simulation.spawn(block)
            killed = path.with_name("killed.mcap")
            killed.write_bytes(path.read_bytes())
        found = read_recording(killed).recording
        assert [event.kind for event in found.events] == [EventKind.SPAWNED]
        assert len(found.times_s) >= 5

    def test_memory_keeps_only_what_it_should(self, robot: Baxter, path: Path) -> None:
        with Recorder(robot, path, keep=1) as recorder:
            Simulation(World(robot), [recorder]).wait(1.0)
        assert len(recorder.recording().times_s) == 1
        assert len(read_recording(path).recording.times_s) == 101

    def test_cut_anywhere_it_gives_what_is_there(
        self, robot: Baxter, block: Body, tmp_path: Path
    ) -> None:
        path, cut = tmp_path / "run.mcap", tmp_path / "cut.mcap"
        with Recorder(robot, path) as recorder:
            simulation = Simulation(World(robot), [recorder])
            simulation.wait(0.03)
            simulation.spawn(block)
            simulation.wait(0.03)
        content, rows = path.read_bytes(), set[int]()
        step = 29  # any other one passes, too: every byte takes a minute
        for size in range(0, len(content), step):
            cut.write_bytes(content[:size])
            failure, found = bags.tried(read_recording, cut, robot)
            assert not failure or "cut short" in failure or size < len(MAGIC)
            if found is not None:
                assert found.notes == ("the file was cut short: what follows is missing",)
                rows.add(len(found.recording.times_s))
        assert rows == {4, 7}

    @settings(max_examples=25)
    @given(data=st.data())
    @pytest.mark.parametrize("kind", ["own", "lz4", "zstd"])
    def test_any_damage_is_refused_or_harmless(
        self,
        robot: Baxter,
        file: Path,
        tmp_path_factory: pytest.TempPathFactory,
        data: st.DataObject,
        kind: str,
    ) -> None:
        path = tmp_path_factory.getbasetemp() / f"damaged {kind}.mcap"
        whole = path.with_name(f"{kind}.mcap")
        if kind != "own" and not whole.exists():
            bags.write_mcap(whole, bags.of_baxter(0.2), kind)
        content = bytearray((file if kind == "own" else whole).read_bytes())
        for _ in range(data.draw(st.integers(1, 4))):
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
        path.write_bytes(bytes(content))
        failure = bags.failure_of(read_recording, path, robot)
        assert not failure or path.name in failure
        assert "\n" not in failure


def edited(file: Path, path: Path, change: Callable[[str, Any], Any]) -> Path:
    """The file with each message's content changed, by the library alone."""
    with file.open("rb") as stream, path.open("wb") as output:
        reader, writer = make_reader(stream), Writer(output)
        writer.start()
        for each in reader.iter_metadata():
            writer.add_metadata(each.name, change("head", dict(each.metadata)))
        channels: dict[str, int] = {}
        for _, channel, message in reader.iter_messages():
            if channel.topic not in channels:
                kind = writer.register_schema(channel.topic, "jsonschema", b"{}")
                channels[channel.topic] = writer.register_channel(channel.topic, "json", kind)
            data = json.dumps(change(channel.topic, json.loads(message.data))).encode()
            writer.add_message(channels[channel.topic], message.log_time, data, 0)
        writer.finish()  # type: ignore[no-untyped-call]  # of the library
    return path


NOWHERE = {"x": {"rotation": np.eye(3).tolist(), "translation": [0, 0, 0]}}


@pytest.mark.parametrize(
    ("topic", "change", "words"),
    [
        ("head", {"version": "2"}, "version"),
        ("head", {"joint_names": "x"}, "JSON"),
        ("head", {"limbs": '["middle"]'}, "limbs"),
        ("/joint_states", {"joints": []}, "other joints"),
        ("/joint_states", {"time_s": 0.5}, "0.5 s after"),
        ("/joint_states", {"time_s": "x"}, "real numbers"),
        ("/joint_states", {"gripper_percent": [1.0]}, "shape"),
        ("/tf", {"transforms": [{}]}, "transforms"),
        ("/tf", {"transforms": 5}, "transforms"),
        ("/events", {"kind": "HATCHED"}, r"events\.kind"),
        ("/moves", {"start_s": "early"}, r"moves\.start_s"),
        ("/bodies", {"has_legs": 4}, "has_legs"),
        ("/start", {"T_base_bodies": NOWHERE}, "shapes"),
    ],
)
def test_a_damaged_message_is_refused(
    file: Path, path: Path, topic: str, change: dict[str, Any], words: str
) -> None:
    def changed(of: str, data: Any) -> Any:
        return {**data, **change} if of == topic else data

    with pytest.raises(RecordingError, match=rf"run\.mcap: .*{words}"):
        read_recording(edited(file, path, changed))


class TestWriting:
    """Files that cannot be written, and values that have no place in them."""

    def test_a_disk_that_fills_up_is_reported_each_time(
        self, robot: Baxter, path: Path, small_disk: Callable[[int], None]
    ) -> None:
        small_disk(10_000)
        recorder = Recorder(robot, path, keep=1)
        simulation = Simulation(World(robot), [recorder])
        for _ in ("when it happens", "whatever comes later"):
            with pytest.raises(RecordingError, match="No space left"):
                simulation.wait(5.0)
        recorder.close()

    def test_numbers_that_are_too_large(self, picked: Recording, path: Path) -> None:
        large = evolve(picked, captions=((1e31, "late"),))
        with pytest.raises(RecordingError, match="cannot be saved"):
            save_recording(large, path)


def test_a_base_install_writes_and_reads_it(tmp_path: Path) -> None:
    """Without the extra for ROS 1."""
    code = """
import sys
sys.modules["rosbags"] = None
from baxter_kin import Baxter
from sim import Recorder, Simulation, World, read_recording, save_recording
robot = Baxter.load()
with Recorder(robot, sys.argv[1]) as recorder:
    Simulation(World(robot), [recorder]).wait(0.1)
save_recording(read_recording(sys.argv[1]).recording, sys.argv[2])
assert len(read_recording(sys.argv[2], robot).recording.times_s) == 11
"""
    files = [str(tmp_path / "run.mcap"), str(tmp_path / "run.csv")]
    subprocess.run([sys.executable, "-c", code, *files], check=True, timeout=DEADLINE_S)


class TestMessagesOfRos1:
    """As `mcap convert` makes them of bags, and as earlier versions wrote them."""

    @pytest.mark.parametrize("compression", ["lz4", "zstd"])
    def test_compressed_chunks_are_read(self, robot: Baxter, path: Path, compression: str) -> None:
        bags.write_mcap(path, bags.of_baxter(), compression)
        assert len(read_recording(path, robot).recording.times_s) == 100

    @settings(max_examples=15)
    @given(st.integers(8, 100_000))
    def test_one_cut_anywhere_gives_the_chunks_before(
        self, robot: Baxter, tmp_path_factory: pytest.TempPathFactory, size: int
    ) -> None:
        path = tmp_path_factory.getbasetemp() / "whole.mcap"
        content = path.read_bytes() if path.exists() else b""
        if len(content) < 100_000:
            content = bags.write_mcap(path, bags.of_baxter(4.0)).read_bytes()
        cut = path.with_name("cut off.mcap")
        cut.write_bytes(content[:size])
        failure = bags.failure_of(read_recording, cut, robot)
        text = failure or "; ".join(read_recording(cut, robot).notes)
        assert "the file was cut short: what follows is missing" in text

    @pytest.mark.parametrize(
        ("encoding", "definition", "words"),
        [
            ("cdr", None, "cdr"),
            ("ros1", b"float64 position\n", "sensor_msgs/JointState has other fields"),
        ],
    )
    def test_messages_that_are_not_ros_1s_are_named(
        self, robot: Baxter, path: Path, encoding: str, definition: bytes | None, words: str
    ) -> None:
        text = bags.STORE.generate_msgdef(bags.JOINT_STATE)[0].encode()
        with path.open("wb") as stream:
            writer = Writer(stream)
            writer.start()
            schema = writer.register_schema("sensor_msgs/JointState", "ros1msg", definition or text)
            channel = writer.register_channel("/joint_states", encoding, schema)
            writer.add_message(channel, 0, b"abc", 0)
            writer.finish()  # type: ignore[no-untyped-call]  # of the library
        with pytest.raises(RecordingError, match=f"has no joint states .*{words}"):
            read_recording(path, robot)

    def test_a_chunk_that_unpacks_to_more_than_it_may(
        self, robot: Baxter, path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        bags.write_mcap(path, bags.of_baxter(1.0), "zstd")
        monkeypatch.setattr(mcap_file, "MAX_CHUNK_BYTES", 40_000)
        with pytest.raises(RecordingError, match="unpacks to more than 0 MB"):
            read_recording(path, robot)

    @pytest.mark.parametrize("content", [b"", b"#ROSBAG V2.0\n", b"time,left_s0\n", bytes(100)])
    def test_what_is_no_mcap_file(self, robot: Baxter, path: Path, content: bytes) -> None:
        path.write_bytes(content)
        with pytest.raises(RecordingError, match="no MCAP file"):
            read_recording(path, robot)
