"""Beams whose nodes have no mass: masses, motion beside a plain one, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from support import covering, invoke

import delam_fem as df
from delam_fem.api import Case, assemble, lowest, motion_of, reduce, session_of
from delam_fem.contact.complementarity import solve
from delam_fem.engines.session import ENGINES
from delam_fem.model.beams import closed_form
from delam_fem.studies.detection.detect import Scan, simulated
from delam_fem.studies.detection.modulation import pump_of

MASSLESS: dict[str, Any] = {
    "time.mass": "massless", "contact.law": "newton", "contact.restitution": 0.0,
    "damping.rayleigh": "stiffness",
}  # fmt: skip


def beams(preset: str = "default", **overrides: object) -> Case:
    """Return a preset with nodes without mass; in names of overrides `__` stands for a dot."""
    return df.preset(
        preset, MASSLESS | {k.replace("__", "."): value for k, value in overrides.items()}
    )


@pytest.mark.parametrize("is_tied", [False, True])
@pytest.mark.parametrize("n", [4, 5, 12])
def test_masses_at_middles_keep_total_centre_and_moment_of_inertia(n: int, is_tied: bool) -> None:
    h = 1.0 + 0.3 * np.sin(np.arange(n))
    element_masses, ends = 2.0 * h, np.concatenate([[0.0], np.cumsum(h)])
    masses, x = (
        closed_form.middle_masses(element_masses, h, is_tied=is_tied),
        0.5 * (ends[1:] + ends[:-1]),
    )
    for power in range(3):
        moment = 2.0 * ends[-1] ** (power + 1) / (power + 1)
        assert masses @ x**power == pytest.approx(moment, rel=1e-12)
    assert np.count_nonzero(masses) == n - is_tied
    assert masses.min() >= 0.0


def test_lengths_that_differ_much_are_refused() -> None:
    with pytest.raises(df.CaseError, match="mesh: "):
        closed_form.middle_masses(np.array([9.0, 1.0, 1.0]), np.array([9.0, 1.0, 1.0]))


def test_frequencies_converge_at_order_four() -> None:
    errors = []
    for n in (20, 40):
        case, dofs = beams(mesh__elements=n), slice(0, 2 * n)
        o = assemble(case, needs_dolfinx=False).operators
        frequencies, _ = lowest(o.stiffness[dofs, dofs], o.mass[dofs, dofs], 3)
        exact = case.lamina[0].angular_frequencies(3) / (2.0 * np.pi)
        errors.append(np.abs(frequencies / exact - 1.0))
    assert errors[1].max() < 1.5e-5
    assert (np.log2(errors[0] / errors[1]) > 3.4).all()


@pytest.mark.parametrize("preset", ["default", "edge", "embedded"])
def test_every_node_may_touch(preset: str) -> None:
    case = beams(preset, mesh__elements=20)
    o = assemble(case, needs_dolfinx=False).operators
    reduced = reduce(o, case.n_modes)
    assert o.n_dofs - reduced.n_modes >= o.n_pairs
    W = reduced.compliance.sum(axis=0)
    scale = 1.0 / np.sqrt(W.diagonal())
    assert np.linalg.eigvalsh(scale[:, None] * W * scale)[0] > 1e-3
    # nothing is lost: modes and what has no mass are the static flexibility
    H = o.gap_matrix.toarray()
    flexibility = H @ np.linalg.solve(o.stiffness.toarray(), H.T)
    G = reduced.gap_modes
    np.testing.assert_allclose(
        W + (G / reduced.squares) @ G.T, flexibility, atol=1e-8 * flexibility.max()
    )


def test_it_moves_as_small_implicit_steps_of_all_dofs() -> None:
    """Positions that are complementary to forces, by implicit Euler, which knows no modes."""
    n, steps = 5, 4000
    case = beams(
        mesh__elements=n, time__periods=1, time__refine=16, output__window_periods=1,
        excitation__amplitude=0.012, gap__tip=0.004,
    )  # fmt: skip
    result = df.run(case)
    o, h = assemble(case, needs_dolfinx=False).operators, case.period / steps
    M, C, K, H = (A.toarray() for A in (o.mass, o.damping, o.stiffness, o.gap_matrix))
    inverse = np.linalg.inv(M + h * C + h * h * K)
    push, table = inverse @ H.T, motion_of(case.with_overrides({"time.steps_per_period": steps}))(0)
    u, v, tips = np.zeros(o.n_dofs), np.zeros(o.n_dofs), []
    touched = 0
    for q, rate, second in table[1:]:
        drive = o.base.mass * second + o.base.damping * rate + o.base.stiffness * q
        v = inverse @ (M @ v - h * (K @ u + drive))
        gap = o.gap0 + H @ (u + h * v)
        if gap.min() < 0.0:
            touched += 1
            v = v + push @ solve(h * (H @ push), gap)
        u = u + h * v
        tips.append(o.probes @ u)
    expected = np.array(tips)[steps // 1000 - 1 :: steps // 1000].T
    assert touched > 20
    massless_tips = result.history["tip_displacement"].to_numpy()
    np.testing.assert_allclose(massless_tips, expected, atol=0.01 * np.abs(expected).max())
    assert result.summary["energy_residual"] < 1e-9
    assert result.summary["minimum_tip_gap"] > -1e-9


def test_two_tones_are_computed_without_mass_at_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    """The run of two tones reads `time.mass`; it took all dofs and their consistent mass before."""
    asked_modes: list[int | None] = []

    def stopped(*_: object, modes: int | None = None, **__: object) -> None:
        asked_modes.append(modes)
        raise InterruptedError

    monkeypatch.setattr("delam_fem.studies.detection.detect.session", stopped)
    case = beams("embedded", mesh__elements=10)
    with pytest.raises(InterruptedError):
        simulated(case, Scan(periods=1), pump=pump_of(case, 20.0, 1e-4))
    assert asked_modes == [case.n_modes]


KINDS = ("beam", "modes", "plane-stress", "solid")
LAWS = ("none", "newton", "newton-penalty", "penalty")
SCHEMES = ("newmark", "moreau-jean", "central-difference")


@pytest.mark.parametrize(
    ("kind", "law", "scheme", "engine", "restitution", "points", "preset"),
    covering(KINDS, LAWS, SCHEMES, ENGINES, (0.0, 0.5), (1, 2), ("default", "edge", "embedded")),
)
def test_every_combination_runs_or_has_one_message(
    kind: str, law: str, scheme: str, engine: Any, restitution: float, points: int, preset: str
) -> None:
    keys = {
        "model.kind": kind, "contact.law": law, "time.scheme": scheme,
        "contact.restitution": restitution, "contact.points_per_element": points,
        "mesh.elements": 20, "time.steps_per_period": 20, "time.periods": 1,
        "output.window_periods": 1, "output.fields_per_period": 0,
        "damping.rayleigh": "two-mode", "time.mass": "massless",
    }  # fmt: skip
    if kind == "modes":
        keys["model.modes"] = 4
    is_rigid = law == "none" or (law == "newton" and not restitution)
    goes = kind in KINDS[:2] and is_rigid and (kind == "modes" or points == 1)
    # two points per element are as many as the dofs of a lamina, and 4 modes take some of those
    follows = law == "none" or points == 1 or preset == "edge"
    try:
        case = df.preset(preset, keys)
    except df.CaseError as error:
        named = ("time.mass: expected", "contact.law: ", "contact.points_per_element: expected 1")
        assert sum(word in str(error) for word in named) == 1
        assert not goes or "contact.law: expected one of" in str(error) or "scheme" in str(error)
        return
    assert goes
    operators = assemble(case, needs_dolfinx=False).operators
    if not follows:
        with pytest.raises(df.CaseError, match="cannot follow all"):
            reduce(operators, case.n_modes)
        return
    with session_of(case, operators, engine=engine) as opened:
        assert opened.run() == "completed"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("compare", "default"), "time.mass: compare: expected"),
        (("reduce", "default"), "time.mass: reduce: expected"),
        (("compare", "default", "--models", "beam,modes"), "time.mass: reduce: expected"),
        (("converge", "default", "--in", "points"), "contact.points_per_element: "),
        (("converge", "default", "--laws", "penalty@newmark"), "contact.law: "),
    ],
)
def test_commands_that_need_mass_say_so(words: tuple[str, ...], message: str) -> None:
    keys = [word for key, value in MASSLESS.items() for word in ("--set", f"{key}={value}")]
    result = invoke(*words, *keys, "-o", "/nowhere/at/all")
    assert result.exit_code == 2
    assert message in " ".join(result.output.split())


def test_impactors_run_on_springs_and_are_refused_without() -> None:
    case = beams(mesh__elements=6, time__steps_per_period=60, time__periods=1,
                 output__window_periods=1)  # fmt: skip
    data: dict[str, Any] = case.model_dump(exclude_unset=True)
    ball = {"lamina": "thin", "mass": 0.01, "gap": 1e-4, "spring": 50.0}
    assert df.run(Case(**data | {"impactor": [ball]})).summary["energy_residual"] < 1e-9
    with pytest.raises(df.CaseError, match="support: "):
        Case(**data | {"impactor": [ball | {"spring": 0.0}]})


@pytest.mark.nightly
@pytest.mark.parametrize(("elements", "expected"), [(20, -19.30), (40, -18.84)])
def test_at_resonance_it_is_near_restitution_and_twelve_modes(
    elements: int, expected: float
) -> None:
    """Limits with stiffness damping of docs/evidence/massless.md."""
    case = beams(mesh__elements=elements, time__refine=256, time__periods=120)
    lows = 1e3 * df.run(case).history["envelope_min"][0, -20:]
    assert float(lows.mean()) == pytest.approx(expected, abs=0.05)
