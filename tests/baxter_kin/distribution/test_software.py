"""What results depend on."""

from __future__ import annotations

import numpy as np

from baxter_kin.distribution.software import difference, versions
from baxter_kin.distribution.version import version


def test_versions_are_those_that_run() -> None:
    assert versions()["baxter-kin"] == version()
    assert versions()["numpy"] == np.__version__


def test_a_difference_names_what_differs_and_nothing_else() -> None:
    here = versions()
    assert difference(here, here) == ""
    assert difference({**here, "numpy": "1.0"}, here) == (
        f"numpy 1.0 there and {np.__version__} here"
    )
    assert difference({}, {"zarr": "3.1.6"}) == "zarr none there and 3.1.6 here"
    assert difference({"pin": "4"}, {}) == "pin 4 there and none here"
