"""What a user writes before reading the documentation works, or says what to write."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import delam_fem as df
from delam_fem.api import LawContext, Structure, assemble, span_of
from delam_fem.contact.decisions import Supervisor

SHORT = {
    "time.periods": 2, "time.steps_per_period": 200, "mesh.elements": 4,
    "output.window_periods": 2, "output.fields_per_period": 0,
}  # fmt: skip
UNIT = sp.identity(2, format="csr")
NONE = df.BaseCoupling.none(2)
NO_PAIRS = sp.csr_matrix((0, 2))
BASE = df.BaseCoupling(np.zeros(2), np.zeros(2), np.array([-1.0, -1.0]))
LAMINA = {
    "length": 0.2, "width": 0.02, "thickness": 1e-3, "density": 2700.0, "young_modulus": 7e10,
    "damping_ratio": 0.01,
}  # fmt: skip


def pair(**more: Any) -> df.Operators:
    """Return two oscillators on a shaking base; the second, half as stiff, strikes the first."""
    stiffness = sp.diags([1.0, 0.5], format="csr")
    gap = sp.csr_matrix([[-1.0, 1.0]])
    return df.Operators(UNIT, 0.1 * UNIT, stiffness, BASE, gap, np.array([1e-3]), **more)


def solve(operators: df.Operators | Structure, **keys: Any) -> df.OperatorsResult:
    usual = {"steps_per_period": 100, "periods": 3, "law": "newton", "scheme": "moreau-jean"}
    return df.run(operators, **usual | {"drive": df.HarmonicMotion(0.2, 1.0)} | keys)


def test_a_case_may_be_named(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(df.preset("paper", SHORT).to_toml())
    by_name, by_case = df.run(file), df.run(df.load_case(file))
    assert by_name.history.tip_displacement.equals(by_case.history.tip_displacement)
    assert df.modes("paper", 2).frequencies.shape == (2, 2)


def test_the_last_part_of_a_key_suffices() -> None:
    case = df.preset("default", {"time.periods": 7}, frequency=3.3, restitution=0.4)
    assert (case.excitation.top_frequency, case.contact.restitution) == (3.3, 0.4)
    assert case.n_periods == 7
    assert case.with_overrides(tip="2 mm").gap.tip == 2e-3  # type: ignore[union-attr]


def test_a_case_is_written_in_python() -> None:
    case = df.Case(
        name="mine",
        lamina=[{"name": "a", **LAMINA}, {"name": "b", **LAMINA}],
        gap={"tip": 1e-3},
        mesh={"elements": 10},
        excitation={"kind": "harmonic", "frequency": 12.0, "amplitude": 1e-3},
        contact={"law": "newton", "restitution": 0.5},
    )
    assert case.length == 0.2
    assert case.with_overrides({"lamina.a.thickness": 2e-3}).lamina[0].thickness == 2e-3


def test_a_sweep_is_a_case_and_values(tmp_path: Path) -> None:
    case = df.preset("default", SHORT)
    sweep = df.Sweep(case, {"excitation.frequency": np.array([3.2, 3.4])}, record={"strobes": 2})
    data = df.run_sweep(sweep, tmp_path / "sweep", "serial")
    assert data.frequency.values.tolist() == [3.2, 3.4]
    alone = df.run(sweep.case(1), "compiled").summary["tip_max"]
    assert data.tip_max.sel(frequency=3.4).values == pytest.approx(alone, rel=1e-9)


def test_a_refinement_of_elements(tmp_path: Path) -> None:
    case = df.preset("default", SHORT)
    law = "newton@moreau-jean"
    convergence = df.converge(
        case, tmp_path, laws=[law], elements=[2, 4], limit_steps=0, periods=2, workers=1
    )
    assert {level.mesh for level in convergence.refinement.levels()} == {2, 4}


def test_operators_run_until_a_time() -> None:
    result = solve(
        pair(probes=UNIT), steps_per_period=None, periods=None, time_step=0.01, until=20.0
    )
    history = result.history
    assert 20.0 <= float(history.time[-1]) < 20.2
    assert history.probe_displacement.shape == (2, history.sizes["time"])
    assert history.probe_displacement.attrs["units"] == "m"
    assert history.sizes["event"] > 0
    assert float(history.event_impulse.min()) >= 0.0
    gap = 1e-3 + history.probe_displacement[1] - history.probe_displacement[0]
    assert float(gap.min()) < 1e-3
    complete_run = solve(pair(probes=UNIT), periods=None, until=14.9)
    assert float(complete_run.history.time[-1]) == pytest.approx(15.0)


@pytest.mark.parametrize("engine", ["petsc", "compiled"])
def test_operators_give_names_figures_and_a_verdict(engine: str, tmp_path: Path) -> None:
    """The verdict knows the decay: each mode of `pair` has c/m = 0.1/s, so e^(-0.05 t)."""
    probes = sp.csr_matrix([[1.0, 0.0], [0.0, 1.0], [-1.0, 1.0]])
    probed = pair(probes=probes, names=("left", "right", "between"))
    result = solve(
        probed, engine=engine, periods=60, window_periods=5, name="two masses", frames_per_period=4
    )
    assert isinstance(result, df.Result)
    assert result.summary["settled"] == "settled"
    assert result.summary["settling"]["decay"] == pytest.approx(0.05 / 0.2)
    window = result.history.probe_displacement.sel(probe="right")
    history = result.history  # the probes read the dofs
    for name in ("displacement", "velocity"):
        at_frames = history[f"probe_{name}"].sel(time=history.frame, method="nearest")[:2]
        assert np.allclose(history[f"dof_{name}"].T, at_frames, rtol=1e-12, atol=1e-14)
    assert history.sizes["frame"] == 20
    assert result.summary["probe_max"][1] == pytest.approx(float(window.max()), rel=1e-12)
    assert result.summary["impacts_per_period"] == result.history.sizes["event"] / 5
    written = {path.name for path in result.save(tmp_path / "out")}
    figures = {"probe_histories", "phase_portraits", "spectra", "energy_ledger", "envelope"}
    assert written == {"result.nc", "summary.json", "report.html", *(f"{n}.png" for n in figures)}
    assert set(dir(result.plot)) == figures
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert "two masses: 0.2 Hz, contact: newton@moreau-jean" in page and "probe min" in page
    assert "two masses" in result._repr_html_()
    with pytest.raises(df.CaseError, match="export: "):
        result.export("csv", tmp_path / "x.csv")


def test_operators_without_probes_run(tmp_path: Path) -> None:
    result = solve(pair())
    assert result.history.sizes["probe"] == 0 and result.summary["probes"] == []
    unnamed = solve(pair(probes=sp.identity(2, format="csr")), periods=2)
    assert unnamed.summary["probes"] == ["probe 1", "probe 2"]
    assert result.history.sizes["event"] > 0
    assert tmp_path / "figures" / "energy_ledger.png" in result.save(tmp_path)


def test_a_structure_runs_as_its_case() -> None:
    case = df.preset("default", SHORT)
    beams = assemble(case, needs_dolfinx=False)
    drive = df.HarmonicMotion(case.excitation.top_frequency, case.excitation.amplitude)
    by_case = df.run(case, "compiled", structure=beams)
    alone = solve(
        beams, engine="compiled", law=case.contact_law, scheme=case.time.scheme, drive=drive,
        steps_per_period=200, periods=2, refinement=span_of(case).refinement,
    )  # fmt: skip
    assert alone.summary["probes"][:2] == ["thick tip", "thin tip"]
    tips = alone.history.probe_displacement[:2].to_numpy()
    assert np.array_equal(tips, by_case.history.tip_displacement.to_numpy())
    assert alone.history.event_impulse.equals(by_case.history.event_impulse)
    for name in ("periodicity", "thd", "distortion_factor", "impacts_per_period", "steps"):
        assert alone.summary[name] == by_case.summary[name]
    assert alone.summary["probe_min"][:2] == by_case.summary["tip_min"]


def test_what_a_run_is_given_replaces_keys() -> None:
    case = df.preset("default", SHORT)
    law, drive = df.Law("newton", restitution=0.3), df.HarmonicMotion(3.3, 2e-3)
    result = df.run(case, "compiled", law=law, scheme="newmark", drive=drive, until=0.5)
    used_case = result.case
    assert (used_case.contact.law, used_case.contact.restitution) == ("newton", 0.3)
    assert used_case.time.scheme == "newmark"
    assert (used_case.excitation.top_frequency, used_case.excitation.amplitude) == (3.3, 2e-3)
    assert used_case.n_periods == 2  # 0.5 s are 1.65 periods
    same = df.run(used_case, "compiled").history
    assert result.history.tip_displacement.equals(same.tip_displacement)


@dataclass(frozen=True)
class Borrowed:
    """A law of one's own that decides as Newton's."""

    name: str = "borrowed"
    spring: tuple[float, float] = (0.0, 0.0)
    is_coupled: bool = True

    def supervisor(self, scheme: df.Scheme, setting: LawContext) -> Supervisor:
        return df.Law("newton", restitution=0.2).supervisor(scheme, setting)


def test_a_law_of_ones_own_acts_in_a_case(tmp_path: Path) -> None:
    case = df.preset("default", SHORT)
    result = df.run(case, law=Borrowed(), scheme="newmark")
    table = df.run(case, law=df.Law("newton", restitution=0.2), scheme="newmark")
    assert result.history.tip_displacement.equals(table.history.tip_displacement)
    assert result.history.sizes["event"] > 0
    (told,) = [text for text in result.summary["warnings"] if "borrowed" in text]
    assert (
        told == "contact.law: in place of the law of the case acted 'borrowed'; case.toml does "
        "not say so"
    )
    assert not [text for text in table.summary["warnings"] if "in place" in text]
    result.save(tmp_path / "own", figures=False)
    assert not (tmp_path / "own" / "state.npz").exists()  # its case would go on with another law
    with pytest.raises(df.CaseError, match="directory: "):
        df.run(case, law=Borrowed(), scheme="newmark", directory=tmp_path)
    massless = {"time.mass": "massless", "model.kind": "modes", "contact.restitution": 0.0}
    with pytest.raises(df.CaseError, match="law: "):
        df.run(df.preset("default", {**SHORT, **massless}), law=Borrowed())


BAD: dict[str, Callable[[], object]] = {
    "law: expected one of none, newton,": lambda: df.Law("newtn"),  # type: ignore[arg-type]
    "impulse: expected one of lumped": lambda: df.Law("newton", impulse="x"),  # type: ignore[arg-type]
    "restitution: expected a number from 0 to 1, given 1.5": lambda: df.Law("newton", 1.5),
    "restitution: expected a number from 0 to 1, given nan": lambda: df.Law("newton", np.nan),
    "penalty_stiffness: .* given -1": lambda: df.Law("penalty", penalty_stiffness=-1.0),
    "scheme: expected one of newmark": lambda: df.Scheme("newmrk"),  # type: ignore[arg-type]
    "theta: expected a number from 0.5 to 1, given 0.2": lambda: df.Scheme(theta=0.2),
    r"state.motion: .* given \(2, 2\)": lambda: df.State(np.zeros((2, 2)), np.zeros(0, bool)),
    "state.resting: .* given 'float64'": lambda: df.State(np.zeros((3, 2)), np.zeros(0)),  # type: ignore[arg-type]
    "frequency: expected a number above 0": lambda: df.HarmonicMotion(-1.0, 1.0),
    "amplitude: expected a finite number": lambda: df.HarmonicMotion(1.0, np.nan),
    "mass: expected a sparse matrix, given ndarray": lambda: df.Operators(
        np.eye(2),
        UNIT,
        UNIT,
        NONE,
        NO_PAIRS,
        np.zeros(0),  # type: ignore[arg-type]
    ),
    "mass: expected a diagonal without negative": lambda: df.Operators(
        -UNIT, UNIT, UNIT, NONE, NO_PAIRS, np.zeros(0)
    ),
    "stiffness: expected finite numbers": lambda: df.Operators(
        UNIT, UNIT, np.nan * UNIT, NONE, NO_PAIRS, np.zeros(0)
    ),
    r"initial.motion: expected the shape \(3, 2\), given \(3, 5\)": lambda: solve(
        pair(), initial=df.State(np.zeros((3, 5)), np.zeros(1, bool))
    ),
    "time_step: expected a number above 0": lambda: solve(pair(), time_step=-1.0),
    "periods: expected a whole number from 1, given 0": lambda: solve(pair(), periods=0),
    "until: expected a number above 0 .s., given -1": lambda: solve(
        pair(), periods=None, until=-1.0
    ),
    "expected either periods or until": lambda: solve(pair(), until=1.0),
    "steps_per_period: missing": lambda: solve(pair(), steps_per_period=None),
    "operators: law or scheme is missing; for example": lambda: df.run(pair()),  # type: ignore[call-overload]
    "run: periods: a case has keys for all but .*, until": lambda: df.run(  # type: ignore[call-overload]
        "default", periods=3
    ),
    "run: resume: operators know comm, drive, ": lambda: solve(pair(), resume=True),
    "drive: expected a HarmonicMotion with a case": lambda: df.run(  # type: ignore[call-overload]
        "default", drive=df.SweptMotion(1.0, 2.0, 1.0, 1e-3)
    ),
    "until: expected a number above 0": lambda: df.run("default", until=0.0),
    "goes with the scheme": lambda: df.run("default", law="penalty", scheme="moreau-jean"),
    "neither a file nor a preset": lambda: df.run("nothing"),
    "run: expected a case, .* given 7": lambda: df.run(7),  # type: ignore[call-overload]
    "case: 5 problems": lambda: df.Case(),
    "did you mean frequency": lambda: df.preset("default", fequency=1.0),
    r'write {"section.key"': lambda: df.preset("default", blubb=1.0),
    'say which: {"lamina.thick.thickness"': lambda: df.preset("default", thickness=1e-3),
    "excitation.freq: unknown key": lambda: df.Sweep("default", {"excitation.freq": [1.0]}),
    "axis.1.key: expected a key": lambda: df.Sweep("default", {"frequency": [1.0]}),
}


@pytest.mark.parametrize("message", BAD)
def test_what_is_wrong_is_named(message: str) -> None:
    with pytest.raises(df.CaseError, match=message):
        BAD[message]()
