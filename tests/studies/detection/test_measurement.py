"""Simulated scans: settled, sampled as asked, with the noise that was asked for."""

import numpy as np
import pytest

from delam_fem.api import Case, CaseError, assemble, preset
from delam_fem.studies.detection.detect import intact, simulated
from delam_fem.studies.detection.study import Scan
from delam_fem.studies.linear import linear_amplitudes, settling_periods, steady_motion
from delam_fem.studies.signals.scan import scan_positions, shapes_of, surface_of

COARSE = {"mesh.elements": 20, "time.steps_per_period": 100}


def embedded(**keys: object) -> Case:
    return preset("embedded", COARSE | {"excitation.frequency": 80.0} | keys)


def test_an_intact_beam_moves_as_linear_theory_says() -> None:
    case = intact(embedded(**{"time.steps_per_period": 800}))
    scan = Scan(first=0.0, quantity="displacement", sampling_rate=80.0 * 20)
    measurement = simulated(case, scan)
    assert measurement.field.shape == (16 * 20, 41)
    shapes = shapes_of(measurement.field, measurement.times, 80.0, measurement.x)
    middle = abs(shapes.order(1.0)[20])
    expected = linear_amplitudes(case, np.array([80.0]))[0, 0]  # the probe is in the middle
    assert middle == pytest.approx(expected, rel=2e-3)  # of the time step
    assert np.abs(shapes.order(2.0)).max() < 1e-9 * middle
    assert abs(shapes.order(1.0)[0]) == pytest.approx(
        0.1 / (2 * np.pi * 80.0) ** 2, rel=1e-9
    )  # the clamp moves with the base


def test_velocity_is_the_rate_of_displacement() -> None:
    case = embedded()
    u, v = (simulated(case, Scan(quantity=quantity)) for quantity in ("displacement", "velocity"))
    both = [shapes_of(m.field, m.times, 80.0, m.x).order(1.0) for m in (u, v)]
    np.testing.assert_allclose(both[1], 2j * np.pi * 80.0 * both[0], rtol=2e-2)


def test_the_steady_motion_is_a_steady_state_of_the_closed_structure() -> None:
    case = embedded()
    structure = assemble(case, needs_dolfinx=False)
    state = steady_motion(case, structure)
    assert state is not None
    gaps = structure.operators.gap_matrix @ state.motion[0]
    assert np.abs(gaps).max() < 1e-12 * np.abs(state.motion[0]).max()
    o = structure.operators
    u, v, a = state.motion
    omega, A = 2 * np.pi * 80.0, 0.1 / (2 * np.pi * 80.0) ** 2
    residual = o.mass @ a + o.damping @ v + o.stiffness @ u + o.base.damping * (omega * A)
    lower = structure.layout.parts[0].dofs[:6]  # bonded nodes carry no contact force
    dofs = lower[lower >= 0]
    assert np.abs(residual[dofs]).max() < 1e-9 * np.abs((o.stiffness @ u)[dofs]).max()


def test_noise_in_decibels_and_as_a_density() -> None:
    measurement = simulated(intact(embedded()), Scan())
    assert measurement.noise_of(Scan(noise_db=20.0)) == pytest.approx(0.1 * measurement.rms)
    assert measurement.noise_of(Scan(noise_db=20.0, averages=4)) == pytest.approx(
        0.05 * measurement.rms
    )
    white = Scan(noise_density=1e-6)  # white up to half of 50 * 80 Hz
    assert measurement.noise_of(white) == pytest.approx(1e-6 * np.sqrt(2000.0))
    added = measurement.noisy(0.3, seed=4).field - measurement.field
    assert np.std(added) == pytest.approx(0.3, rel=0.02)


def test_the_thinner_lamina_is_measured() -> None:
    assert surface_of(embedded(), None) == "upper"
    assert surface_of(embedded(), "lower") == "lower"


def test_a_light_damping_takes_long_to_settle() -> None:
    periods = settling_periods(embedded())
    D = {"lamina.lower.damping_ratio": 0.01, "lamina.upper.damping_ratio": 0.01}
    assert settling_periods(embedded(**D)) == pytest.approx(periods / 2, abs=1)


@pytest.mark.parametrize(
    ("scan", "text"),
    [
        (Scan(spacing=0.2), r"at least 5 points on the length 0.4 m"),
        (Scan(spacing=0.0), r"at least 5 points"),
        (Scan(lamina="middle"), r"expected one of lower, upper, given 'middle'"),
        (Scan(sampling_rate=300.0), r"at least 5 samples per period of 80 Hz, given 300 Hz"),
    ],
)
def test_scans_that_are_refused(scan: Scan, text: str) -> None:
    with pytest.raises(CaseError, match=text):
        simulated(embedded(), scan)


def test_a_swept_excitation_is_refused() -> None:
    sweep = {
        "excitation.kind": "sweep",
        "excitation.start_frequency": 10.0,
        "excitation.end_frequency": 20.0,
        "excitation.duration": 1.0,
    }
    with pytest.raises(CaseError, match="harmonic excitation"):
        simulated(preset("embedded", sweep), Scan())


def test_the_points_of_a_scan() -> None:
    np.testing.assert_allclose(scan_positions(0.4, 0.1), [0.0, 0.1, 0.2, 0.3, 0.4])
    assert scan_positions(0.4, 0.01, 0.005)[-1] == pytest.approx(0.395)
