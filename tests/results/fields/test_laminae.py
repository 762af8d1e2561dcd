"""Fields that follow from the dataset, beside what is known of the motion and of real runs."""

import numpy as np
import pytest
from stack import STRIKES, three_laminae
from synthetic import AMPLITUDES, FRAMES, NODES, PERIODS, WINDOW, small_case, synthetic_history

import delam_fem as df
from delam_fem.results.fields import laminae
from delam_fem.results.fields.pictures import CORNERS, Ribbons


def test_curvature_of_a_parabola_is_constant_and_goes_with_the_moment() -> None:
    case = small_case()
    history = synthetic_history(case)
    curvature = laminae.curvature(history)
    rigidity = np.array([lamina.flexural_rigidity for lamina in case.lamina])
    expected = history["moment"].to_numpy() / rigidity[:, None, None]
    np.testing.assert_allclose(curvature, expected, atol=1e-12)
    assert np.abs(curvature).max() > 0.04


def test_strain_stretches_the_outer_face_of_a_bend() -> None:
    """A lamina bent towards +y is compressed on its face +y: -h/2 u''."""
    case = small_case()
    history = synthetic_history(case)
    strain = Ribbons.of(history, case).point_data(3)["strain"].reshape(2, NODES, CORNERS)
    curvature = laminae.curvature(history)[:, 3]
    assert curvature[0, 2] > 0.0
    for i, lamina in enumerate(case.lamina):
        expected = -lamina.thickness / 2.0 * curvature[i]
        np.testing.assert_allclose(strain[i, :, 1], expected, rtol=1e-12)
        np.testing.assert_array_equal(strain[i, :, 0], -strain[i, :, 1])
        np.testing.assert_array_equal(strain[i, :, 3], strain[i, :, 0])


def test_impulses_stand_at_the_first_frame_that_does_not_precede_them() -> None:
    case = small_case()
    history = synthetic_history(case)
    impulses = laminae.scalars_of(history, case)["impulse"]
    np.testing.assert_array_equal(impulses[0], impulses[1])
    at_tip = np.flatnonzero(impulses[0, :, -1])
    half = FRAMES // 2 - 1  # strikes at half of each period of the window, exactly at a frame
    assert at_tip.tolist() == [half + k * FRAMES for k in range(WINDOW)]
    np.testing.assert_allclose(impulses[0, at_tip, -1], 1e-3 * np.arange(1, WINDOW + 1))
    # the weaker ones follow 0.1 ms later
    assert np.flatnonzero(impulses[0, :, -2]).tolist() == (at_tip + 1).tolist()
    assert history["frame"].to_numpy()[half] == pytest.approx(
        (PERIODS - WINDOW + 0.5) * case.period
    )
    assert impulses.sum() == pytest.approx(2.0 * history["event_impulse"].to_numpy().sum())


def test_a_lamina_between_two_others_has_both_impulses_and_the_smaller_gap() -> None:
    recorded = three_laminae()
    history = recorded.history()
    scalars = laminae.scalars_of(history, recorded.case)
    impulse, gap = scalars["impulse"], scalars["gap"]
    np.testing.assert_array_equal(impulse[1], impulse[0] + impulse[2])
    assert impulse[0].any() and impulse[2].any() and len(STRIKES) == 2
    np.testing.assert_array_equal(gap[1], np.minimum(gap[0], gap[2]))
    assert not np.array_equal(gap[0], gap[2])


def test_gap_is_positive_where_the_laminae_are_apart() -> None:
    case = small_case()
    history = synthetic_history(case)
    gap = laminae.scalars_of(history, case)["gap"]
    u = history["displacement"].to_numpy()
    np.testing.assert_allclose(gap[0], history["gap0"].to_numpy() + u[1] - u[0])
    assert gap.max() > 0.030 > AMPLITUDES.max()


@pytest.mark.parametrize("law", ["newton-penalty", "penalty"])
def test_contact_forces_store_the_spring_energy_of_the_ledger(law: str) -> None:
    """Half the sum of F^2 / k over the pairs is the energy that the ledger counts by itself."""
    keys = {
        "contact.law": law, "contact.penalty_stiffness": 5000.0, "time.periods": 3,
        "output.window_periods": 3, "excitation.frequency": 5.0, "gap.tip": 1e-4,
        "output.fields_per_period": 1, "time.steps_per_period": 400,
    }  # fmt: skip
    result = df.run(df.preset("paper", keys), "compiled")
    force = laminae.contact_force_of_laminae(result.history, result.case)
    np.testing.assert_array_equal(force[0], force[1])
    stored = 0.5 * (force[0] ** 2).sum(axis=-1) / 5000.0
    expected = result.history["energy_spring"].to_numpy()
    assert expected.max() > 1e-9
    np.testing.assert_allclose(stored, expected, rtol=1e-9, atol=1e-15)
    assert force.max() > -force.min()  # compression is positive


def test_laws_without_springs_have_no_contact_force() -> None:
    case = small_case(contact__law="newton")
    history = synthetic_history(case)
    assert (history["contact_state"].to_numpy() == 2).any()
    assert not laminae.contact_force_of_laminae(history, case).any()
    soft = small_case(contact__law="penalty", contact__penalty_damping=2.0)
    u, v = (history[name].to_numpy() for name in ("displacement", "velocity"))
    gap = history["gap0"].to_numpy() + u[1] - u[0]
    expected = -100.0 * gap - 2.0 * (v[1] - v[0])
    forces = laminae.contact_force_of_laminae(history, soft)[0]
    resting = history["contact_state"].to_numpy() == 2
    np.testing.assert_allclose(forces[resting], expected[resting])
    assert not forces[~resting].any()


def test_springs_inside_the_elements_carry_their_share() -> None:
    keys = {"contact.points_per_element": 2, "contact.law": "penalty", "mesh.elements": 5}
    keys |= {"time.periods": 2, "output.window_periods": 1}
    case = df.preset("paper", keys)
    history = df.run(case, "compiled").history
    state = history["contact_state"].to_numpy() == 2
    scalars = laminae.scalars_of(history, case)
    gap, force = scalars["gap"][0], scalars["contact_force"][0]
    assert history["spring_share"].to_numpy() == pytest.approx([0.0] + [0.5] * 9 + [0.25])
    expected = -case.contact.penalty_stiffness * 0.5 * gap
    expected[:, -1] *= 0.5
    assert state.any() and force[state] == pytest.approx(expected[state])
