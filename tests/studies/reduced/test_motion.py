"""Reduced cases: without contact exact, with contact near the finite elements, recorded alike."""

import numpy as np
import pytest

import delam_fem as df
from delam_fem.case.definition import Case
from delam_fem.model.beams import closed_form
from delam_fem.numerics.beams import transmissibility
from delam_fem.studies.reduced import reduced


def short(**overrides: object) -> Case:
    """Return the preset "default" with little to compute."""
    keys: dict[str, object] = {
        "mesh.elements": 8,
        "time.steps_per_period": 250,
        "time.periods": 6,
        "output.window_periods": 2,
        "output.fields_per_period": 5,
    }
    return df.preset("default", keys | {k.replace("__", "."): v for k, v in overrides.items()})


def test_without_contact_the_tips_follow_the_exact_cantilever() -> None:
    case = short(
        contact__law="none", excitation__frequency=2.2, time__steps_per_period=500,
        mesh__elements=20, time__periods=200,
    )  # fmt: skip
    motion = reduced(case, 6)
    state = motion.advance(motion.rest, 400)
    u = motion.reduced.displacement(
        *(getattr(motion.period(state).trace, name) for name in ("q", "s")), motion.motion(0)[:, 0]
    )
    tips = u @ motion.reduced.probes.T
    for i, lamina in enumerate(case.lamina):
        H = transmissibility(
            2.0 * np.pi * 2.2,
            length=lamina.length,
            flexural_rigidity=lamina.flexural_rigidity,
            mass_per_length=lamina.mass_per_length,
            rayleigh=case.rayleigh(i),
        )
        t = np.arange(501) / 500.0
        expected = 2.5e-3 * np.imag(H * np.exp(2j * np.pi * t))
        np.testing.assert_allclose(tips[:, i], expected, atol=2e-4 * np.abs(expected).max())


def test_a_run_has_the_dataset_of_every_run_and_its_energy_adds_up() -> None:
    case = short()
    result = reduced(case, 5, refine=8).run()
    data = result.history
    assert data.sizes["time"] == 500
    assert data.sizes["period"] == 6
    assert data.sizes["frame"] == 10
    assert data.sizes["event"] > 0
    assert result.summary["engine"] == "modal"
    assert result.summary["model"] == {"kind": "reduced", "modes": 5, "refine": 8}
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


def test_its_work_is_that_of_the_finite_elements() -> None:
    """Base work and strobes of both from rest, before contact parts them."""
    case = short(time__steps_per_period=1000, mesh__elements=10, time__periods=2)
    ours, theirs = reduced(case, 10, refine=64).run().history, _elements(case)
    work = ours["energy_base_work"].to_numpy()
    np.testing.assert_allclose(work, theirs[0], atol=0.02 * np.abs(work).max())
    np.testing.assert_allclose(ours["strobe_displacement"][:, 0], theirs[1][:, 0], atol=2e-5)
    np.testing.assert_allclose(ours["strobe_displacement"][:, 1], theirs[1][:, 1], atol=1e-3)


def _elements(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Return base work and strobes of the whole structure with refined steps."""
    from delam_fem.engines.session import session_of

    operators = closed_form.assemble(case).operators
    with session_of(case, operators) as opened:
        opened.run()
        solution = opened.recorder
    return solution.ledger[:, 3], solution.strobe[:, 0].T


def test_a_period_is_the_same_advanced_or_recorded() -> None:
    motion = reduced(short(), 5, refine=8)
    state = motion.advance(motion.rest, 2)
    np.testing.assert_array_equal(motion.advance(state), motion.period(state).end)


def test_a_force_drives_the_reduced_case() -> None:
    force = {"kind": "force", "lamina": "thick", "position": 0.5, "amplitude": 0.2}
    case = short(**{f"excitation__{k}": v for k, v in force.items()}, excitation__frequency=3.0)
    result = reduced(case, 5, refine=8).run()
    assert np.abs(result.history["energy_force_work"]).max() > 0.0
    assert not result.history["energy_base_work"].any()
    assert result.summary["energy_residual"] < 1e-9


def test_more_modes_than_the_mesh_allows_are_refused() -> None:
    with pytest.raises(df.CaseError, match=r"case default: modes: .*more mesh.elements"):
        df.reduced(short(), 14)


@pytest.mark.nightly
@pytest.mark.parametrize(("rayleigh", "limit"), [("stiffness", -19.73), ("two-mode", -22.81)])
def test_with_twenty_modes_it_is_near_the_rigid_limit(rayleigh: str, limit: float) -> None:
    """The limits of docs/convergence.md at 3.25 Hz with 20 contact points; margin 3 %."""
    motion = reduced(df.preset("default", {"damping.rayleigh": rayleigh}), 20, refine=256)
    state = motion.advance(motion.rest, 150)
    lows = []
    for _ in range(40):
        found = motion.period(state)
        u = motion.reduced.displacement(found.trace.q, found.trace.s, motion.motion(0)[:, 0])
        lows.append(1e3 * (u @ motion.reduced.probes.T)[:, 0].min())
        state = found.end
    assert np.mean(lows) == pytest.approx(limit, rel=0.03)
