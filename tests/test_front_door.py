"""What a user writes before reading the documentation works, or says what to write."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import delam_fem as df

SHORT = {
    "time.periods": 2, "time.steps_per_period": 200, "mesh.elements": 4,
    "output.window_periods": 2, "output.fields_per_period": 0,
}  # fmt: skip
UNIT = sp.identity(2, format="csr")
NONE = df.BaseCoupling.none(2)
NO_PAIRS = sp.csr_matrix((0, 2))
BASE = df.BaseCoupling(np.zeros(2), np.zeros(2), np.array([-1.0, -1.0]))
LAMINA = {
    "length": 0.2, "width": 0.02, "thickness": 1e-3, "density": 2700.0, "young_modulus": 7e10,
    "damping_ratio": 0.01,
}  # fmt: skip


def pair(**more: Any) -> df.Operators:
    """Return two oscillators on a shaking base; the second, half as stiff, strikes the first."""
    stiffness = sp.diags([1.0, 0.5], format="csr")
    gap = sp.csr_matrix([[-1.0, 1.0]])
    return df.Operators(UNIT, 0.1 * UNIT, stiffness, BASE, gap, np.array([1e-3]), **more)


def solve(operators: df.Operators, **keys: Any) -> df.Solution:
    keys = {"steps_per_period": 100, "periods": 3} | keys
    return df.solve(operators, "newton", "moreau-jean", df.HarmonicMotion(0.2, 1.0), **keys)


def test_a_case_may_be_named(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(df.preset("paper", SHORT).to_toml())
    by_name, by_case = df.run(file), df.run(df.load_case(file))
    assert by_name.history.tip_displacement.equals(by_case.history.tip_displacement)
    assert df.modes("paper", 2).frequencies.shape == (2, 2)


def test_the_last_part_of_a_key_suffices() -> None:
    case = df.preset("default", {"time.periods": 7}, frequency=3.3, restitution=0.4)
    assert (case.excitation.top_frequency, case.contact.restitution) == (3.3, 0.4)
    assert case.n_periods == 7
    assert case.with_overrides(tip="2 mm").gap.tip == 2e-3  # type: ignore[union-attr]


def test_a_case_is_written_in_python() -> None:
    case = df.Case(
        name="mine",
        lamina=[{"name": "a", **LAMINA}, {"name": "b", **LAMINA}],
        gap={"tip": 1e-3},
        mesh={"elements": 10},
        excitation={"kind": "harmonic", "frequency": 12.0, "amplitude": 1e-3},
        contact={"law": "newton", "restitution": 0.5},
    )
    assert case.length == 0.2
    assert case.with_overrides({"lamina.a.thickness": 2e-3}).lamina[0].thickness == 2e-3


def test_a_sweep_is_a_case_and_values(tmp_path: Path) -> None:
    case = df.preset("default", SHORT)
    sweep = df.Sweep(case, {"excitation.frequency": np.array([3.2, 3.4])}, record={"strobes": 2})
    data = df.run_sweep(sweep, tmp_path / "sweep", "serial")
    assert data.frequency.values.tolist() == [3.2, 3.4]
    alone = df.run(sweep.case(1), "compiled").summary["tip_max"]
    assert data.tip_max.sel(frequency=3.4).values == pytest.approx(alone, rel=1e-9)


def test_a_ladder_of_elements(tmp_path: Path) -> None:
    case = df.preset("default", SHORT)
    law = "newton@moreau-jean"
    found = df.converge(
        case, tmp_path, laws=[law], elements=[2, 4], limit_steps=0, periods=2, workers=1
    )
    assert {rung.mesh for rung in found.ladder.rungs()} == {2, 4}


def test_operators_run_until_a_time() -> None:
    found = solve(
        pair(probes=UNIT), steps_per_period=None, periods=None, time_step=0.01, until=20.0
    )
    assert 20.0 <= found.time[-1] < 20.2
    history = found.history
    assert history.displacement.shape == (2, history.sizes["time"])
    assert history.displacement.attrs["units"] == "m"
    assert history.sizes["event"] > 0
    assert float(history.event_impulse.min()) >= 0.0
    gap = 1e-3 + history.displacement[1] - history.displacement[0]
    assert float(gap.min()) < 1e-3
    whole = solve(pair(probes=UNIT), periods=None, until=14.9)
    assert whole.time[-1] == pytest.approx(15.0)


def test_missing_probes_are_named() -> None:
    found = solve(pair())
    with pytest.raises(df.CaseError, match="operators: probes: missing"):
        print(found.displacement)


BAD: dict[str, Callable[[], object]] = {
    "law: expected one of none, newton,": lambda: df.Law("newtn"),  # type: ignore[arg-type]
    "impulse: expected one of lumped": lambda: df.Law("newton", impulse="x"),  # type: ignore[arg-type]
    "restitution: expected a number from 0 to 1, given 1.5": lambda: df.Law("newton", 1.5),
    "restitution: expected a number from 0 to 1, given nan": lambda: df.Law("newton", np.nan),
    "penalty_stiffness: .* given -1": lambda: df.Law("penalty", penalty_stiffness=-1.0),
    "scheme: expected one of newmark": lambda: df.Scheme("newmrk"),  # type: ignore[arg-type]
    "theta: expected a number from 0.5 to 1, given 0.2": lambda: df.Scheme(theta=0.2),
    r"state.motion: .* given \(2, 2\)": lambda: df.State(np.zeros((2, 2)), np.zeros(0, bool)),
    "state.resting: .* given 'float64'": lambda: df.State(np.zeros((3, 2)), np.zeros(0)),  # type: ignore[arg-type]
    "frequency: expected a number above 0": lambda: df.HarmonicMotion(-1.0, 1.0),
    "amplitude: expected a finite number": lambda: df.HarmonicMotion(1.0, np.nan),
    "mass: expected a sparse matrix, given ndarray": lambda: df.Operators(
        np.eye(2),
        UNIT,
        UNIT,
        NONE,
        NO_PAIRS,
        np.zeros(0),  # type: ignore[arg-type]
    ),
    "mass: expected a diagonal without negative": lambda: df.Operators(
        -UNIT, UNIT, UNIT, NONE, NO_PAIRS, np.zeros(0)
    ),
    "stiffness: expected finite numbers": lambda: df.Operators(
        UNIT, UNIT, np.nan * UNIT, NONE, NO_PAIRS, np.zeros(0)
    ),
    r"initial.motion: expected the shape \(3, 2\), given \(3, 5\)": lambda: solve(
        pair(), initial=df.State(np.zeros((3, 5)), np.zeros(1, bool))
    ),
    "time_step: expected a number above 0": lambda: solve(pair(), time_step=-1.0),
    "periods: expected a whole number from 1, given 0": lambda: solve(pair(), periods=0),
    "until: expected a number above 0": lambda: solve(pair(), periods=None, until=-1.0),
    "expected either periods or until": lambda: solve(pair(), until=1.0),
    "steps_per_period: missing": lambda: solve(pair(), steps_per_period=None),
    "write df.solve": lambda: df.run(pair()),  # type: ignore[arg-type]
    "neither a file nor a preset": lambda: df.run("nothing"),
    "run: expected a case, .* given 7": lambda: df.run(7),  # type: ignore[arg-type]
    "case: 5 problems": lambda: df.Case(),
    "did you mean frequency": lambda: df.preset("default", fequency=1.0),
    r'write {"section.key"': lambda: df.preset("default", blubb=1.0),
    'say which: {"lamina.thick.thickness"': lambda: df.preset("default", thickness=1e-3),
    "excitation.freq: unknown key": lambda: df.Sweep("default", {"excitation.freq": [1.0]}),
    "axis.1.key: expected a key": lambda: df.Sweep("default", {"frequency": [1.0]}),
}


@pytest.mark.parametrize("message", BAD)
def test_what_is_wrong_is_named(message: str) -> None:
    with pytest.raises(df.CaseError, match=message):
        BAD[message]()
