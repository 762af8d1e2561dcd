"""Resonances, and what is inferred from made-up motions, in full; no two numbers are alike."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import golden
import numpy as np
import pytest
from calibration.resonance import Rig, tip
from mixed import apart, bonded

from delam_fem.case.definition import Case
from delam_fem.case.excitation import SweptMotion
from delam_fem.case.files import preset
from delam_fem.numerics.statistics import Posterior
from delam_fem.studies.identification import identify as module
from delam_fem.studies.identification.identify import (
    Experiment,
    Identification,
    Unknown,
    drawn,
    invariant,
    mismatch,
    of_history,
    of_rig,
    value_of,
)
from delam_fem.studies.identification.resonance import Found, Resonance, _exact, fit
from delam_fem.system.errors import CaseError

Check = Callable[..., None]
EVERY = ("frequency", "frequency_error", "damping_ratio", "damping_error", "participation", "peak",
         "residual", "late", "late_error", "clock", "clock_error")  # fmt: skip


def waves(*shape: int) -> np.ndarray:
    """Return numbers without a pattern."""
    return np.cos(np.arange(np.prod(shape)) ** 1.3 + 0.2).reshape(shape)


def resonance(name: str) -> Resonance:
    """Return the fit of a record of 90 s, of a mode of 1.5 Hz, which begins late, or else."""
    up = SweptMotion(1.1, 2.1, 90.0, 0.0025)
    motion = SweptMotion(2.1, 1.1, 90.0, 0.0025) if name == "down" else up
    rig = Rig(second=0.3 if name == "second" else 0.0, clock=1.004 if name == "clock" else 1.0)
    late = 0.7 if name in ("late", "second") else 0.0
    t = np.arange(0.0, 89.0 / rig.clock, 0.025)
    if name == "uneven":
        t = t + 0.006 * np.sin(t)
    x = tip(motion, 1.5, 0.011, rig, late + rig.clock * t)
    x = x + 3e-5 * np.random.default_rng(3).standard_normal(t.size)
    early = 1.3 if name == "early" else 0.0
    return fit(t + early, x, motion)


@pytest.mark.parametrize("name", ["late", "early", "clock", "second", "down", "uneven"])
def test_resonances_are_the_stored_ones(name: str, stored: Check) -> None:
    one = resonance(name)
    told = {key: getattr(one, key) for key in EVERY} | {"remarks": list(one.remarks)}
    told |= {"cycles": one.cycles, "n": one.cycles.shape[1]}
    exact = _exact(one, 0.013, 1.02)
    told |= {"exact": [exact.frequency, exact.damping_ratio, exact.damping_error]}
    stored(golden.of_object(told))


def test_a_report_of_resonances_is_the_stored_one(stored: Check) -> None:
    case = preset("paper")
    cycles = np.array([np.linspace(1.0, 2.0, 9), 3.0 + waves(9), 3.0 + 0.9 * waves(9)])
    own = Resonance(1.44, 2e-4, 0.0083, 3e-5, 1.57, 1.46, 0.012, 0.31, 0.002, 1.002, 3e-5,
                    ("one thing", "another"), cycles)  # fmt: skip
    other = Resonance(0.71, 3e-4, 0.0071, 2e-5, 1.55, 0.74, 0.02, 0.1, 0.004, 0.999, 2e-5, (),
                      cycles[:, ::-1])  # fmt: skip
    stored(golden.of_finding(Found(case, (own, other)).report))


def experiment(**more: object) -> Experiment:
    """Return an experiment with three unknowns at two frequencies."""
    unknowns = (
        Unknown("lamina.*.damping_ratio", 0.003, 0.05), Unknown("gap.exponent", 1.0, 3.0),
        Unknown("contact.restitution", 0.1, 0.9),
    )  # fmt: skip
    doubts = (Unknown("lamina.*.young_modulus", 0.9, 1.1, True), Unknown("gap.tip", 1e-3, 3e-3))
    case = apart(contact={"law": "newton", "restitution": 0.35}, stop=[], impactor=[], sensor=[])
    return Experiment(case, (1.25, 3.5), unknowns, 2e-4, uncertain=doubts, **more)  # type: ignore[arg-type]


def test_unknowns_are_the_stored_ones(stored: Check) -> None:
    own, case, lines = experiment(), preset("paper"), []
    for text in (
        "gap.exponent=1:3", "lamina.thin.width=0.9x:1.1x", "lamina.*.damping_ratio=1e-3:0.1",
        "a=3:1", "a=1:1", "=1:2", "a=1x:2", "a=1", "a", "a=1:2:3", "a=x:y", "a=0.5:",
    ):  # fmt: skip
        try:
            found = Unknown.parse(text)
            lines.append(f"{text}: {found} {found.keys(case)}")
        except CaseError as error:
            lines.append(str(error))
    rigs: dict[str, Case] = {
        "apart": own.case, "paper": case, "bonded": bonded(),
        "free": bonded(support=[{"start": "pinned", "end": "pinned"}],
                       delamination=bonded().delamination[:1]),
    }  # fmt: skip
    told = {name: [repr(one) for one in of_rig(of)] for name, of in rigs.items()}
    keys = ("gap.tip", "lamina.low.thickness", "lamina.high.thickness", "gap.nothing", "name",
            "contact.restitution", "lamina.mid.damping_ratio", "gap")  # fmt: skip
    values = {key: value_of(own.case, key) for key in keys}
    columns = drawn(own.uncertain, own.case, 7, 4)
    with pytest.raises(CaseError) as raised:
        drawn([Unknown("gap.tip", 0.0, 1.0)], own.case, 3, 1)
    lines += [str(raised.value)]
    with pytest.raises(CaseError) as raised:
        Experiment(own.case, (1.0,), own.uncertain, 1e-4)
    lines += [str(raised.value), golden.of_object(told), golden.of_object(values, "value")]
    stored("\n".join([*lines, golden.of_object(columns, "drawn")]))


def test_motions_and_their_statistics_are_the_stored_ones(stored: Check) -> None:
    f = 1.7
    time = 0.4 + 0.011 * np.arange(400)
    tips = sum(
        np.array([[1.0 / k], [0.3 / k**2]]) * np.sin(2.0 * np.pi * k * f * time + 0.3 * k)
        for k in range(1, 9)
    )
    tips = tips + 0.01 * np.random.default_rng(3).standard_normal(tips.shape) + 0.2
    harmonics, scatter = of_history(time, tips, f)
    short, of_short = of_history(time[::7], tips[:, ::7], f)
    told = {"harmonics": harmonics, "scatter": scatter, "short": short, "of short": of_short}
    told["invariant"] = invariant(harmonics)
    told["many"] = invariant(waves(3, 2, 5) + 1j * waves(5, 2, 3).T.reshape(3, 2, 5))
    told["noisy"] = module.noisy(harmonics, 0.3, np.random.default_rng(2))
    lines = []
    for n, step in ((43, 1), (44, 1), (100, 1), (110, 1)):
        try:
            lines.append(golden.of_object(of_history(time[:n:step], tips[:, :n:step], f)[1]))
        except CaseError as error:
            lines.append(str(error))
    own = experiment(n_samples=300)
    told |= {"error": [own.error, experiment().error], "truth": own.truth, "bounds": own.bounds}
    stored("\n".join([golden.of_object(told), *lines]))


def test_tables_of_simulations_are_the_stored_ones(stored: Check) -> None:
    own, n = experiment(), 150
    rng = np.random.default_rng(5)
    low, high = own.bounds.T
    parameters = low + (high - low) * rng.uniform(size=(n, 3))
    base = 1e-3 * (waves(1, 2, 2, 5) + 1.5j * waves(5, 2, 2, 1).T)
    change = np.tensordot(parameters / high, waves(3, 2, 2, 5) + 0.4j, axes=(1, 0))
    harmonics = base * (1.0 + 0.5 * change)
    harmonics[11] = np.nan
    finer = harmonics[:20] * (1.0 + 0.01 * waves(20, 2, 2, 5))
    finer[3] = np.nan
    lines = []
    for name, more in (("alone", None), ("finer", finer), ("lost", finer * np.nan)):
        table = own.table(harmonics, parameters, 6, more)
        lines.append(golden.of_object([table.parameters, table.statistics], name))
    observed = table.statistics[7]
    posterior = table.posterior(observed)
    told = {
        "median": posterior.quantile(0.5), "interval": posterior.interval(0.8),
        "alike": mismatch(own, table, observed),
        "unlike": [mismatch(own, table, observed + 0.1 * (np.arange(38) == k))
                   for k in (0, 4, 5, 9, 10, 13, 14, 18, 19, 29, 37)],
    }  # fmt: skip
    with pytest.raises(CaseError) as raised:
        own.table(
            np.where(np.arange(n)[:, None, None, None] < 60, harmonics, np.nan), parameters, 1
        )
    stored("\n".join([*lines, golden.of_object(told), str(raised.value)]))


def test_reports_are_the_stored_ones(stored: Check, tmp_path: Path) -> None:
    own, n = experiment(), 60
    low, high = own.bounds.T
    samples = low + (high - low) * (0.5 + 0.4 * waves(n, 3))
    samples[:, 1] = 1.0 + 40.0 * samples[:, 0] + 0.1 * waves(n)
    weights = (1.5 + waves(n)) / (1.5 + waves(n)).sum()
    found = Identification(
        own, Posterior(samples, weights), np.array([0.91, 0.83, 1.0]), 77, True, 141
    )
    measured = Identification(own, Posterior(samples, weights), None, 0, False, 99, "Unlike.")
    stored(golden.of_finding(found.report))
    stored(golden.of_finding(measured.report), ".measured")
