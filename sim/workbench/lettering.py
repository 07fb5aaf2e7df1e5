"""Text as strokes of a pen, in a font of single lines (the package `Hershey-Fonts` enters here)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from baxter_kin.display import quoted
from baxter_kin.distribution.extras import run_to_install_extra
from baxter_kin.errors import MissingLibraryError
from baxter_kin.validation import FloatArray, expect, finite_array, positive_scalar
from sim.errors import SimulationError

FONT = "futural"
"""Hershey's sans serif of 1967 whose strokes are single lines."""

LETTER_M, CENTRE = 0.06, (0.70, 0.25)
"""Default height of capital letters; and x and y of the middle of a text, in front of the left
arm."""


class Glyph(NamedTuple):
    """A character of the font, in units of the height of capital letters.

    Attributes:
        strokes: shape (n, 2) each; x to the right, y up from the line that the text stands on.
        width: distance to the next character.
    """

    strokes: tuple[FloatArray, ...]
    width: float


def text_strokes(
    text: str, height_m: float = LETTER_M, *, centre: Sequence[float] = CENTRE
) -> tuple[FloatArray, ...]:
    """The strokes that write a text, readable from where the robot stands.

    Strokes that meet are one. Those of a letter are in an order in which the pen has little way to
    go between them.

    Args:
        text: one line of printable ASCII.
        height_m: height of capital letters.
        centre: x and y of the middle of the text in base, m.

    Returns:
        Points of each stroke, x and y in base, shape (n, 2), m.

    Raises:
        SimulationError: when the font lacks a character, there is nothing to write, or another
            argument is invalid.
        MissingLibraryError: when Hershey-Fonts is not installed.
    """
    height = positive_scalar(height_m, "height_m", SimulationError)
    middle = finite_array(centre, (2,), "centre", SimulationError)
    glyphs, lines, right = _glyphs(), list[FloatArray](), 0.0
    for character in expect(text, str, "text", SimulationError):
        if character not in glyphs:
            raise SimulationError(
                f"the font has no {quoted(character)}; it has the printable characters of ASCII, "
                f"{min(glyphs)!r} to {max(glyphs)!r}"
            )
        glyph = glyphs[character]
        for line in _in_short_order(glyph.strokes):
            placed = line + np.array([right, 0.0])
            if lines and np.array_equal(lines[-1][-1], placed[0]):
                lines[-1] = np.vstack([lines[-1], placed[1:]])
            else:
                lines.append(placed)
        right += glyph.width
    if not lines:
        raise SimulationError(f"there is nothing to write in {quoted(text)}")
    seen = [height * (line - np.array([right / 2.0, 0.5])) for line in lines]
    return tuple(middle + np.column_stack([each[:, 1], -each[:, 0]]) for each in seen)


def _in_short_order(glyph: Sequence[FloatArray]) -> list[FloatArray]:
    """The strokes of a glyph, each after the one that ends nearest to one of its ends."""
    found, left = list(glyph[:1]), list(glyph[1:])
    while left:
        ends = np.array([[line[0], line[-1]] for line in left])
        distances = np.linalg.norm(ends - found[-1][-1], axis=2)
        number, is_last = divmod(int(distances.argmin()), 2)
        line = left.pop(number)
        found.append(line[::-1] if is_last else line)
    return found


@cache
def _glyphs() -> Mapping[str, Glyph]:
    """The printable characters of ASCII."""
    try:
        from HersheyFonts import HersheyFonts  # noqa: PLC0415 - an extra
    except ImportError as cause:
        raise MissingLibraryError(
            f"lettering needs the package Hershey-Fonts; {run_to_install_extra('draw')}"
        ) from cause
    font = HersheyFonts()
    font.load_default_font(FONT)
    base, cap = (font.render_options[name] for name in ("base_line", "cap_line"))
    unit = 1.0 / (base - cap)
    return {
        character: Glyph(
            tuple(
                unit * np.array([(x - glyph.left_offset, base - y) for x, y in stroke])
                for stroke in glyph.strokes
            ),
            unit * glyph.char_width,
        )
        for character, glyph in font.all_glyphs.items()
        if character.isascii() and character.isprintable()
    }
