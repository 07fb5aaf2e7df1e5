"""The checker's only error."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


class NotCertifiedError(Exception):
    """The plan is not certified; the message gives the reason in one sentence."""


def require(condition: ArrayLike, reason: str) -> None:
    """Refuse the plan unless all elements of a condition hold.

    Conditions are comparisons, which are false for NaN, so NaN is refused as well.
    """
    if not np.all(condition):
        raise NotCertifiedError(reason)
