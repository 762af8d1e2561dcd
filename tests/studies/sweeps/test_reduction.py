"""Rows of a sweep from the record of three laminae: the same numbers as from its dataset."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import stack
from stack import three_laminae
from synthetic import WINDOW

from delam_fem.api import N_BASE, Structure, diagnostics
from delam_fem.studies.sweeps.grid import Record
from delam_fem.studies.sweeps.point import VARIABLES, probe_motion, quantities, row_of

RECORD = Record(
    strobes=3, harmonics=2, node_distortion=True, energies=True, lyapunov=4, summary=True
)


def test_the_motion_of_a_record_is_that_of_its_dataset() -> None:
    recorded = three_laminae()
    motion = probe_motion(recorder := recorded.recorder, recorded.structure)
    expected = diagnostics.ProbeMotion.of(recorded.history())
    for name in ("displacement", "strobe", "gap_at_rest", "is_hit"):
        np.testing.assert_array_equal(getattr(motion, name), getattr(expected, name), name)
    assert motion.n_impacts == expected.n_impacts == 3 * WINDOW
    assert motion.is_hit.sum(axis=1).tolist() == [WINDOW, WINDOW]
    assert motion.strobe.shape == (3, recorder.n_closed)


def test_an_interface_without_a_pair_at_the_probes_is_never_hit_there() -> None:
    recorded = three_laminae()
    layout, o = recorded.structure.layout, recorded.structure.operators
    lower, upper = layout.interfaces
    inner = replace(upper, places=upper.places[:2])
    fewer = replace(
        o, gap0=o.gap0[:7], gap_matrix=o.gap_matrix[:7], pair_weights=None
    )  # five pairs below, two above
    structure = Structure(fewer, replace(layout, interfaces=(lower, inner)))
    motion = probe_motion(recorded.recorder, structure)
    assert motion.is_hit.sum(axis=1).tolist() == [WINDOW, 0]
    assert motion.gap_at_rest == pytest.approx([stack.GAPS[0], np.nan], nan_ok=True)
    assert motion.gap.min() == motion.gaps[0].min()


def test_a_row_of_three_laminae() -> None:
    recorded = three_laminae()
    wanted = quantities(RECORD, recorded.structure.layout)
    assert {quantity.name for quantity in wanted} <= set(VARIABLES)
    extra = {"lyapunov_exponent": -1.5}
    row = row_of(wanted, recorded.case, recorded.recorder, recorded.structure, extra)
    values, start = {}, 0
    for quantity in wanted:
        values[quantity.name] = row[start : start + quantity.size].reshape(quantity.shape)
        start += quantity.size
    assert start == row.size
    summary = diagnostics.summary(recorded.history(), recorded.case)
    for name in ("tip_min", "tip_max", "thd", "minimum_tip_gap", "tip_contacts_per_period"):
        np.testing.assert_array_equal(values[name], summary[name], name)
    np.testing.assert_array_equal(
        values["strobe_displacement"], recorded.history()["strobe_displacement"][:, -3:]
    )
    np.testing.assert_allclose(values["harmonic_amplitude"][:, 0], stack.AMPLITUDES, rtol=1e-12)
    np.testing.assert_allclose(values["harmonic_phase"][:, 0], stack.PHASES, atol=1e-12)
    assert values["node_thd"].shape == (3, 6)
    assert values["energy_base_work"] == pytest.approx(3e-3)
    assert values["lyapunov_exponent"] == -1.5


def test_the_amplitude_of_a_tip_is_half_its_range_wherever_it_swings() -> None:
    recorded = three_laminae()
    offsets = np.array([0.050, -0.030, 0.007])
    for record in recorded.recorder.window:
        record.u[:, N_BASE : N_BASE + 3] += offsets
    wanted = quantities(Record(summary=True), recorded.structure.layout)
    row = row_of(wanted, recorded.case, recorded.recorder, recorded.structure, {})
    ends = np.cumsum([quantity.size for quantity in wanted])
    values = dict(zip((q.name for q in wanted), np.split(row, ends[:-1]), strict=True))
    np.testing.assert_allclose(values["tip_amplitude"], stack.AMPLITUDES, rtol=1e-3)  # of samples
    np.testing.assert_allclose(values["tip_max"], offsets + stack.AMPLITUDES, rtol=1e-3)
    np.testing.assert_allclose(
        values["tip_amplitude"], (values["tip_max"] - values["tip_min"]) / 2.0, rtol=1e-14
    )
