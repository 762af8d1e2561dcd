"""Keys of a case from frequency responses that exact beams have."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import delam_fem as df
from delam_fem.api import Case, CaseError, FloatArray, assemble, beams, of_channels
from delam_fem.cli.app import app
from delam_fem.studies.identification.unknowns import value_of
from delam_fem.studies.signals.writing import write_measured

EI, D, NOISE = 0.92, 0.012, 0.01
"""The truth, and the noise of a channel over its rms."""
LAMINA = {"length": 0.3, "width": 0.02, "thickness": 0.002, "density": 2700.0}
CASE = Case(
    name="rig",
    lamina=[{"name": "lower", **LAMINA, "bending_stiffness": 1.0, "damping_ratio": 0.01},
            {"name": "upper", **LAMINA, "bending_stiffness": 0.5, "damping_ratio": 0.01}],
    gap={"tip": 0.01}, damping={"rayleigh": "stiffness"}, mesh={"elements": 6},
    excitation={"kind": "harmonic", "frequency": 10.0, "amplitude": 1e-3},
    contact={"law": "newton"},
)  # fmt: skip
UNKNOWN = (
    "lamina.lower.bending_stiffness=0.8:1.2", "lamina.lower.damping_ratio=0.004:0.02",
    "lamina.upper.bending_stiffness=0.3:0.8", "gap.tip=0.005:0.02",
)  # fmt: skip


def exact(frequency: FloatArray) -> beams.ComplexArray:
    """Return the displacement of the lower tip over that of the base."""
    case = CASE.with_overrides(
        {"lamina.lower.bending_stiffness": EI, "lamina.lower.damping_ratio": D}
    )
    rho_A = case.lamina[0].mass_per_length
    return beams.transmissibility(
        2.0 * np.pi * frequency, length=0.3, flexural_rigidity=EI, mass_per_length=rho_A,
        rayleigh=case.rayleigh(0),
    )  # fmt: skip


def record(path: Path, *, periods: int = 3, seed: int = 1, noise: float = NOISE) -> Path:
    """Write periods of 1 s of a multisine of the base in m/s², and the lower tip in mm."""
    rng = np.random.default_rng(seed)
    lines = np.arange(5.0, 150.0)
    drive = np.exp(2j * np.pi * rng.uniform(size=lines.size))
    time = np.arange(periods * 512) / 512.0
    turns = np.exp(2j * np.pi * np.outer(time, lines))
    tip = (turns @ (exact(lines) * drive / (2j * np.pi * lines) ** 2)).real
    tip += noise * tip.std() * rng.standard_normal(tip.size)
    np.savetxt(
        path, np.stack([time, (turns @ drive).real, 1e3 * tip], axis=1), delimiter=",",
        header="time [s],base [m/s2],tip lower [mm]", comments="", fmt="%.12g",
    )  # fmt: skip
    return path


def responses(folder: Path, **options: float) -> Path:
    """Write what `measure response` makes of a record."""
    arguments = [
        "measure", "response", str(record(folder / "record.csv", **options)), "--excitation",
        "base", "--period", "1", "-o", str(folder / "response"), "--overwrite",
    ]  # fmt: skip
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    return folder / "response" / "measured.nc"


@pytest.mark.slow
def test_keys_come_from_the_responses_of_an_exact_beam_and_the_fitted_case_runs(
    tmp_path: Path,
) -> None:
    """What was not measured is not identified: the upper lamina, and the gap."""
    measured = responses(tmp_path)
    finding = df.identify(CASE, tmp_path / "fit", measured=(measured,), unknown=UNKNOWN)
    numbers = json.loads((tmp_path / "fit" / "identification.json").read_text())
    for key, truth in zip(UNKNOWN, (EI, D), strict=False):
        entry = numbers["unknowns"][key.partition("=")[0]]
        low, high = entry["interval_90"]
        error = (high - low) / 3.29
        assert entry["identified"] and abs(entry["median"] - truth) < 3.0 * error
        assert error < 0.01 * truth
    for key in UNKNOWN[2:]:
        entry = numbers["unknowns"][key.partition("=")[0]]
        assert not entry["identified"]
        low, high = entry["interval_90"]
        assert high - low > 0.8 * np.diff(entry["prior"])[0] * 0.9
    assert numbers["mismatch"] is None
    assert numbers["residual"]["tip lower"] < 0.02
    assert (tmp_path / "fit" / "fit.png").stat().st_size > 10_000
    fitted = df.load_case(tmp_path / "fit" / "fitted" / "case.toml")
    assert fitted.lamina[0].bending_stiffness == pytest.approx(EI, rel=0.01)
    assert fitted.name == CASE.name and not fitted.sensor
    assert finding.posterior.samples.shape[1] == len(UNKNOWN)


def test_an_entry_of_a_table_over_x_is_a_key_of_a_fit(tmp_path: Path) -> None:
    """A wedge whose tip is thinner than its case says, with four times as many elements."""
    wedge = CASE.model_dump(exclude_unset=True, exclude_none=True)
    lamina = {
        "name": "one", "length": 0.3, "width": 0.02, "density": 2700.0, "young_modulus": 7e10,
        "damping_ratio": 0.01, "thickness": {"x": [0.0, 0.3], "value": [0.003, 0.002]},
    }  # fmt: skip
    case = Case(**(wedge | {"lamina": [lamina], "gap": None, "mesh": {"elements": 12}}))
    key = "lamina.one.thickness.value.2"
    truth = case.with_overrides({key: 0.0014, "mesh.elements": 48})
    frequency = np.arange(5.0, 400.0, 2.0)
    s = 2j * np.pi * frequency
    tip = of_channels(assemble(truth, needs_dolfinx=False), truth, s)["tip_one"]
    rng = np.random.default_rng(1)
    tip = tip * (1.0 + 0.01 * (rng.standard_normal((s.size, 2)) @ [1.0, 1j]))
    names = ["base", "tip one"]
    data = xr.Dataset(
        {"base": ("time", np.zeros(4)), "tip_one": ("time", np.zeros(4))},
        {"time": np.arange(4.0), "frequency": frequency, "output": names[1:], "channel": names},
        {"schema": "delam_fem measurement", "title": "measurement", "notes": ""},
    )
    about = {"units": "1", "excitation": "base", "excitation_units": "m"}
    data["response"] = (("frequency", "output"), tip[:, None], about)
    for name, values in {
        "variable": ["base", "tip_one"], "units": ["m", "m"], "lamina": ["", "one"],
        "quantity": ["displacement"] * 2, "position": [np.nan] * 2, "source": names,
    }.items():  # fmt: skip
        data[f"channel_{name}"] = ("channel", values)
    path = write_measured(data, tmp_path / "wedge.nc")
    unknowns = (f"{key}=0.001:0.0025", "lamina.one.damping_ratio=0.005:0.02")
    finding = df.identify(case, tmp_path / "fit", measured=(path,), unknown=unknowns, uncertain=())
    for (low, high), value in zip(finding.posterior.interval(0.999), (0.0014, 0.01), strict=True):
        assert low < value < high < 1.05 * low
    fitted = df.load_case(tmp_path / "fit" / "fitted" / "case.toml")
    assert value_of(fitted, key) == pytest.approx(0.0014, rel=1e-3)


@pytest.mark.slow
def test_a_rig_of_another_kind_is_not_the_model(tmp_path: Path) -> None:
    """Of the exact beam with a wrong mass 1 % of the tip is left, ten times the noise."""
    measured = responses(tmp_path, noise=1e-4)
    heavy = CASE.with_overrides({"lamina.lower.density": 3000.0, "mesh.elements": 3})
    case = Case(**(heavy.model_dump(exclude_unset=True, exclude_none=True) | {
        "point_mass": [{"lamina": "lower", "mass": 0.01, "position": 0.2}],
    }))  # fmt: skip
    finding = df.identify(case, measured=(measured,), unknown=(UNKNOWN[0],), uncertain=())
    assert finding.report.numbers is not None
    assert "not this model" in str(finding.report.numbers["mismatch"])


TENSION = 30.0
"""Of the strip on pins [N]."""


def pinned(lines: FloatArray) -> beams.ComplexArray:
    """Return the middle of a strip on pins under tension over its base, with C = β K.

    u = q + Σ W_n sin(nπ/2), (ω_n² (1 + iωβ) - ω²) W_n = ω² q 4/(nπ) of odd n, where
    ρA ω_n² = EI (nπ/L)⁴ + N (nπ/L)².
    """
    n = np.arange(1, 400, 2)[:, None]
    wave = n * np.pi / 0.3
    square = (EI * wave**4 + TENSION * wave**2) / (2700.0 * 0.02 * 0.002)
    omega = 2.0 * np.pi * lines
    beta = 2.0 * D / np.sqrt(square[0])
    modes = omega**2 * 4.0 / (n * np.pi) / (square * (1.0 + 1j * omega * beta) - omega**2)
    return np.asarray(1.0 + np.sin(0.5 * np.pi * n[:, 0]) @ modes)


@pytest.mark.nightly  # two minutes of processor time
def test_a_tension_comes_from_the_responses_of_an_exact_strip_on_pins(tmp_path: Path) -> None:
    """The first frequency depends on EI and the tension, the third on EI nearly alone."""
    rng = np.random.default_rng(3)
    lines = np.arange(20.0, 700.0, 2.0)
    drive = np.exp(2j * np.pi * rng.uniform(size=lines.size))
    time = np.arange(3 * 1024) / 2048.0
    turns = np.exp(2j * np.pi * np.outer(time, lines))
    middle = (turns @ (pinned(lines) * drive / (2j * np.pi * lines) ** 2)).real
    middle += NOISE * middle.std() * rng.standard_normal(middle.size)
    np.savetxt(
        tmp_path / "record.csv", np.stack([time, (turns @ drive).real, 1e3 * middle], axis=1),
        delimiter=",", header="time [s],base [m/s2],middle [mm]", comments="", fmt="%.12g",
    )  # fmt: skip
    result = CliRunner().invoke(app, [
        "measure", "response", str(tmp_path / "record.csv"), "--excitation", "base",
        "--period", "0.5", "-o", str(tmp_path / "response"),
    ])  # fmt: skip
    assert result.exit_code == 0, result.output
    strip = LAMINA | {"name": "strip", "bending_stiffness": 1.0, "damping_ratio": 0.01}
    case = Case(
        name="pins", lamina=[strip], support={"start": "pinned", "end": "pinned"},
        load=[{"axial": 20.0}], damping={"rayleigh": "stiffness"}, mesh={"elements": 12},
        sensor=[{"name": "middle", "quantity": "displacement", "lamina": "strip",
                 "position": 0.15}],
        excitation={"kind": "harmonic", "frequency": 20.0, "amplitude": 1e-3},
        contact={"law": "none"},
    )  # fmt: skip
    finding = df.identify(
        case, measured=(tmp_path / "response" / "measured.nc",), uncertain=(),
        unknown=("load.1.axial=0:60", "lamina.strip.bending_stiffness=0.8:1.2",
                 "lamina.strip.damping_ratio=0.004:0.02"),
    )  # fmt: skip
    numbers = finding.report.numbers
    assert numbers is not None
    for key, truth, width in (
        ("load.1.axial", TENSION, 0.25), ("lamina.strip.bending_stiffness", EI, 0.05),
        ("lamina.strip.damping_ratio", D, 0.1),
    ):  # fmt: skip
        entry = numbers["unknowns"][key]
        low, high = entry["interval_90"]
        assert entry["identified"], key
        assert abs(entry["median"] - truth) < max(3.0 * (high - low) / 3.29, 2e-3 * truth), key
        assert high - low < width * truth
    assert numbers["mismatch"] is None


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    measured = responses(tmp_path)
    with pytest.raises(CaseError, match="--frequency"):
        df.identify(CASE, unknown=UNKNOWN)
    with pytest.raises(CaseError, match="either"):
        df.identify(CASE, measured=(measured,), unknown=UNKNOWN, frequency=(3.0,))
    with pytest.raises(CaseError, match="band"):
        df.identify(CASE, measured=(measured,), unknown=UNKNOWN, band=(9.0, 3.0))
    with pytest.raises(CaseError, match="at least 8 lines"):
        df.identify(CASE, measured=(measured,), unknown=UNKNOWN, band=(9.0, 12.0))
    with pytest.raises(CaseError, match="tip upper"):
        df.identify(CASE, measured=(measured,), unknown=UNKNOWN, channel=("tip upper",))
    force = CASE.with_overrides(
        {"excitation.kind": "force", "excitation.lamina": "lower", "excitation.position": 0.3,
         "excitation.amplitude": 1.0, "excitation.frequency": 3.0}
    )  # fmt: skip
    with pytest.raises(CaseError, match="responses to the force"):
        df.identify(force, measured=(measured,), unknown=UNKNOWN)
