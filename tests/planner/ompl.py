"""The mark of tests that search for ways, for which OMPL must be there."""

from __future__ import annotations

import sys
from importlib.util import find_spec

import pytest

from planner.motion.rrt import NEWEST_PYTHON

needs_ompl = pytest.mark.skipif(
    sys.version_info[:2] > NEWEST_PYTHON and find_spec("ompl") is None,
    reason="OMPL, which searches need, has no wheel for this Python",
)
"""Skips only there: where OMPL should be and is not, every search fails."""
