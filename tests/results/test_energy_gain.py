"""What a run says of impacts that add energy."""

from __future__ import annotations

import logging
from types import SimpleNamespace

import numpy as np
import pytest

from delam_fem.api import LEDGER, Case, Result, assemble, preset, run
from delam_fem.results.diagnostics import ROUND_OFF, gain_warning, may_add_energy

LITERAL = preset("paper", {"contact.law": "newton"})
SETTLED = {"contact.law": "newton", "damping.rayleigh": "mass", "output.fields_per_period": 0}


def kept(gains: list[float], losses: list[float]) -> SimpleNamespace:
    """Stand for a recorder by what single instants added and by what periods lost."""
    ledger = np.zeros((len(losses), len(LEDGER)))
    ledger[:, LEDGER.index("impact_loss")] = losses
    impulse = np.column_stack([np.ones((len(gains), 2)), gains])
    return SimpleNamespace(n_closed=len(gains), impulse=impulse, ledger=ledger)


def said(case: Case, gains: list[float], losses: list[float]) -> str | None:
    return gain_warning(kept(gains, losses), may_add=may_add_energy(case))  # type: ignore[arg-type]


def test_dissipative_impacts_are_not_mentioned() -> None:
    assert said(LITERAL, [0.0, 0.0], [1e-3, 1e-3]) is None
    assert said(LITERAL, [0.0, 0.0], [0.0, 0.0]) is None
    assert said(LITERAL, [0.0, 0.5 * ROUND_OFF], [1.0, 1.0]) is None


def test_single_gains_are_told_with_remedy() -> None:
    text = said(LITERAL, [1e-5, 0.0], [9.9e-4, 1e-3])
    assert text is not None
    assert text.startswith("impacts added 1e-05 J to the motion, 0.5 % of what they took; try")
    assert 'contact.impulse = "consistent" or time.mass = "lumped"' in text


def test_gaining_periods_are_counted() -> None:
    text = said(LITERAL, [0.5, 3.0, 4.0], [0.1, -1.0, -2.0])
    assert text is not None
    assert "in 2 periods they added more than they took" in text


def test_parting_pairs_of_moreau_count_by_periods() -> None:
    moreau = preset("default", {"contact.law": "newton@moreau-jean"})
    assert said(moreau, [1e-5, 1e-5], [1e-3, 1e-3]) is None
    text = said(moreau, [1e-5, 2e-3], [1e-3, -1e-3])
    assert text is not None
    assert text.endswith("try more steps per period")


def test_a_diverged_period_does_not_hide_the_gain() -> None:
    text = said(LITERAL, [1.0, np.nan], [-0.5, np.nan])
    assert text is not None
    assert "added 1 J" in text


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({}, True),
        ({"time.mass": "lumped"}, False),
        ({"contact.impulse": "consistent"}, False),
        ({"contact.law": "newton-penalty"}, True),
        ({"contact.law": "newton@moreau-jean"}, False),
        ({"contact.law": "penalty"}, False),
    ],
)
def test_who_may_add_energy(keys: dict[str, object], expected: bool) -> None:
    assert may_add_energy(LITERAL.with_overrides(keys)) is expected


def computed(**keys: object) -> Result:
    case = preset("paper", {**SETTLED, "time.periods": 60, **keys})
    return run(case, "compiled", structure=assemble(case, needs_dolfinx=False))


def test_literal_scheme_warns_in_summary_and_log(caplog: pytest.LogCaptureFixture) -> None:
    """Mass damping, 20 elements: from about the 35th period on impacts pump energy in."""
    with caplog.at_level(logging.WARNING, logger="delam_fem.pipeline"):
        summary = computed().summary
    (text,) = summary["warnings"]
    assert text in caplog.text
    assert "periods they added more than they took" in text
    assert summary["impact_energy_gain"] > 1e-3


@pytest.mark.parametrize(
    "keys", [{"contact.impulse": "consistent"}, {"time.mass": "lumped"}], ids=["impulse", "mass"]
)
def test_dissipative_schemes_do_not_warn(keys: dict[str, object]) -> None:
    result = computed(**keys)
    assert result.history.sizes["event"] > 30
    assert result.summary["warnings"] == []
    lost = float(result.history.energy_impact_loss.sum())
    assert result.summary["impact_energy_gain"] < ROUND_OFF * lost


@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.9])
def test_gains_of_moreau_jean_are_those_of_pairs_that_part(restitution: float) -> None:
    """An impulse p changes the energy by p (1 - e) U̇/2, U̇ before it: it gains if the pair parts."""
    case = preset(
        "paper",
        {**SETTLED, "time.scheme": "moreau-jean", "contact.restitution": restitution,
         "time.periods": 6, "time.steps_per_period": 500, "output.window_periods": 6},
    )  # fmt: skip
    result = run(case, structure=assemble(case, needs_dolfinx=False))
    events = result.history
    impulses, rates = events["event_impulse"].values, events["event_velocity_before"].values
    wanted = 0.5 * (1.0 - restitution) * impulses * rates
    assert (impulses > 0.0).all() and (wanted < 0.0).any()
    np.testing.assert_allclose(events["event_energy"], wanted, atol=1e-9 * np.abs(wanted).max())
    gained = wanted[rates > 0.0].sum()
    assert result.summary["impact_energy_gain"] <= gained * (1.0 + 1e-9)
