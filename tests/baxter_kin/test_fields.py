from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import baxter_kin.ik
import planner
import sim
from baxter_kin import BaxterError
from baxter_kin.fields import check_fields


@dataclass(frozen=True)
class Thing:
    number: float = 1.0
    count: int = 1
    is_so: bool = True
    name: str = "thing"
    other: Thing | None = None
    names: tuple[str, ...] = ()
    pair: tuple[str, int] = ("a", 1)
    shares: Mapping[str, float] = dataclasses.field(default_factory=dict)
    array: NDArray[np.float64] | None = None
    values: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        check_fields(self, BaxterError)


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"number": 2},
        {"number": np.float32(2)},
        {"number": float("inf")},
        {"count": np.int8(2)},
        {"is_so": np.bool_(False)},
        {"other": Thing()},
        {"names": ("a", "b")},
        {"shares": {"a": 1}},
        {"array": np.zeros(3)},
        {"values": [1.0, 2.0]},
    ],
    ids=str,
)
def test_values_of_the_stated_classes_are_taken(fields: dict[str, Any]) -> None:
    assert Thing(**fields)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"number": "1"}, "Thing.number must be float, got '1'"),
        ({"number": 10**400}, "Thing.number must be float, got an integer of 1329 bits"),
        ({"number": True}, "Thing.number must be float, got True"),
        ({"count": 1.0}, "Thing.count must be int, got 1.0"),
        ({"count": False}, "Thing.count must be int, got False"),
        ({"is_so": 1}, "Thing.is_so must be bool, got 1"),
        ({"name": b"a"}, "Thing.name must be str, got b'a'"),
        ({"name": "\ud800"}, r"Thing.name must be str, got '\\ud800'"),
        ({"other": 5}, "Thing.other must be Thing or None, got 5"),
        ({"names": ["a"]}, r"Thing.names must be tuple\[str, ...\], got \['a'\]"),
        ({"names": ("a", 1)}, r"Thing.names must be tuple\[str, ...\], got \('a', 1\)"),
        ({"pair": ("a",)}, r"Thing.pair must be tuple\[str, int\], got \('a',\)"),
        ({"shares": {"a": "b"}}, r"Thing.shares must be Mapping\[str, float\]"),
        ({"shares": {1: 1.0}}, r"Thing.shares must be Mapping\[str, float\]"),
        ({"shares": [1.0]}, r"Thing.shares must be Mapping\[str, float\]"),
        ({"array": [1.0]}, "Thing.array must be ndarray.* or None"),
    ],
    ids=str,
)
def test_values_of_other_classes_are_refused_by_name(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(BaxterError, match=message):
        Thing(**fields)


PUBLIC = {
    f"{package.__name__}.{name}": getattr(package, name)
    for package in (baxter_kin, baxter_kin.ik, planner, sim)
    for name in package.__all__
}
CHECKED = [
    name
    for name, thing in PUBLIC.items()
    if dataclasses.is_dataclass(thing) and any(field.init for field in dataclasses.fields(thing))
]


class Stranger:
    """Of a class that nothing asks for."""


@pytest.mark.parametrize("name", CHECKED)
def test_no_public_dataclass_takes_just_anything(name: str) -> None:
    kind = PUBLIC[name]
    for chosen in (field.name for field in dataclasses.fields(kind) if field.init):
        others = {f.name: None for f in dataclasses.fields(kind) if f.init}
        with pytest.raises(BaxterError):
            kind(**{**others, chosen: Stranger()})
