"""Laminae of a stack that are bonded everywhere have an interface, without gaps or contacts."""

from __future__ import annotations

import numpy as np
import pytest

import delam_fem as df
from delam_fem.api import Case, diagnostics

OPENING = 1e-5
"""Gap at rest in the middle of the delamination [m]."""


def stack(kind: str, open_place: tuple[str, str]) -> Case:
    """Return a stack of three strips with one delamination."""
    strip = {"length": 0.3, "width": 0.02, "thickness": 1e-3, "density": 2700.0,
             "young_modulus": 70e9, "damping_ratio": 0.01}  # fmt: skip
    return df.Case(
        name="stack",
        lamina=[strip | {"name": name} for name in ("low", "middle", "top")],
        model={"kind": kind},
        mesh={"elements": 12},
        delamination=[{"between": open_place, "start": 0.1, "end": 0.2, "opening": OPENING}],
        excitation={"kind": "harmonic", "amplitude": 5e-4, "frequency": 40.0},
        contact={"law": "penalty", "penalty_stiffness": 2e3},
        time={"steps_per_period": 100, "periods": 1},
        output={"window_periods": 1, "fields_per_period": 4},
    )


@pytest.mark.parametrize("kind", ["beam", "plane-stress"])
@pytest.mark.parametrize("open_place", [("low", "middle"), ("middle", "top")])
def test_the_gap_of_a_stack_is_that_of_its_delamination(
    kind: str, open_place: tuple[str, str]
) -> None:
    case = stack(kind, open_place)
    number = ("low", "middle").index(open_place[0])
    result = df.run(case)
    history, summary = result.history, result.summary
    assert [entry["name"] for entry in summary["contacts"]] == ["low-middle", "middle-top"]
    gap0 = history["gap0"].to_numpy()
    assert gap0[number].max() == pytest.approx(OPENING) and not gap0[1 - number].any()
    q = history["tip_displacement"].to_numpy()
    gap = OPENING + q[number + 1] - q[number]
    assert summary["minimum_tip_gap"] == pytest.approx(gap.min())
    assert np.count_nonzero(gap <= 0.0) and np.count_nonzero(gap > 0.0)
    contacts = diagnostics.count_contacts(gap <= 0.0, diagnostics.GROUP_PERIODS * 100)
    assert summary["tip_contacts_per_period"] == pytest.approx(contacts, rel=0.05)
    bonded = summary["contacts"][1 - number]
    assert not bonded["impulse"] and not bonded["strikes_per_period"]
