from __future__ import annotations

import sys
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest

from baxter_kin import Arm
from baxter_kin.benchmark.entrants import (
    ENTRANTS,
    PEERS,
    SAME_CHAIN,
    Absence,
    Contestant,
    Entrant,
    describe,
    enter,
    short,
)
from baxter_kin.benchmark.solvers import ours


def test_absent_solver_says_how_to_install_it(left: Arm) -> None:
    entrant = Entrant(
        "ghost", "solvers.ghost", needs=("no_such_solver",), install="run: pip install it"
    )
    absence = enter(entrant, left)
    assert absence == Absence("ghost", "no_such_solver is not installed; run: pip install it")


def test_solver_that_cannot_start_is_absent_with_the_reason(left: Arm) -> None:
    absence = enter(Entrant("odd", "solvers.ours", {"no_such_option": 1}), left)
    assert isinstance(absence, Absence)
    assert absence.reason.startswith("odd could not start: TypeError")


def test_every_peer_says_what_it_needs_and_how_to_install_it() -> None:
    assert all(peer.needs and peer.install for peer in PEERS)


def test_no_two_entrants_have_one_key() -> None:
    keys = [entrant.key for entrant in ENTRANTS]
    assert len(set(keys)) == len(keys)


@pytest.mark.parametrize("off", [2.0 * SAME_CHAIN, np.nan])
def test_a_solver_of_another_chain_does_not_take_part(
    left: Arm, monkeypatch: pytest.MonkeyPatch, off: float
) -> None:
    def other(arm: Arm) -> Contestant:
        return replace(ours.contestant(arm), forward=lambda q: arm.T_base_tip(q).homogeneous + off)

    module = ModuleType("other")
    module.contestant = other  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "baxter_kin.benchmark.solvers.other", module)
    absence = enter(Entrant("other", "solvers.other"), left)
    assert isinstance(absence, Absence)
    assert "forward kinematics differs from Pinocchio's" in absence.reason


@pytest.mark.parametrize(
    ("number", "text"), [(1e-5, "1e-5"), (4e-13, "4e-13"), (5e-7, "5e-7"), (1e-12, "1e-12")]
)
def test_tolerances_are_written_as_people_do(number: float, text: str) -> None:
    assert short(number) == text


def test_an_exception_is_told_by_its_class_and_first_line() -> None:
    assert describe(ZeroDivisionError("no luck\nat all")) == "ZeroDivisionError: no luck"
    assert describe(KeyError()) == "KeyError"
