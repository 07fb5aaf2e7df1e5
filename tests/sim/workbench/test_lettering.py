"""Text as strokes: which letters there are, how high they are, and what the pen does between."""

from __future__ import annotations

import sys
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from baxter_kin.errors import MissingLibraryError
from sim import SimulationError
from sim.workbench import lettering
from sim.workbench.lettering import text_strokes

HERSHEY: Any = pytest.importorskip("HersheyFonts", reason="Hershey-Fonts is not installed")

ASCII = "".join(map(chr, range(32, 127)))


def way_between(lines: tuple[Any, ...]) -> float:
    return sum(float(np.linalg.norm(after[0] - before[-1])) for before, after in pairwise(lines))


@pytest.mark.parametrize("height_m", [0.01, 0.06])
def test_capitals_have_the_height_and_are_read_from_the_robot(height_m: float) -> None:
    lines = text_strokes("LE", height_m, centre=(0.5, 0.1))
    points = np.concatenate(lines)
    assert np.ptp(points[:, 0]) == pytest.approx(height_m)
    assert np.mean([points[:, 0].min(), points[:, 0].max()]) == pytest.approx(0.5)
    assert abs(np.mean([points[:, 1].min(), points[:, 1].max()]) - 0.1) < 0.1 * height_m
    np.testing.assert_allclose(lines[0][0], lines[0].max(axis=0))  # top left of the L
    assert lines[0][1, 0] == pytest.approx(0.5 - height_m / 2.0)  # to the bottom, near the robot
    assert lines[0][2, 1] < lines[0][1, 1]  # to the right


def test_all_printable_characters_of_ascii_can_be_written() -> None:
    for character in ASCII:
        lines = text_strokes(f"I{character}I")
        assert all(len(line) >= 2 and np.isfinite(line).all() for line in lines)
        assert len(lines) >= 2


def test_strokes_that_meet_are_one_and_the_pen_goes_little_in_between() -> None:
    assert len(text_strokes("L")) == len(text_strokes("O")) == 1
    assert len(text_strokes("E")) == 3
    font = HERSHEY.HersheyFonts(load_default_font="futural")
    of_font = tuple(np.array(line) * 0.06 / 21.0 for line in font.strokes_for_text("BAXTER"))
    lines = text_strokes("BAXTER", 0.06)
    assert len(lines) < len(of_font)
    assert way_between(lines) < 0.65 * way_between(of_font)


@pytest.mark.parametrize(
    ("arguments", "options"),
    [
        (("Zürich",), {}),
        (("two\nlines",), {}),
        (("",), {}),
        (("  ",), {}),
        ((5,), {}),
        (("A", 0.0), {}),
        (("A", "high"), {}),
        (("A",), {"centre": (0.5,)}),
    ],
)
def test_what_cannot_be_written_is_refused(arguments: Any, options: Any) -> None:
    with pytest.raises(SimulationError):
        text_strokes(*arguments, **options)


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "HersheyFonts", None)
    lettering._glyphs.cache_clear()  # it may have been loaded
    with pytest.raises(MissingLibraryError, match=r"pip install Hershey-Fonts$"):
        text_strokes("A")
