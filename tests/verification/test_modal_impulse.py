"""The impulse on the first mode, which `converge` shows, and the sum of impulses."""

from __future__ import annotations

import numpy as np
import pytest

from delam_fem.api import assemble, openings, preset, session_of
from delam_fem.studies.convergence.level import row_of


def test_the_work_of_impulses_on_the_first_mode_has_a_limit_and_their_sum_has_none() -> None:
    """Contact near the clamp, where pairs hardly move: any split of a push among them is as good.

    Σ p φ₁ is what the first mode gets of it, 0.343 mN s a period with 20 to 240 points.
    """
    entries = []
    for p in (1, 4, 8):
        keys = {"excitation.frequency": 1.25, "time.refine": 16, "time.refine_velocity": 0.0}
        more = {"contact.points_per_element": p, "time.periods": 60, "output.window_periods": 10}
        case = preset("default", keys | more | {"output.fields_per_period": 0})
        structure = assemble(case, needs_dolfinx=False)
        opening = openings(case, structure)
        assert opening[-1] == pytest.approx(1.0) and (opening[1:] > opening[:-1]).all()
        with session_of(case, structure.operators) as opened:
            opened.run()
            jumps = [record.jumps.columns() for record in opened.recorder.window]
            modal = row_of(opened.recorder, 2, opening)["modal_impulse"]
        assert modal == jumps[-1].impulses @ opening[jumps[-1].hit]
        of_mode = np.mean([jump.impulses @ opening[jump.hit] for jump in jumps])
        entries.append((of_mode, np.mean([jump.impulses.sum() for jump in jumps])))
    (first, single), *finer = entries
    assert first == pytest.approx(3.43e-4, rel=0.02)  # 3.43 after 60 periods
    for (of_mode, total), grown in zip(finer, (1.3, 2.0), strict=True):
        assert of_mode == pytest.approx(first, rel=0.01)
        assert total > grown * single
