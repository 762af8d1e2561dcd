"""What holds on every release: the first impacts, and the script that tests them all."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT / "scripts" / "test_versions.sh"
RELEASES = sorted(
    path.stem.removeprefix("constraints-") for path in ROOT.glob("scripts/constraints-*.txt")
)
SAME = 1e-9  # m: versions differ by round-off, which 20 impacts raise to no more than 1e-12 m
SAME_RELATIVE = 1e-6  # of velocities and impulses: SAME of the smallest motion between impacts


@cache
def first_impacts() -> ModuleType:
    """Return the script of the same name as a module."""
    import importlib.util

    path = ROOT / "scripts" / "first_impacts.py"
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@cache
def kept() -> dict[str, np.ndarray]:
    with np.load(first_impacts().KEPT) as file:
        return dict(file)


def distance(frequency: float, computed: dict[str, np.ndarray]) -> float:
    """Return the largest difference of displacements from those kept [m]."""
    return float(np.abs(computed["displacement"] - kept()[f"{frequency:.2f} displacement"]).max())


@pytest.mark.parametrize("frequency", [1.25, 1.60, 3.25, 3.65])
def test_first_impacts_are_those_of_every_version(frequency: float) -> None:
    computed = first_impacts().first_impacts(frequency)
    for name in ("step", "node", "state_step"):
        np.testing.assert_array_equal(computed[name], kept()[f"{frequency:.2f} {name}"])
    assert len(computed["step"]) == 20
    assert distance(frequency, computed) < SAME
    for name in ("velocity_before", "impulse"):
        scale = np.abs(computed[name]).max()
        expected = kept()[f"{frequency:.2f} {name}"]
        np.testing.assert_allclose(computed[name], expected, rtol=0.0, atol=SAME_RELATIVE * scale)


def test_another_model_is_told_apart() -> None:
    # The first impacts, near the clamp, are weak; one percent of the restitution still shows.
    changed = first_impacts().first_impacts(3.25, contact__restitution=0.101)
    assert changed["displacement"].shape == kept()["3.25 displacement"].shape
    assert distance(3.25, changed) > 10 * SAME


def test_kept_impacts_are_small_and_of_all_reference_motions() -> None:
    module = first_impacts()
    assert module.KEPT.stat().st_size < 100_000
    assert {name.split()[0] for name in kept()} == {f"{f:.2f}" for f in module.FREQUENCIES}
