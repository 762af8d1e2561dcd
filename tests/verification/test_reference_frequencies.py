"""Natural frequencies of the closed-form elements converge at order 4 to the exact cantilever's."""

import numpy as np
import pytest

from delam_fem.api import assemble, preset
from delam_fem.model.beams import closed_form
from delam_fem.studies.modes.frequencies import modes_of

ORDER, WINDOW = 4.0, 0.2
FINEST = {1: 5e-7, 2: 2e-5, 3: 2e-4}  # relative error at 16 elements, graded mesh included
COUNTS = (4, 8, 16)  # at 32, round-off of K (about 1e-9) would already show in mode 1


@pytest.mark.parametrize("power", [1.0, 1.3], ids=["uniform", "graded"])
def test_order_four(power: float) -> None:
    case = preset("paper")
    errors = []
    for n in COUNTS:
        x = 0.685 * np.linspace(0.0, 1.0, n + 1) ** power
        x[-1] = 0.685
        errors.append(modes_of(closed_form.assemble(case, x=x), case, 3).relative_differences)
    for k in range(3):
        for i in range(2):
            e = np.array([error[i, k] for error in errors])
            assert np.all(e > 0.0)  # conforming elements bound the frequencies from above
            assert np.log2(e[-2] / e[-1]) == pytest.approx(ORDER, abs=WINDOW)
            assert e[-1] < FINEST[k + 1]


def test_first_frequency_at_twenty_elements() -> None:
    case = preset("paper", {"mesh.elements": 20})
    result = modes_of(assemble(case, needs_dolfinx=False), case, 1)
    assert np.abs(result.relative_differences).max() < 1e-5
