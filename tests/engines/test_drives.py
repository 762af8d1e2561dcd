"""Drives with many lines in both engines, in all kinds of models; their steady responses."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from covertable import make
from support import slow_beyond

import delam_fem as df
from delam_fem import api
from delam_fem.api import Case, CaseError, FloatArray, preset

TIME = {"time": {"steps_per_period": 16}, "output": {}}
DRIVES: dict[str, dict[str, Any]] = {
    "random": {"kind": "random", "rms": 2.0, "duration": 6.0},
    "burst": {"kind": "burst", "rms": 0.02, "in": "velocity", "duration": 6.0, "share": 0.5},
    "multisine": {"kind": "multisine", "rms": 2.0, "spacing": 0.5, "lines": "odd-random"},
    "realisations": {"kind": "multisine", "amplitude": 0.5, "spacing": 1.0, "realisations": 2,
                     "periods": 2},
    "none": {"kind": "none"},
}  # fmt: skip
"""Drives of the base in units of the first frequency f of a model, which the cells multiply."""
STACK = {"mesh.elements": 12, "delamination.1.opening": 0.0}
MODELS: dict[str, tuple[str, float, str, dict[str, Any]]] = {
    "beams": ("paper", 2.0, "thin", {"mesh.elements": 5}),
    "layered": ("embedded", 30.0, "upper", STACK),
    "plane": ("embedded", 30.0, "upper", {"model.kind": "plane-stress"} | STACK),
    "point": ("default", 5.0, "beam", {
        "lamina": [{"name": "beam", "mass": 0.1, "stiffness": 100.0, "damping_ratio": 0.01}],
        "gap": None, "mesh.elements": 1,
        "stop": [{"lamina": "beam", "side": "above", "gap": 1e-3}],
    }),
    "bar": ("default", 3000.0, "bar", {
        "lamina": [{"name": "bar", "length": 0.3, "width": 0.02, "thickness": 0.002,
                    "density": 2700.0, "young_modulus": 7e10, "damping_ratio": 0.01,
                    "motion": "axial"}],
        "gap": None, "mesh.elements": 4,
    }),
}  # fmt: skip
"""Presets, a frequency [Hz], the lamina on which forces act, and further keys."""
LAWS = {"linear": "none", "newton": "newton@newmark", "penalty": "penalty@newmark"}
ENGINES = 1e-6
"""Difference of two engines before the first impact, relative to the motion; solids in bending
have most round-off (5e-8)."""


def case_of(drive: str, model: str, acts_on: str, law: str) -> Case:
    """Return a short case with a drive."""
    of, f, lamina, keys = MODELS[model]
    excitation = dict(DRIVES[drive])
    time: dict[str, Any] = {"steps_per_period": 16}
    if drive == "none":
        time = {"step": 0.02 / f, "duration": 3.0 / f}
        keys = keys | {"initial": [{"shape": "mode", "mode": 1, "velocity": 0.02}]}
    else:
        excitation |= {"low": 0.5 * f, "high": 4.0 * f}
        for key in ("spacing", "duration"):
            if key in excitation:
                excitation[key] *= f if key == "spacing" else 1.0 / f
        if drive == "multisine":
            time["periods"] = 2
        if acts_on == "force":
            excitation.pop("in", None)
            place = {"lamina": lamina} if model == "point" else {"lamina": lamina, "position": 0.2}
            excitation |= {"acts_on": "force", **place}
    if model == "bar" and "in" not in excitation and drive != "none":
        for key in {"rms", "amplitude"} & set(excitation):
            excitation[key] *= 1e3
    name, _, scheme = LAWS[law].partition("@")
    contact = {"law": name}
    if model == "layered" and law == "newton":
        contact["impulse"] = "consistent"
    return preset(of, keys | {"excitation": excitation, "output": {},
                              "contact": contact | {"restitution": 0.5} if name == "newton"
                              else contact,
                              "time": time | ({"scheme": scheme} if scheme else {})})  # fmt: skip


CELLS = [
    dict(zip(("drive", "model", "acts_on", "law"), map(str, cell), strict=True))
    for cell in make([list(DRIVES), list(MODELS), ["base", "force"], list(LAWS)], length=2)
    if (cell[0], cell[2]) != ("none", "force")
]


@pytest.mark.parametrize("cell", slow_beyond(CELLS))
def test_both_engines_agree(cell: dict[str, str]) -> None:
    case = case_of(**cell)
    one, other = (df.run(case, engine) for engine in ("compiled", "petsc"))
    q, p = (r.history["tip_displacement"].to_numpy() for r in (one, other))
    times = one.history["time"].to_numpy()
    hits = one.history["event_time"].to_numpy() if "event_time" in one.history else np.zeros(0)
    before = times < hits.min(initial=np.inf)
    scale = np.abs(q).max()
    assert scale > 0.0
    assert before.sum() > 2
    assert np.abs(q - p)[:, before].max() < ENGINES * scale
    assert one.summary["energy_residual"] < 1e-9
    is_force = cell["acts_on"] == "force"
    course = one.history["force" if is_force else "base_displacement"].to_numpy()
    exact = api.drive(case.excitation).states(times)[:, 0]
    assert course == pytest.approx(exact, rel=1e-9, abs=1e-9 * np.abs(exact).max())


def amplitudes(values: FloatArray, numbers: Any) -> Any:
    """Return complex amplitudes of one period at multiples of its frequency."""
    return 2.0 * np.fft.rfft(values)[numbers] / values.size


@pytest.mark.parametrize("engine", ["petsc", "compiled"])
def test_a_mass_on_a_spring_answers_each_line(engine: str) -> None:
    """m ẍ + c (ẋ - q̇) + k (x - q) = 0: H = (k + iωc) / (k - ω²m + iωc)."""
    case = case_of("multisine", "point", "base", "linear").with_overrides(
        {"time.steps_per_period": 200, "time.periods": 60, "output.window_periods": 1,
         "lamina.beam.damping_ratio": 0.05}
    )  # fmt: skip
    history = df.run(case, engine).history
    numbers = case.excitation.numbers  # type: ignore[union-attr]
    q = amplitudes(history["base_displacement"].to_numpy(), numbers)
    x = amplitudes(history["tip_displacement"].to_numpy()[0], numbers)
    omega = 2.0 * np.pi * numbers * case.excitation.spacing  # type: ignore[union-attr]
    w0 = np.sqrt(1000.0)
    D = 0.05 * 2.0 * w0
    exact = (w0**2 + 1j * omega * D) / (w0**2 - omega**2 + 1j * omega * D)
    near = np.abs(exact).max()
    assert np.abs(x / q - exact).max() < 1e-3 * near


@pytest.mark.parametrize("drive", ["random", "realisations"])
@pytest.mark.parametrize("mass", ["consistent", "massless"])
def test_a_run_that_was_stopped_goes_on_exactly(tmp_path: Path, drive: str, mass: str) -> None:
    keys = {"contact": {"law": "newton", "restitution": 0.0}} if mass == "massless" else {}
    case = case_of(drive, "beams", "base", "newton").with_overrides({"time.mass": mass, **keys})

    def interrupt(done: int, periods: int) -> None:
        if done == 2:
            signal.raise_signal(signal.SIGINT)

    straight = df.run(case)
    part = df.run(case, directory=tmp_path, progress=interrupt)
    assert part.history.attrs["outcome"] == "interrupted"
    again = df.run(case, directory=tmp_path, resume=True)
    for name in ("tip_displacement", "tip_velocity", "base_displacement"):
        assert np.array_equal(again.history[name], straight.history[name])


def test_studies_that_need_a_period_refuse_a_random_drive() -> None:
    case = case_of("random", "beams", "base", "newton")
    with pytest.raises(CaseError, match=r"excitation.kind.*repeats after each period.*random"):
        df.orbit(case)
