"""Recording: what happened as data."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin import BaxterError
from baxter_kin.fields import field_names
from planner import Body
from sim import Event, EventKind, Recording
from sim.errors import RecordingError
from tests.conftest import at


def fields(recording: Recording) -> dict[str, Any]:
    return {name: getattr(recording, name) for name in field_names(recording)}


class TestRecording:
    """An object that exists is valid."""

    def test_its_arrays_cannot_be_changed(self, picked: Recording) -> None:
        arrays = [picked.times_s, picked.q, picked.gripper_percent]
        for array in [*arrays, *picked.body_poses.values()]:
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1.0

    def test_its_mappings_cannot_be_changed(self, picked: Recording) -> None:
        for mapping in (picked.bodies, picked.body_poses):
            with pytest.raises(TypeError):
                mapping["new"] = None  # type: ignore[index]  # that it is refused is tested

    @pytest.mark.parametrize("name", ["times_s", "q", "gripper_percent"])
    @pytest.mark.parametrize(
        "bad", [None, "x", [[1.0], [1.0, 2.0]], np.zeros((2, 3, 4)), {}, 1j, 10**400], ids=str
    )
    def test_malformed_arrays_are_refused(self, picked: Recording, name: str, bad: Any) -> None:
        with pytest.raises(RecordingError):
            Recording(**{**fields(picked), name: bad})

    @pytest.mark.parametrize("name", ["times_s", "q", "gripper_percent"])
    def test_numbers_that_are_not_finite_are_refused_naming_the_array(
        self, picked: Recording, name: str
    ) -> None:
        array = np.array(getattr(picked, name))
        array.flat[0] = np.nan
        with pytest.raises(RecordingError, match=f"^{name} must be finite"):
            Recording(**{**fields(picked), name: array})

    def test_no_snapshot_is_refused(self, picked: Recording) -> None:
        with pytest.raises(RecordingError, match="empty"):
            Recording(**{**fields(picked), "times_s": []})

    def test_times_that_do_not_increase_are_refused(self, picked: Recording) -> None:
        times = np.array(picked.times_s)
        times[3] = times[2]
        with pytest.raises(RecordingError, match="times_s must increase"):
            Recording(**{**fields(picked), "times_s": times})

    @pytest.mark.parametrize("track", [np.zeros((3, 7)), np.zeros(7), "track", None, [[1], [1, 2]]])
    def test_poses_of_the_wrong_shape_are_refused_naming_the_body(
        self, picked: Recording, track: Any
    ) -> None:
        with pytest.raises(RecordingError, match="poses of 'block'"):
            Recording(**{**fields(picked), "body_poses": {"block": track}})

    @pytest.mark.parametrize(
        "name", ["joint_names", "bodies", "body_poses", "captions", "events", "moves"]
    )
    @pytest.mark.parametrize("bad", [None, 5, "names", [None]])
    def test_malformed_parts_are_refused(self, picked: Recording, name: str, bad: Any) -> None:
        with pytest.raises(BaxterError):
            Recording(**{**fields(picked), name: bad})

    def test_an_event_is_a_value(self) -> None:
        event = Event(1.0, EventKind.GRASPED, "block grasped")
        assert event == Event(1.0, EventKind.GRASPED, "block grasped")
        with pytest.raises(AttributeError):
            event.text = "other"  # type: ignore[misc]  # that it is refused is what is tested

    def test_the_callers_arrays_stay_the_callers(self, picked: Recording) -> None:
        times = np.array(picked.times_s)
        copy = Recording(**{**fields(picked), "times_s": times})
        times[:] = 0.0
        assert copy.times_s.tolist() == picked.times_s.tolist()

    def test_bodies_may_be_anywhere(self, picked: Recording, block: Body) -> None:
        moved = block.at(at(9.0, 9.0, 9.0))
        assert Recording(**{**fields(picked), "bodies": {"block": moved}}).bodies


@pytest.mark.parametrize("with_knots", [np.zeros(3), "no", 1, None], ids=str)
def test_with_knots_is_a_truth_value(recording: Recording, with_knots: Any) -> None:
    with pytest.raises(RecordingError, match="with_knots must be of class bool"):
        recording.motion("left", with_knots=with_knots)
