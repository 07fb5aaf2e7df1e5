"""Responses in files: as they were written, or refused in a sentence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from planner import Response
from planner.errors import ResponseError
from planner.response_file import load_response, save_response

LAGS = np.linspace(0.1, 0.4, 14).reshape(7, 2)


def test_a_response_comes_back_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "left.json"
    errors = np.linspace(0.001, 0.007, 7)
    save_response(Response(LAGS, errors), "left", path)
    read = load_response(path, "left")
    assert np.array_equal(read.lag_s, LAGS)
    assert np.array_equal(read.settled_error_rad, errors)
    with pytest.raises(ResponseError, match="of the left arm, not of the right"):
        load_response(path, "right")


@pytest.mark.parametrize(
    "content",
    ["", "[]", "{}", '{"format": "baxter-kin plan"}', '{"format": "baxter-kin response"}'],
)
def test_what_is_no_response_is_refused(tmp_path: Path, content: str) -> None:
    path = tmp_path / "left.json"
    path.write_text(content)
    with pytest.raises(ResponseError):
        load_response(path, "left")


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ResponseError, match=r"nowhere\.json"):
        load_response(tmp_path / "nowhere.json", "left")
