"""Sensors as mounted: mass, resonance, filter, range and converter beside their formulas."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import delam_fem as df
from delam_fem import CaseError
from delam_fem.api import Case, assemble, lowest

M, F, FREQUENCY = 0.25, 0.4, 5.0
POINT = {"name": "one", "mass": M, "stiffness": 0.0, "damping_ratio": 0.0}
STEPS = 1000


def signal_of(sensor: dict[str, Any], **sections: Any) -> Any:
    """Return time and signal of an accelerometer on a free point under a harmonic force."""
    case = df.Case(**{
        "name": "point", "lamina": [POINT],
        "excitation": {"kind": "force", "lamina": "one", "amplitude": F, "frequency": FREQUENCY},
        "sensor": [{"name": "a", "lamina": "one", "quantity": "acceleration"} | sensor],
        "contact": {"law": "none"}, "time": {"steps_per_period": STEPS, "periods": 20},
        "output": {"window_periods": 20},
    } | sections)  # fmt: skip
    history = df.run(case, "compiled").history
    return history["time"].to_numpy(), history["sensor_a"].to_numpy()


def complex_amplitude(t: Any, value: Any) -> complex:
    """Return the complex amplitude of the last ten periods, relative to sin(ωt)."""
    last = t > t[-1] - 10.0 / FREQUENCY
    w = 2.0 * np.pi * FREQUENCY
    return complex(2.0 * np.mean(value[last] * 1j * np.exp(-1j * w * t[last])))


@pytest.mark.parametrize(
    ("sensor", "response"),
    [
        ({"corner": 8.0, "order": 1}, lambda f: 1.0 / (1.0 + 1j * f / 8.0)),
        ({"corner": 8.0},
         lambda f: 1.0 / (1.0 + 1j * np.sqrt(2.0) * f / 8.0 - (f / 8.0) ** 2)),
        ({"resonance": 20.0, "resonance_damping": 0.3},
         lambda f: 1.0 / (1.0 + 0.6j * f / 20.0 - (f / 20.0) ** 2)),
        ({"resonance": 20.0, "resonance_damping": 0.3, "corner": 8.0, "order": 1},
         lambda f: 1.0 / (1.0 + 0.6j * f / 20.0 - (f / 20.0) ** 2) / (1.0 + 1j * f / 8.0)),
    ],
)  # fmt: skip
def test_filters_have_the_response_of_their_formulas(sensor: Any, response: Any) -> None:
    """Amplitude and phase."""
    size = complex_amplitude(*signal_of(sensor)) / complex_amplitude(*signal_of({}))
    assert size == pytest.approx(response(FREQUENCY), abs=1e-3)


def test_a_range_cuts_off_and_a_converter_rounds() -> None:
    t, plain = signal_of({})
    top = 0.6 * F / M
    _, cut = signal_of({"range": top})
    np.testing.assert_array_equal(cut, np.clip(plain, -top, top))
    _, coarse = signal_of({"range": 2.0, "bits": 6})
    least = 2.0 * 2.0 / 2**6
    assert set(np.round(coarse / least, 9)) <= set(range(-32, 32))
    assert np.abs(coarse - plain).max() <= 0.5 * least * (1.0 + 1e-9)
    assert coarse.std() == pytest.approx(plain.std(), rel=1e-2)
    assert t.size == coarse.size


def test_a_range_carries_the_unit_of_the_sensor() -> None:
    _, one = signal_of({"range": "0.1 g_0"})
    assert np.abs(one).max() == pytest.approx(0.980665)


BEAM = {
    "name": "one", "length": 0.5, "width": 0.02, "thickness": 0.002, "density": 2700.0,
    "young_modulus": 7e10, "damping_ratio": 0.01,
}  # fmt: skip


def beam_of(**sections: Any) -> Case:
    return Case(**{
        "name": "beam", "lamina": [BEAM], "mesh": {"elements": 10}, "support": {"end": "free"},
        "excitation": {"kind": "harmonic", "amplitude": 1e-4, "frequency": 5.0},
        "contact": {"law": "none"}, "time": {"steps_per_period": 200, "periods": 1},
        "output": {"window_periods": 1},
    } | sections)  # fmt: skip


@pytest.mark.parametrize("kind", ["beam", "plane-stress"])
def test_the_mass_of_a_sensor_is_a_point_mass(kind: str) -> None:
    """Frequencies and damping, of beams and solids, of laminae that are apart and of a stack."""
    place = {"lamina": "one", "position": 0.43}
    sensor = {"name": "a", "quantity": "acceleration", "mass": "5 g"} | place
    two = {"lamina": [BEAM, BEAM | {"name": "two"}], "gap": {"tip": 1e-3}, "support": None}
    for sections in ({}, two):
        base = {key: value for key, value in sections.items() if value is not None}
        cases = (
            beam_of(**base, sensor=[sensor], model={"kind": kind}),
            beam_of(**base, point_mass=[place | {"mass": 0.005}], model={"kind": kind}),
        )
        one, other = (assemble(case).operators for case in cases)
        for name in ("mass", "damping", "stiffness"):
            a, b = getattr(one, name), getattr(other, name)
            assert abs(a - b).max() <= 1e-12 * abs(b).max()


def test_a_heavy_sensor_lowers_the_frequency_as_rayleigh_says() -> None:
    """Δω/ω = -m φ(x)² / 2 for a small mass, with φᵀ M φ = 1."""
    o = assemble(beam_of(), needs_dolfinx=False).operators
    f, shapes = lowest(o.stiffness, o.mass, 1)
    tip = shapes[-2, 0] ** 2 / float(shapes[:, 0] @ (o.mass @ shapes[:, 0]))
    mass = 1e-5
    sensor = {"name": "a", "quantity": "velocity", "lamina": "one", "position": 0.5, "mass": mass}
    heavy = assemble(beam_of(sensor=[sensor]), needs_dolfinx=False).operators
    change = lowest(heavy.stiffness, heavy.mass, 1)[0][0] / f[0] - 1.0
    assert change == pytest.approx(-0.5 * mass * tip, rel=2e-3)


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"order": 2}, "order: expected only beside corner"),
        ({"bits": 12}, "bits: expected only beside range"),
        ({"resonance_damping": 0.1}, "resonance_damping: expected only beside resonance"),
        ({"corner": 400.0}, r"corner: expected at most 0\.2 of the steps per second"),
        ({"range": 1.0, "bits": 1}, "bits: expected a whole number from 2"),
    ],
)
def test_what_does_not_fit_is_told(keys: dict[str, Any], expected: str) -> None:
    sensor = {"name": "a", "quantity": "velocity", "lamina": "one", "position": 0.5}
    with pytest.raises(CaseError, match=expected):
        beam_of(sensor=[sensor | keys])
    force = {"name": "f", "quantity": "contact force", "between": ["one", "two"], "mass": 0.1}
    with pytest.raises(CaseError, match="mass: expected none with quantity"):
        beam_of(sensor=[force])


@pytest.mark.parametrize(
    "quantity, unit, reach",
    [("acceleration", " m/s2", 0.5), ("acceleration", "", 1.5), ("strain", "", 0.5)],
)
def test_a_signal_that_reaches_the_end_of_its_range_is_a_warning(
    quantity: str, unit: str, reach: float
) -> None:
    """The range is a multiple of the largest signal of the same run without one."""
    keys = {"time.periods": 2, "time.steps_per_period": 100, "contact.law": "none"}
    rig = df.preset("paper", keys)
    sensor = {"name": "a", "quantity": quantity, "lamina": "thin", "position": 0.6}
    data = rig.model_dump(exclude_unset=True, exclude_none=True)
    free = df.run(Case(**(data | {"sensor": [sensor]})), "compiled")
    largest = float(np.abs(free.history["sensor_a"]).max())
    result = df.run(Case(**(data | {"sensor": [sensor | {"range": reach * largest}]})), "compiled")
    told = [text for text in result.summary["warnings"] if "ranges" in text]
    assert bool(told) is (reach < 1.0)
    assert all(f"(a: {reach * largest:g}{unit} in " in text for text in told)
    assert float(np.abs(result.history["sensor_a"]).max()) <= reach * largest
