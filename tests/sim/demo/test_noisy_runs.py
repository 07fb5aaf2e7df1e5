"""Runs of the demo's first cycle with noisy eyes."""

from __future__ import annotations

from sim import Noise
from sim.demo.noisy_runs import NoisyRun, result_of


def test_a_run_depends_on_its_seed_alone() -> None:
    noise = Noise(0.0005)  # no miss; what it is off along the pads remains
    first, again, other = (result_of(NoisyRun(seed, noise, 1)) for seed in (3, 3, 5))
    assert first == again
    assert first.is_placed
    assert first.is_open_success
    assert other.is_placed
    assert first.off_m != other.off_m
