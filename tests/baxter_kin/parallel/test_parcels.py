"""Tasks and answers as bytes."""

from __future__ import annotations

import pickle

import pytest

from baxter_kin.distribution import software
from baxter_kin.parallel import EngineError, parcels
from tests.baxter_kin.parallel import tasks


def test_an_answer_comes_back() -> None:
    assert parcels.opened(parcels.carried_out(parcels.packed(tasks.squared, 7))) == 49


def test_what_was_raised_says_where() -> None:
    with pytest.raises(OSError, match="no space for 3") as raised:
        parcels.opened(parcels.carried_out(parcels.packed(tasks.fails, 3)))
    assert 'raise OSError(28, f"no space for {number}")' in str(raised.value.__cause__)


def test_other_software_is_refused_before_anything_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    parcel = parcels.packed(tasks.always_dies, 3)
    here = software.software()
    monkeypatch.setattr(parcels, "software", lambda: {**here, "numpy": "1.0", "code": "0"})
    with pytest.raises(EngineError) as told:
        parcels.opened(parcels.carried_out(parcel))
    assert "has other software than the process that gave it work, and did none" in str(told.value)
    assert f"numpy 1.0 there and {here['numpy']} here" in str(told.value)
    assert "zarr" not in str(told.value)


def test_a_task_that_is_not_there_is_told() -> None:
    there = pickle.dumps((software.software(), b"cno_such_module\ntask\n."))
    with pytest.raises(
        EngineError, match=r"cannot read its task .*No module named 'no_such_module"
    ):
        parcels.opened(parcels.carried_out(there))


def test_bytes_of_something_else_are_told() -> None:
    with pytest.raises(EngineError, match="cannot be read here"):
        parcels.opened(b"nonsense")
