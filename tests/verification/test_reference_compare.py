"""The dolfinx/PETSc path and the independent reference give the same matrices and motion."""

import pytest

from delam_fem import compare
from delam_fem.api import preset

MATRICES = 1e-12  # relative: quadrature is exact, so round-off of a few hundred terms
FREQUENCIES = 1e-9  # relative: round-off of the matrices times their condition number
TIPS = 1e-8  # m over 3 periods; seen 1e-12, impacts amplify round-off
FIRST_IMPACTS = 1e-11  # m up to the 20th impact; seen 3e-14

pytest.importorskip("dolfinx")


@pytest.mark.slow
@pytest.mark.parametrize("impulse", ["lumped", "consistent"])
@pytest.mark.parametrize("law", ["newton", "newton-penalty"])
def test_both_paths_agree(law: str, impulse: str) -> None:
    case = preset("paper", {"contact.law": law, "contact.impulse": impulse})
    comparison = compare(case, impacts=20, periods=3)
    assert max(comparison.matrices.values()) < MATRICES
    assert comparison.frequencies < FREQUENCIES
    motion = comparison.motion
    assert motion is not None
    assert motion.impact_limit == 20
    assert motion.until_impact < FIRST_IMPACTS
    assert motion.overall < TIPS
    assert motion.impacts[0] == motion.impacts[1] > 100
    assert abs(motion.values).max() > 5e-3  # they do move


def test_both_paths_agree_without_contact() -> None:
    motion = compare(preset("paper", {"contact.law": "none"}), periods=2).motion
    assert motion is not None
    assert motion.impacts == (0, 0)
    assert motion.overall < FIRST_IMPACTS
