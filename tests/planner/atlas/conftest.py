"""Tests of atlases need the extra `atlas`; their small maps are in `tests/conftest.py`."""

from __future__ import annotations

import pytest

pytest.importorskip("zarr", reason="maps need zarr, and it Python 3.11", exc_type=ImportError)
