"""Laminae of unequal lengths, which begin at one clamp."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import delam_fem as df
from delam_fem.api import Case, CaseError, assemble, beams, elastic, of_channels, reduced_case
from delam_fem.model.beams import forms
from delam_fem.results.diagnostics import gap_field

SHORT, LONG = 0.22, 0.3
LAMINA = {"width": 0.02, "thickness": 0.002, "density": 2700.0, "young_modulus": 7e10,
          "damping_ratio": 0.01}  # fmt: skip
STEPS = {"steps_per_period": 200, "periods": 3}


def case(lengths: tuple[float, float] = (LONG, SHORT), **sections: Any) -> Case:
    data: dict[str, Any] = {
        "name": "unequal",
        "lamina": [{"name": name, "length": length, **LAMINA}
                   for name, length in zip(("lower", "upper"), lengths, strict=True)],
        "gap": {"tip": 2e-3, "exponent": 2.0},
        "mesh": {"elements": 40},
        "contact": {"law": "newton", "restitution": 0.3},
        "excitation": {"kind": "harmonic", "frequency": 14.0, "amplitude": 1e-3},
        "time": STEPS, "output": {"window_periods": 2},
    }  # fmt: skip
    return Case(**(data | sections))


def test_frequencies_and_responses_are_those_of_each_cantilever() -> None:
    """Three frequencies of each to 1e-5 with 40 elements, by exact formulas."""
    rig = case()
    structure = assemble(rig, needs_dolfinx=False)
    frequencies, _ = elastic(structure.operators.stiffness, structure.operators.mass, 6, 0)
    exact = [w / (2.0 * np.pi) for lamina in rig.lamina for w in lamina.angular_frequencies(3)]
    np.testing.assert_allclose(frequencies, np.sort(exact), rtol=1e-5)
    f = np.linspace(1.0, 60.0, 20)
    tips = of_channels(structure, rig, 2j * np.pi * f)
    for number, lamina in enumerate(rig.lamina):
        H = beams.transmissibility(
            2.0 * np.pi * f, length=lamina.length, flexural_rigidity=lamina.flexural_rigidity,
            mass_per_length=lamina.mass_per_length, rayleigh=rig.rayleigh(number),
        )  # fmt: skip
        np.testing.assert_allclose(tips[f"tip_{lamina.name}"], H, rtol=1e-4)


@pytest.mark.parametrize("lengths", [(LONG, SHORT), (SHORT, LONG)])
@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_weak_forms_and_closed_forms_agree(lengths: tuple[float, float], mass: str) -> None:
    rig = case(lengths, time=STEPS | {"mass": mass}, mesh={"elements": 12})
    one, other = assemble(rig, needs_dolfinx=False).operators, forms.assemble(rig).operators
    for name in ("mass", "damping", "stiffness", "gap_matrix"):
        first, second = getattr(one, name), getattr(other, name)
        assert abs(first - second).max() <= 1e-11 * abs(first).max()
    np.testing.assert_array_equal(one.gap0, other.gap0)
    # the gap ends where the shorter one does, with the value at its end
    assert one.gap0[-1] == pytest.approx(2e-3)
    assert (
        one.n_pairs == np.sum(assemble(rig, needs_dolfinx=False).layout.x <= SHORT * (1 + 1e-9)) - 1
    )


def test_engines_agree_and_a_file_has_the_values_of_the_end_beyond_it(tmp_path: Path) -> None:
    rig = case(mesh={"elements": 8})
    petsc, compiled = (df.run(rig, engine=engine) for engine in ("petsc", "compiled"))
    assert petsc.summary["impacts_per_period"] > 0.0
    for name in ("tip_displacement", "displacement"):
        first, second = (run.history[name].to_numpy() for run in (petsc, compiled))
        assert np.abs(first - second).max() < 1e-7 * np.abs(first).max()
    assert abs(petsc.summary["energy_residual"]) < 1e-9
    petsc.save(tmp_path / "run")
    history = df.load_result(tmp_path / "run").history
    is_beyond = history["x"].to_numpy() > SHORT * (1 + 1e-9)
    upper = history["displacement"].sel(lamina="upper").to_numpy()
    assert is_beyond.sum() == 2
    np.testing.assert_array_equal(upper[:, is_beyond], upper[:, [-3]].repeat(2, axis=1))
    gaps = gap_field(history)[0]
    assert np.isnan(gaps[:, is_beyond]).all() and np.isfinite(gaps[:, ~is_beyond]).all()
    assert np.all(history["moment"].sel(lamina="upper").to_numpy()[:, -2:] == 0.0)
    assert history["end"].to_numpy().tolist() == [LONG, SHORT]


def test_weight_bends_each_cantilever_by_its_own_length() -> None:
    """w = q L⁴/(8 EI) at each tip, beside the unloaded shape."""
    rig = case(gravity={}, contact={"law": "none"}, mesh={"elements": 20})
    at_rest = df.rest(rig)
    assert isinstance(at_rest, xr.Dataset)
    for lamina in rig.lamina:
        q = lamina.mass_per_length * 9.80665
        exact = -q * lamina.length**4 / (8.0 * lamina.flexural_rigidity)
        tip = float(at_rest["displacement"].sel(lamina=lamina.name)[-1])
        assert tip == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize(
    "sections, key",
    [
        ({"model": {"kind": "solid"}}, "beam"),
        ({"gap": None, "delamination": [{"between": ["lower", "upper"], "start": 0.1, "end": 0.2}]},
         "one length"),
        ({"support": {"start": "clamped", "end": "pinned"}}, "x = 0 alone"),
        ({"time": STEPS | {"mass": "massless"}, "contact": {"law": "newton"}}, "massless"),
        ({"sensor": [{"name": "a", "quantity": "velocity", "lamina": "upper", "position": 0.29}]},
         "at most the length 0.22"),
    ],
)  # fmt: skip
def test_what_unequal_lengths_do_not_go_with_is_refused(sections: Any, key: str) -> None:
    with pytest.raises(CaseError, match=key):
        case(**sections)


def test_unequal_lengths_are_not_reduced() -> None:
    with pytest.raises(CaseError, match="laminae of one length"):
        reduced_case(case())
