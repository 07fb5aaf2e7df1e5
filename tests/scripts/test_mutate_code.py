"""Faults put into code: each changes its function, and a changed function is left alone."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path
from typing import Any

import pytest

mutate_code: Any = importlib.import_module("mutate_code")

MODULE = '''"""A module."""

class Door:
    @property
    def is_open(self) -> bool:
        return self.angle_rad > 0.0

def bounded(x: float, low: float = -1.0) -> float:
    """At least `low`."""
    if x < low:
        raise ValueError(f"{x + 1} is below {low}")
    return min(x, 1.0) + 2 * x
'''


@pytest.fixture
def root(tmp_path: Path) -> Path:
    (tmp_path / "planner").mkdir()
    (tmp_path / "planner" / "doors.py").write_text(MODULE)
    return tmp_path


def faulty(root: Path, fault: Any) -> str:
    """The module with a fault in it."""
    place = mutate_code.locate(fault, root)
    assert place is not None
    text: bytes = mutate_code.with_fault(fault, place)
    return text.decode()


def test_each_fault_changes_what_a_function_does(root: Path) -> None:
    faults = mutate_code.choose(root, 100, 1)
    assert {fault.kind for fault in faults} == {
        "comparison",
        "constant",
        "dropped check",
        "name",
        "operator",
    }
    texts = {ast.unparse(ast.parse(faulty(root, fault))) for fault in faults}
    assert len(texts) == len(faults) == 11
    assert ast.unparse(ast.parse(MODULE)) not in texts


def test_messages_and_annotations_stay(root: Path) -> None:
    for fault in mutate_code.choose(root, 100, 1):
        if fault.kind != "dropped check":
            assert 'f"{x + 1} is below {low}"' in faulty(root, fault)


def test_a_fault_is_found_again_where_its_function_has_moved(root: Path) -> None:
    fault = mutate_code.choose(root, 1, 1)[0]
    (root / "planner" / "doors.py").rename(root / "planner" / "gates.py")
    before = (root / "planner" / "gates.py").read_text()
    (root / "planner" / "gates.py").write_text("X = 1\n" + before)
    assert faulty(root, fault) != "X = 1\n" + before


def test_a_fault_of_a_changed_function_is_left_out(root: Path) -> None:
    faults = mutate_code.choose(root, 100, 1)
    (root / "planner" / "doors.py").write_text(MODULE.replace("2 * x", "3 * x"))
    left = [fault for fault in faults if mutate_code.locate(fault, root) is not None]
    assert {fault.function for fault in left} == {"Door.is_open"}
