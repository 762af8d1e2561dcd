"""A force at a point: steady response, work, blow of a hammer, both engines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

import delam_fem as df
from delam_fem.api import assemble, run, solve
from delam_fem.case.excitation import HalfSine
from delam_fem.model.layout import point_load
from delam_fem.studies.sweeps.grid import sweep_of

ENGINES = ("petsc", "compiled")
FORCE = {
    "excitation.kind": "force",
    "excitation.lamina": "upper",
    "excitation.position": 0.173,  # inside an element
    "excitation.amplitude": 0.01,
    "excitation.frequency": 60.0,
    "mesh.elements": 20,
    "time.steps_per_period": 200,
    "time.periods": 4,
    "output.window_periods": 4,
    "output.fields_per_period": 0,
}
ROUND_OFF = 1e-10


def case_of(**more: object) -> df.Case:
    """Return the preset `embedded` under a force."""
    return df.preset("embedded", FORCE | {key.replace("__", "."): v for key, v in more.items()})


@pytest.mark.parametrize("engine", ENGINES)
def test_steady_response_is_that_of_the_frequency_domain(engine: str) -> None:
    case = case_of(
        contact__law="none", time__periods=150, lamina__lower__damping_ratio=0.05,
        lamina__upper__damping_ratio=0.05, output__window_periods=1, time__steps_per_period=1000,
    )  # fmt: skip
    structure = assemble(case, needs_dolfinx=False)
    o, w = structure.operators, 2.0 * np.pi * 60.0
    load = point_load(structure.layout, structure.layout.parts[1], 0.173, o.n_dofs)
    U = spsolve((o.stiffness + 1j * w * o.damping - w**2 * o.mass).tocsc(), 0.01 * load)
    history = run(case, engine, structure=structure).history
    t = history.time.to_numpy()
    expected = (o.probes @ U)[:, None] * np.exp(1j * w * t)
    size = np.abs(expected).max()
    assert np.abs(history.tip_displacement.to_numpy() - expected.imag[:2]).max() < 1e-4 * size
    assert history.force.to_numpy() == pytest.approx(0.01 * np.sin(w * t), abs=1e-12)
    assert not history.base_displacement.to_numpy().any()


@pytest.mark.parametrize("engine", ENGINES)
def test_work_of_the_force_is_force_times_path(engine: str) -> None:
    case = case_of()
    structure = assemble(case, needs_dolfinx=False)
    result = run(case, engine, structure=structure)
    h = result.history
    assert result.summary["energy_residual"] < ROUND_OFF
    assert not h.energy_base_work.to_numpy().any()
    losses = h.energy_damping_loss + h.energy_contact_damping_loss + h.energy_impact_loss
    net = np.cumsum((h.energy_force_work - losses).to_numpy())
    stored = (h.energy_kinetic + h.energy_strain).to_numpy()
    assert (h.energy_strain.to_numpy() > 0.0).all()
    assert net == pytest.approx(stored, rel=1e-8)
    assert h.energy_force_work.to_numpy().sum() > 0.0


def test_work_against_the_probe_under_the_force() -> None:
    case = case_of(excitation__position=0.2)  # where the reference probes are
    h = run(case, "petsc", structure=assemble(case, needs_dolfinx=False)).history
    q = np.concatenate([[0.0], h.tip_displacement.sel(lamina="upper").to_numpy()])
    F = np.concatenate([[0.0], h.force.to_numpy()])
    work = (0.5 * (F[1:] + F[:-1]) * np.diff(q)).reshape(4, -1).sum(axis=1)
    assert h.energy_force_work.to_numpy() == pytest.approx(work, rel=1e-9)


def test_both_engines_and_twice_the_force() -> None:
    case, twice = case_of(), case_of(excitation__amplitude=0.02)
    structure = assemble(case, needs_dolfinx=False)
    by = {
        engine: run(case, engine, structure=structure).history.tip_displacement.to_numpy()
        for engine in ENGINES
    }
    size = np.abs(by["petsc"]).max()
    assert np.abs(by["compiled"] - by["petsc"]).max() < 1e-7 * size
    doubled = run(twice, "compiled", structure=structure).history.tip_displacement.to_numpy()
    assert (doubled == 2.0 * by["compiled"]).all()


def test_force_on_separate_laminae_reaches_one_of_them() -> None:
    keys = {key: value for key, value in FORCE.items() if not key.startswith("mesh")}
    keys |= {"excitation.lamina": "thin", "contact.law": "none", "excitation.position": 0.5}
    case = df.preset("default", keys)
    tips = run(
        case, "compiled", structure=assemble(case, needs_dolfinx=False)
    ).history.tip_displacement
    assert not tips.sel(lamina="thick").to_numpy().any()
    assert np.abs(tips.sel(lamina="thin").to_numpy()).max() > 1e-5


def test_short_blow_changes_the_velocity_like_an_impulse() -> None:
    case = case_of(lamina__lower__damping_ratio=0.0, lamina__upper__damping_ratio=0.0)
    structure = assemble(case, needs_dolfinx=False)
    o, duration = structure.operators, 1e-7
    blow = HalfSine(10.0, duration)
    end = solve(
        o, df.Law("none"), df.SCHEMES["moreau-jean"], blow, steps_per_period=200, periods=1,
        time_step=duration / 200,
    ).state  # fmt: skip
    load = point_load(structure.layout, structure.layout.parts[1], 0.173, o.n_dofs)
    velocity = spsolve(o.mass.tocsc(), 2.0 / np.pi * 10.0 * duration * load)
    size = np.abs(velocity).max()
    assert np.abs(end.motion[1] - velocity).max() < 2e-3 * size


def test_force_where_the_lamina_is_held() -> None:
    with pytest.raises(df.CaseError, match=r"expected a point that can move, given 0.0 m"):
        assemble(case_of(excitation__position=0.0), needs_dolfinx=False)


BLOW = {
    "excitation.kind": "hammer", "excitation.duration": 1e-3, "excitation.start": 2e-3,
    "time.duration": 0.02, "time.step": 2e-5, "time.steps_per_period": None, "time.periods": None,
    "output.window_periods": None, "excitation.frequency": None,
}  # fmt: skip


def test_the_whole_run_of_a_blow_is_recorded_by_both_engines() -> None:
    case = df.preset("embedded", FORCE | BLOW)
    structure = assemble(case, needs_dolfinx=False)
    histories = [run(case, engine, structure=structure).history for engine in ENGINES]
    for history in histories:
        t, F = history.time.to_numpy(), history.force.to_numpy()
        assert t == pytest.approx(2e-5 * np.arange(1, 1001))
        assert 2e-5 * F.sum() == pytest.approx(2.0 / np.pi * 0.01 * 1e-3, rel=1e-3)
        assert not F[t < 2e-3].any() and not F[t > 3e-3].any()
    tips = [history.tip_displacement.to_numpy() for history in histories]
    assert np.abs(tips[0] - tips[1]).max() < 1e-7 * np.abs(tips[0]).max()
    assert np.abs(tips[0]).max() > 0.0


def test_a_sweep_over_a_blow(tmp_path: Path) -> None:
    sweep = sweep_of({
        "name": "blows", "base": "embedded", "set": FORCE | BLOW, "engine": "compiled",
        "axis": [{"key": "excitation.duration", "values": [5e-4, 1e-3]}],
    })  # fmt: skip
    with df.run_sweep(sweep, tmp_path, "serial") as data:
        assert data.attrs["n_completed"] == 2
        assert np.diff(data.tip_max.sel(lamina="upper").to_numpy())[0] > 0.0
