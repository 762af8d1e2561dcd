"""Runs in modes: without contact exact, with contact near the finite elements, recorded alike."""

import json
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from massless import massless

import delam_fem as df
from delam_fem.api import LEDGER, Case, assemble, session_of
from delam_fem.numerics.beams import transmissibility

SHORT: dict[str, object] = {
    "mesh__elements": 8,
    "time__steps_per_period": 250,
    "time__periods": 6,
    "output__window_periods": 2,
    "output__fields_per_period": 5,
}


def short(modes: int = 5, refine: int = 8, **overrides: object) -> Case:
    """Return a case with little to compute."""
    return massless(modes, refine, **SHORT | overrides)


def test_without_contact_the_tips_follow_the_exact_cantilever() -> None:
    case = short(
        6, contact__law="none", excitation__frequency=2.2, time__steps_per_period=500,
        mesh__elements=20, time__periods=400, output__window_periods=1,
    )  # fmt: skip
    tips = df.run(case).history["tip_displacement"].to_numpy()
    for i, lamina in enumerate(case.lamina):
        H = transmissibility(
            2.0 * np.pi * 2.2,
            length=lamina.length,
            flexural_rigidity=lamina.flexural_rigidity,
            mass_per_length=lamina.mass_per_length,
            rayleigh=case.rayleigh(i),
        )
        t = np.arange(1, 501) / 500.0
        expected = 2.5e-3 * np.imag(H * np.exp(2j * np.pi * t))
        np.testing.assert_allclose(tips[i], expected, atol=2e-4 * np.abs(expected).max())


def test_a_run_has_the_dataset_of_every_run_and_its_energy_adds_up() -> None:
    result = df.run(short())
    data = result.history
    assert data.sizes["time"] == 500
    assert data.sizes["period"] == 6
    assert data.sizes["frame"] == 10
    assert data.sizes["event"] > 0
    assert result.summary["engine"] == "modal"
    assert result.summary["settled"] == "not settled"  # after six periods
    assert result.summary["energy_residual"] < 1e-9
    assert result.summary["minimum_tip_gap"] > -1e-9
    # the tip is the last node of the frames, and the base its first
    last = int(np.searchsorted(data["time"], data["frame"][3] * (1.0 - 1e-12)))
    np.testing.assert_allclose(
        data["displacement"][:, 3, -1], data["tip_displacement"][:, last], atol=1e-12
    )
    np.testing.assert_allclose(
        data["displacement"][:, 3, 0], data["base_displacement"][last], atol=1e-12
    )


def test_the_losses_of_a_state_are_those_of_the_ledger_so_far() -> None:
    case = short()
    with session_of(case, assemble(case, needs_dolfinx=False).operators) as opened:
        opened.run()
        by_period = opened.recorder.ledger[:, LEDGER.index("damping_loss")]
        lost, _ = opened.engine.state().losses
    assert lost == pytest.approx(by_period.sum(), rel=1e-12)


def test_its_work_is_that_of_the_finite_elements() -> None:
    """Base work and strobes of both from rest, before contact parts them."""
    keys = {"time__steps_per_period": 1000, "mesh__elements": 10, "time__periods": 2}
    ours = df.run(short(10, 64, **keys)).history
    case = df.preset("default", {k.replace("__", "."): v for k, v in (SHORT | keys).items()})
    with session_of(case, assemble(case, needs_dolfinx=False).operators) as opened:
        opened.run()
        work, strobe = opened.recorder.ledger[:, 3], opened.recorder.strobe[:, 0].T
    np.testing.assert_allclose(
        ours["energy_base_work"].to_numpy(), work, atol=0.02 * np.abs(work).max()
    )
    np.testing.assert_allclose(ours["strobe_displacement"][:, 0], strobe[:, 0], atol=2e-5)
    np.testing.assert_allclose(ours["strobe_displacement"][:, 1], strobe[:, 1], atol=1e-3)


def test_a_force_drives_the_modes() -> None:
    force = {"kind": "force", "lamina": "thick", "position": 0.5, "amplitude": 0.2}
    case = short(**{f"excitation__{k}": v for k, v in force.items()}, excitation__frequency=3.0)
    result = df.run(case)
    assert np.abs(result.history["energy_force_work"]).max() > 0.0
    assert not result.history["energy_base_work"].any()
    assert result.summary["energy_residual"] < 1e-9


@pytest.mark.slow
def test_a_resumed_run_is_that_of_one_go_bit_for_bit(tmp_path: Path) -> None:
    """The checkpoint holds the modes and the late contact forces, not the motion alone."""

    def interrupt(period: int, n_periods: int) -> None:
        if period == 4:
            os.kill(os.getpid(), signal.SIGINT)

    case, complete_run = short(), df.run(short())
    first = df.run(case, directory=tmp_path, progress=interrupt)
    assert first.summary["outcome"] == "interrupted"
    resumed = df.run(case, directory=tmp_path, resume=True)
    for name in complete_run.history.variables:
        np.testing.assert_array_equal(
            resumed.history[name], complete_run.history[name], err_msg=str(name)
        )
    assert complete_run.state is not None and resumed.state is not None
    np.testing.assert_array_equal(resumed.state.internal, complete_run.state.internal)
    resumed.save(tmp_path)
    assert json.loads((tmp_path / "summary.json").read_text())["outcome"] == "completed"
    longer = df.run(case, directory=tmp_path, extend=2).history["strobe_displacement"]
    again = df.run(short(time__periods=8)).history["strobe_displacement"]
    np.testing.assert_array_equal(longer, again)


def test_a_motion_of_all_dofs_is_read_in_modes() -> None:
    """A start in the modes that are kept is met; the base moves with it."""
    case = short(time__periods=1, contact__law="none")
    state = df.run(case).state
    assert state is not None
    table = df.run(case, initial=state).history
    alone = df.run(case, initial=df.State(state.motion, state.resting)).history
    np.testing.assert_allclose(
        alone["tip_displacement"], table["tip_displacement"], rtol=0.0, atol=1e-12
    )


def test_sensors_read_the_modes() -> None:
    sensors = [
        {"name": "tip", "lamina": "thin", "position": 0.685, "quantity": "displacement"},
        {"name": "rate", "lamina": "thin", "position": 0.685, "quantity": "velocity"},
        {"name": "force", "between": ["thick", "thin"], "quantity": "contact force"},
        {"name": "acceleration", "lamina": "thin", "position": 0.685, "quantity": "acceleration"},
    ]
    case = short()
    sections: dict[str, Any] = case.model_dump(exclude_unset=True)
    case = Case(**sections | {"sensor": sensors})
    data = df.run(case).history
    np.testing.assert_allclose(data["sensor_tip"], data["tip_displacement"][1], atol=1e-14)
    np.testing.assert_allclose(data["sensor_rate"], data["tip_velocity"][1], atol=1e-12)
    impulse = float(data["sensor_force"].sum()) * case.time_step
    assert impulse == pytest.approx(float(data["event_impulse"].sum()))
    change = np.diff(data["sensor_rate"]) / case.time_step
    acceleration = data["sensor_acceleration"][:-1]
    np.testing.assert_allclose(acceleration[1:], 0.5 * (change[1:] + change[:-1]), atol=1e-9)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"contact__restitution": 0.1}, "contact.law: "),
        ({"contact__law": "penalty"}, 'cannot bounce; given "penalty"'),
        ({"time__mass": "consistent"}, "time.mass: "),
        ({"model__kind": "solid"}, 'expected "massless" only with model.kind = "beam", or "modes"'),
        ({"model__modes": 14}, r"model.modes: the modes beyond the lowest 14 .*more mesh.elements"),
    ],
)
def test_what_massless_points_cannot_do_is_refused(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(df.CaseError, match=message):
        df.run(short(**keys))


def test_a_structure_that_is_not_held_is_refused() -> None:
    keys = {"time.mass": "massless", "model.kind": "modes", "contact.law": "newton"}
    ends = {"support.start": "pinned", "support.end": "free", "contact.restitution": 0.0}
    with pytest.raises(df.CaseError, match="support: "):
        df.preset("embedded", keys | ends)


def test_keys_without_an_effect_are_named() -> None:
    case = short(contact__impulse="consistent", time__scheme="newmark")
    assert {"contact.impulse", "time.scheme"} <= set(case.unread)
    assert not {"contact.restitution", "contact.law", "time.refine"} & set(case.unread)


@pytest.mark.nightly
@pytest.mark.parametrize(("rayleigh", "limit"), [("stiffness", -19.73), ("two-mode", -22.81)])
def test_with_twenty_modes_it_is_near_the_rigid_limit(rayleigh: str, limit: float) -> None:
    """The limits of docs/evidence/convergence.md at 3.25 Hz with 20 contact points; margin 3 %."""
    case = massless(20, 256, damping__rayleigh=rayleigh, time__periods=190)
    lows = 1e3 * df.run(case).history["envelope_min"][0, -40:]
    assert float(lows.mean()) == pytest.approx(limit, rel=0.03)
