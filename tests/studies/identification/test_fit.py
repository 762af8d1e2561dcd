"""Keys of a case from frequency responses that exact beams have."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import delam_fem as df
from delam_fem.api import Case, CaseError, FloatArray, beams
from delam_fem.cli.app import app

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
