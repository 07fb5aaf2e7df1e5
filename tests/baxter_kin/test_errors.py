from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin import BaxterError
from baxter_kin.display import MAX_NAME, MAX_QUOTE, nearest_name
from baxter_kin.errors import FileError, UnknownNameError
from baxter_kin.validation import finite_array, finite_scalar


def test_messages_do_not_repeat_long_input() -> None:
    long = "x" * 100_000
    assert len(str(UnknownNameError("limb", long, ("left",)))) < MAX_NAME + 60
    assert len(str(FileError("read", long, "no"))) < MAX_QUOTE + 60
    for call in (
        lambda: finite_scalar(long, "a number", BaxterError),
        lambda: finite_array([long] * 100, (3,), "an array", BaxterError),
        lambda: finite_array([np.nan] * 100_000, (100_000,), "an array", BaxterError),
    ):
        with pytest.raises(BaxterError) as caught:
            call()
        assert len(str(caught.value)) < MAX_QUOTE + 60


@pytest.mark.parametrize(
    ("name", "meant"),
    [("Left", "left"), ("rigth", "right"), ("left_gripr", "left_gripper")],
)
def test_a_name_that_is_nearly_one_that_exists_is_asked_about(name: str, meant: str) -> None:
    error = UnknownNameError("frame", name, ["left", "right", "left_gripper", "left_hand"])
    assert str(error).endswith(f"left_hand; did you mean {meant}?")
    assert error.allowed == ("left", "right", "left_gripper", "left_hand")


@pytest.mark.parametrize("name", ["top", "", "left_s9", 7, ["left"], "left" * 10**7])
def test_no_other_name_is(name: Any) -> None:
    assert "did you mean" not in str(UnknownNameError("joint", name, ["left_s0", "left_s1"]))
    assert nearest_name(name, []) == ""
