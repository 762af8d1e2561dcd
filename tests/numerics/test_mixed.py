"""Functions of numbers in full: series of every length, on both sides of each threshold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import golden
import numpy as np
import pytest

from delam_fem.numerics import beams, harmonics, settling, statistics

Check = Callable[..., None]


def waves(*shape: int) -> np.ndarray:
    """Return numbers without a pattern."""
    return np.cos(np.arange(np.prod(shape)) ** 1.3 + 0.2).reshape(shape)


def strobes(kind: str, n: int) -> np.ndarray:
    """Return displacements and velocities of two probes, in half amplitudes, (2, 2, n)."""
    t = np.arange(1.0, n + 1.0)
    x = np.array([0.3 + 0.0 * t, -0.5 + 0.0 * t])
    scatter = 1.0 if "scatter" in kind else 0.3
    x = x + scatter * 0.01 * np.array([waves(n), 0.83 * waves(n)[::-1]])
    if "decay" in kind:
        x = x + np.array([0.8, 0.4])[:, None] * np.exp(-0.06 * t)
    if "beat" in kind:
        x = x + 0.7 * np.exp(-0.05 * t) * np.sin(1.9 * t + np.array([[0.0], [0.6]]))
    for period in (2, 3, 4, 8):
        if f"of {period}" in kind:
            x = x + 0.2 * np.cos(2.0 * np.pi * t / period + np.array([[0.0], [0.9]]))
    if "wander" in kind:
        x = x + 0.4 * np.sin(0.9 * t**1.1)
    if "twice" in kind:
        x = x + 0.03 * (-1.0) ** (np.arange(n) // 2)
    return np.stack([x, 0.7 * x + 0.02 * waves(2, n)])


KINDS = ("rest", "decay", "beat", "beat scatter", "of 2", "of 3 decay", "of 4 beat", "of 8",
         "wander", "of 2 twice", "scatter")  # fmt: skip


def test_verdicts_are_the_stored_ones(stored: Check) -> None:
    found: dict[str, Any] = {}
    for kind in KINDS:
        for n in (19, 40, 81):
            for P in (1, 2, 3, None):
                for d in (0.0, 0.004, 0.017, 0.06, 0.3) if n == 81 else (0.06,):
                    key = f"{kind} {n} {P} {d:g}"
                    found[key] = settling.judge(strobes(kind, n), P, d, is_linear=False)
        found[f"{kind} linear"] = settling.judge(strobes(kind, 60), 2, 0.05, is_linear=True)
    found["infinite"] = settling.judge(np.full((2, 2, 30), np.inf), 1, 0.1, is_linear=False)
    found["nan"] = settling.judge(strobes("decay", 30), 1, float("nan"), is_linear=False)
    lines = []
    for key, own in found.items():
        numbers = [own.transient, own.uncertainty, own.scatter, own.allowed, own.decay,
                   own.observed_decay]  # fmt: skip
        told = f"{own.word} {own.periodicity} {own.periods_judged} {own.periods_needed}"
        lines.append(f"{key}: {told}; {golden.numbers(numbers)}")
    stored("\n".join(lines))


def test_parts_of_verdicts_are_the_stored_ones(stored: Check) -> None:
    z = strobes("of 3 decay", 50)
    rest = settling._creeping(z, 3, 0.02)[2]
    found = {
        "creeping": list(settling._creeping(z, 3, 0.02)),
        "one": list(settling._creeping(z, 1, 4.0)),
        "growth": [settling._growth(0.1, 7), settling._growth(60.0, 5)],
        "memory": settling._memory(rest), "none": settling._memory(0.0 * rest),
        "decaying": settling._decaying(rest, 0.07), "beating": list(settling._beating(rest, 0.05)),
        "beat": list(settling._beating(strobes("beat", 60) - 0.2, 0.05)),
        "observed": [settling._observed(z, 1), settling._observed(z, 3)],
        "repeats": [settling._repeats(z, rest, 3), settling._repeats(z, 0.01 * rest, 3),
                    settling._repeats(z, 0.01 * rest, 1)],
        "multiple": [settling._multiple(strobes(f"of {k}", 64)[0], P)
                     for k in (2, 3, 4, 8) for P in (1, 2, 3, 4)],
        "short": [settling._multiple(strobes("of 8", n)[0], 4) for n in (15, 16, 18, 40)],
        "needed": [settling._needed(7.0, 0.2), settling._needed(7.0, 0.0)],
    }  # fmt: skip
    stored(golden.of_object(found))


def test_kinds_and_attractors_are_the_stored_ones(stored: Check) -> None:
    n = 70
    names = ("rest", "of 2", "wander", "scatter", "beat", "of 3 decay", "of 8", "of 4 beat")
    points = np.stack([strobes(name, n)[0] for name in names]).reshape(2, 4, 2, n)
    outcome = np.array([["completed"] * 4, ["completed", "diverged", "failed", "completed"]])
    P = np.array([[1.0, 2.0, np.nan, np.nan], [np.nan, np.nan, np.nan, 4.0]])
    decided = np.array([[True, True, True, False], [True, True, True, True]])
    settled = np.array([[True, True, True, True], [False, True, True, True]])
    low, high = points.min(axis=-1), points.max(axis=-1)
    many = np.repeat(points, 2, axis=1)
    many[0, 1] += 0.11 * (high - low).max() / 2.0
    many[1, 2, 0, 3] = np.nan
    sizes = many.min(axis=-1), many.max(axis=-1)
    found = settling.attractors(np.repeat(P, 2, axis=1), *sizes, many)
    told = {
        "kinds": settling.kinds_of_motion(outcome, P, points, decided, settled),
        "all": settling.kinds_of_motion(outcome, P, points),
        "share": settling.line_share(points), "constant": settling.line_share(np.ones((1, 64))),
        "missing": settling.line_share(np.full((1, 64), np.nan)), "attractors": found,
        "isolated": settling.is_isolated(found.number) * 1,
        "map": settling.is_isolated(np.array([[0, 0, 1], [2, 1, 1], [3, -1, 4]])) * 1,
    }  # fmt: skip
    with pytest.raises(ValueError, match="at least 64 strobes") as raised:
        settling.kinds_of_motion(outcome, P, points[..., :63])
    stored("\n".join([golden.of_object(told), str(raised.value)]))


def test_limits_are_the_stored_ones(stored: Check) -> None:
    h = np.array([0.5, 0.31, 0.17, 0.1, 0.04])
    sequences = {
        "first": 2.0 + 3.0 * h, "second": -1.0 + 0.7 * h**2 + 0.01 * h**3, "slow": 1.0 + h**0.15,
        "mixed": 1.0 + h + 9.0 * h**3, "back": 1.0 + h * np.array([1.0, -1.0, 1.0, 1.0, 1.0]),
        "equal": np.ones(5), "nan": np.array([1.0, 2.0, np.nan, 1.0, 3.0]), "fast": h**7.9,
    }  # fmt: skip
    found: dict[str, Any] = {}
    for name, values in sequences.items():
        found[f"{name} orders"] = statistics.observed_orders(h, values)
        found[f"{name} errors"] = statistics.orders_of_errors(h, values - 1.0)
        for error in (None, 1e-3, 0.03, 0.5):
            errors = None if error is None else error * np.array([1.0, 2.0, 0.5, 1.5, 0.7])
            found[f"{name} {error}"] = statistics.limit(h, values, errors)
        found[f"{name} few"] = statistics.limit(h[:3], values[:3])
        found[f"{name} two"] = statistics.observed_orders(h[:2], values[:2])
    stored(golden.of_object(found))


def test_intervals_are_the_stored_ones(stored: Check) -> None:
    values = waves(3, 47)
    found: dict[str, Any] = {"means": statistics.block_means(values)}
    found["four"] = statistics.block_means(values, 4)
    found["few"] = statistics.block_means(values[:, :3])
    for confidence in (0.95, 0.5):
        found[f"{confidence}"] = list(statistics.interval(values[:, :7], confidence))
    found["by default"] = list(statistics.interval(values[:, :5]))
    found["one"] = list(statistics.interval(values[:, :1]))
    stored(golden.of_object(found))


def test_posteriors_are_the_stored_ones(stored: Check) -> None:
    bounds = np.array([[0.2, 1.4], [-3.0, 5.0]])
    parameters = statistics.uniform(bounds, 160, 3)
    share = (parameters - bounds[:, 0]) / np.diff(bounds, axis=1).ravel()
    noise = np.random.default_rng(7).standard_normal((160, 5))
    columns = np.column_stack([share[:, 0], share @ [0.3, 2.0], share[:, 1] ** 2, 0.0 * share[:, 0],
                               np.sin(3.0 * share[:, 0])])  # fmt: skip
    table = statistics.Table(parameters, columns + [0.05, 0.1, 0.2, 0.0, 0.1] * noise, bounds)
    found: dict[str, Any] = {"parameters": parameters}
    for index in (11, 87):
        seen = table.statistics[index]
        for accepted in (None, 0.9):
            own = (
                table.posterior(seen) if accepted is None
                else table.posterior(seen, accepted=accepted)
            )  # fmt: skip
            found[f"{index} {accepted}"] = {
                "n": own.samples.shape, "samples": own.samples, "weights": own.weights,
                "median": own.quantile(0.5), "low": own.quantile(0.1), "all": own.interval(),
                "some": own.interval(0.6), "correlation": own.correlation(),
            }  # fmt: skip
        found[f"misfit {index}"] = list(table.misfit(seen))
    for k in range(5):
        off = table.statistics[20] + 0.6 * (np.arange(5) == k)
        found[f"misfit of {k}"] = list(table.misfit(off))
    few = np.arange(0, 160, 20)
    found["coverage"] = table.coverage(few)
    found["of half"] = table.coverage(few, 0.5, accepted=0.7)
    lines = [golden.of_object(found)]
    for broken in (replace(table, parameters=parameters[:99]), table):
        with pytest.raises(ValueError, match="inference: expected") as raised:
            broken.posterior(np.full(5, np.nan if broken is table else 0.3))
        lines.append(str(raised.value))
    stored("\n".join(lines))


def test_beams_are_the_stored_ones(stored: Check) -> None:
    xi = np.array([0.0, 0.11, 0.43, 0.7, 1.0])
    struck = beams.StruckBeam(3.7, 0.9, 0.0031)
    t = np.array([1e-5, 2e-4, 3e-3])
    f = np.array([12.0, 340.0, 9000.0])
    force = np.exp(-(((np.arange(30) - 9.0) / 4.0) ** 2))
    given = {"length": 0.7, "flexural_rigidity": 2.3, "mass_per_length": 0.4}
    omega = np.array([3.0, 41.0, 260.0])
    found: dict[str, Any] = {
        "roots": beams.cantilever_roots(6),
        "modes": [beams.cantilever_mode(k, xi) for k in (1, 2, 3, 13)],
        "rise": [beams.frequency_rise(a) for a in (0.0, 0.1, 0.37)],
        "H": beams.transmissibility(omega, **given),
        "damped": beams.transmissibility(omega, **given, rayleigh=(0.7, 3e-4)),
        "kappa": [struck.kappa, struck.impedance, struck.contact_time(4e3)],
        "speeds": [struck.group_speed(f), struck.timoshenko_group_speed(f)],
        "others": struck.timoshenko_group_speed(f, shear_factor=0.7, poisson=0.1),
        "rigid": struck.rigid_impulse(t, 1.3), "stiffness": struck.stiffness_for(2e-4),
        "spring": struck.spring_force(t, 1.3, 4e3), "strain": struck.strain(force, 2e-5, 0.04),
        "far": struck.strain(force, 1e-5, 0.11),
        "unit": beams.unit_force([0.0, 0.3, 2.0, 5.0, 9.0]),
        "end": beams.peak_end(),
    }  # fmt: skip
    lines = [golden.of_object(found)]
    for call in (
        lambda: beams.cantilever_roots(0), lambda: beams.cantilever_mode(0, xi),
        lambda: beams.cantilever_mode(1, 1.01), lambda: beams.cantilever_mode(1, [-0.01, 0.5]),
    ):  # fmt: skip
        with pytest.raises(ValueError, match="cantilever mode") as raised:
            call()
        lines.append(str(raised.value))
    stored("\n".join(lines))


def test_harmonics_are_the_stored_ones(stored: Check) -> None:
    values = waves(2, 24) + 0.4
    A = harmonics.harmonic_amplitudes(values, 3)
    root = harmonics.pole(7.0, 0.13)
    time = 0.4 + 0.01 * np.arange(60)
    found: dict[str, Any] = {
        "spectrum": harmonics.amplitude_spectrum(values),
        "odd": harmonics.amplitude_spectrum(values[:, :23]), "A": A,
        "phases": harmonics.harmonic_phases(values, 3),
        "one": harmonics.harmonic_amplitudes(values, 1),
        "many": harmonics.harmonic_amplitudes(values, 12),
        "thd": harmonics.total_harmonic_distortion(A), "d": harmonics.distortion_factor(A),
        "zero": harmonics.distortion_factor(np.array([[0.0, 1.0], [2.0, 0.0]])),
        "nothing": harmonics.total_harmonic_distortion(np.zeros((2, 0))),
        "pole": root, "driven": harmonics.driven(time, lambda at: np.sin(9.0 * at), root),
        "coefficients": [harmonics.coefficients(0.03, 5.0, 31.0),
                         harmonics.coefficients(0.03, 5.0, 31.0, "stiffness"),
                         harmonics.coefficients(0.03, 5.0, 31.0, "mass")],
        "overdamped": [harmonics.overdamped_from(alpha, 0.2) for alpha in (0.3, 5.0, 6.0)],
        "never": str(harmonics.overdamped_from(1.0, 0.0)),
    }  # fmt: skip
    lines = [golden.of_object(found)]
    for n in (0, 5, -2):
        with pytest.raises(ValueError, match="whole number of samples") as raised:
            harmonics.harmonic_amplitudes(values, n)
        lines.append(str(raised.value))
    stored("\n".join(lines))


def test_a_share_of_many_simulations_is_accepted(stored: Check) -> None:
    bounds = np.array([[0.0, 2.0]])
    parameters = statistics.uniform(bounds, 1500, 1)
    table = statistics.Table(parameters, parameters + 0.1 * waves(1500, 1), bounds)
    found = table.posterior(np.array([0.7]))
    assert len(found.samples) == round(0.08 * 1500)
    assert len(table.posterior(np.array([0.7]), accepted=0.2).samples) == 300
    covered = [table.coverage(np.arange(40), level)[0] for level in (0.9, 0.3)]
    assert covered[0] > covered[1]
    stored(golden.of_object([found.quantile(0.5)[0], found.weights.max(), *covered]))
