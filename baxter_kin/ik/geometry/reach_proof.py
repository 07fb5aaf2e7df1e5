"""A proof that a pose is out of reach: by how far, from which bound, and in words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from baxter_kin.validation import FloatArray


@dataclass(frozen=True, slots=True)
class ReachProof:
    """That a pose is out of reach, and why; `str()` of it is the clause in words.

    Attributes:
        excess_m: a lower bound, above zero, on how far the pose must be moved, keeping its
            orientation, before the arm reaches it. For a position: in any orientation.
        bound: what it follows from: "span", "fold", "shoulder", "wrist" or "limits".
        text: a clause with numbers, such as "12 mm beyond the 0.745 m that upper arm and forearm
            span from left_s1, with the wrist at (1.021, 0.305, 0.214) m".
    """

    excess_m: float
    bound: str
    text: str

    def __str__(self) -> str:
        return self.text

    def less(self, leeway_m: float) -> ReachProof | None:
        """What is left of it where the pose may give way by so much; None when nothing is."""
        if leeway_m == 0.0:
            return self
        if self.excess_m <= leeway_m:
            return None
        text = f"{self.text}, and no more than {_length_up(leeway_m)} can be made up"
        return ReachProof(self.excess_m - leeway_m, self.bound, text)

    @classmethod
    def of(
        cls,
        bound: str,
        excess_m: float,
        wrist: FloatArray,
        names: Mapping[str, str],
        most_m: float = 0,
    ) -> ReachProof:
        """The proof that a bound gives for a pose.

        Args:
            bound: its name.
            excess_m: by how far.
            wrist: where the pose puts it, seen from base, shape (3,), m.
            names: the arm's joint names by their short ones, such as "s1".
            most_m: the length that spans and folds speak of.
        """
        clause = _OF_POSES[bound].format(length=_length(excess_m), most_m=most_m, **names)
        return cls(excess_m, bound, f"{clause}, with the wrist at {_words(wrist)}")

    @classmethod
    def of_position(
        cls, bound: str, excess_m: float, tip: FloatArray, names: Mapping[str, str], most_m: float
    ) -> ReachProof:
        """The same for a position of the tip, seen from base, shape (3,), m."""
        clause = _OF_POSITIONS[bound].format(length=_length(excess_m), most_m=most_m, **names)
        return cls(excess_m, bound, f"{clause}, with the tip at {_words(tip)}")


_OF_POSES = {
    "span": "{length} beyond the {most_m:.3f} m that upper arm and forearm span from {s1}",
    "fold": "{length} inside the {most_m:.3f} m that the wrist keeps from {s1} with {e1} fully "
    "bent",
    "shoulder": "at least {length} from where the limits of {s0}, {s1} and {e1} let the wrist go",
    "wrist": "at least {length} from where {w1} can hold the tool in this orientation with {s0}, "
    "{s1} and {e1} inside their limits",
    "limits": "at least {length} from where the limits of all joints together let the tool be in "
    "this orientation",
}

_OF_POSITIONS = {
    "span": "{length} beyond the {most_m:.3f} m that the straight arm spans from {s1}",
    "shoulder": "{length} beyond the {most_m:.3f} m that forearm and hand span from where {s0} and "
    "{s1} let the elbow go",
}


def _words(p_base: FloatArray) -> str:
    return "({:.6g}, {:.6g}, {:.6g}) m".format(*(round(x, 3) + 0.0 for x in p_base.tolist()))


def _length_up(length_m: float) -> str:
    """The length, rounded up."""
    return f"{math.ceil(1e3 * length_m)} mm"


def _length(length_m: float) -> str:
    """The length, rounded down so that the words claim no more than the proof."""
    if length_m >= 10.0:
        return f"{length_m:.6g} m"
    digits = 0 if length_m >= 0.01 else 1 if length_m >= 1e-3 else 3
    scale = 10.0**digits
    return f"{math.floor(1e3 * length_m * scale) / scale:.{digits}f} mm"
