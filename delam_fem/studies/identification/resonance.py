"""Identify the first mode of each lamina from a stepped or a swept sine.

A sweep that rises passes the resonance before the amplitude has grown, so its peak comes late; one
that falls is late on the other side. This biases the frequency that is read off the peak. The fit
compares the record with the response of one mode to the same sweep, so that the bias is gone:

    x(t) = g z(u) + r z''(u) + Γ w(t) + Re(c e^{λt}) + m,   u = t - a - b (t - t_m)/T          (R1)

z is the displacement of the base, w the response of the mode to z'' + α z' (`driven`), r the
quasi-static part of higher modes, λ the pole of the mode, c what still vibrates from before, m a
constant. a and b say when the record began and how fast its clock runs; t_m is the middle of the
record and T its length. α is the damping by mass: it acts against what rests, so that the base
pushes by it, too. Without it the phases would be late or early by up to α/ω² = 2 D/ω.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from delam_fem.api import (
    BoolArray,
    Case,
    CaseError,
    Finding,
    FloatArray,
    Lamina,
    Report,
    RunContext,
    SweepExcitation,
    SweptMotion,
    Table,
    assemble,
    beams,
    first_mode,
    harmonics,
    of_references,
    session_of,
    statistics,
    style,
    swept_motion,
)
from delam_fem.studies.identification.identify import measured_histories
from delam_fem.studies.identification.study import Resonance as Options
from delam_fem.studies.linear import first_frequencies
from delam_fem.studies.sweeps.point import probe_motion

FIRST_DAMPING = (0.001, 0.003, 0.01, 0.03, 0.1)
FIRST_SHIFTS = (0.0, 0.3, 0.6, 0.9)
"""Damping ratios, and distances of the peak from the natural frequency over the root of the sweep
rate in Hz/s (0.86 without damping), of which the best begins the fit."""
BAND = 0.3
"""Only frequencies within this share of the peak are fitted: the first mode alone is meant."""
FEWEST = 8
"""Smallest number of cycles that can be fitted, and of samples in a cycle."""
MOST_SAMPLES = 200
"""Largest number of samples in the shortest period; of more samples some are left out."""
EVEN = 1e-3
"""Largest relative difference of steps that are equal."""
LEAST_DAMPING, MOST_DAMPING = 1e-5, 0.5
LINEAR = 6
"""Number of unknowns that (R1) is linear in."""
BLOCKS = 8
"""Number of parts of a record, with equal information on the frequency, each left out once."""
SCATTERED = 2.0
"""Variance of fits without a part over that of a white noise, which exceeds it in 5 % (F test)."""
SIGNIFICANT = 3.0
"""Standard errors from which on a remark names a late start or a wrong clock."""
SAME_CLOCK = 5e-5
"""Relative difference of clocks that is not worth a sentence."""
NOT_NOISE, NOTHING_LEFT = 1.05, 1e-4
"""Residual from which on a remark names it: over the noise of a sample, and over the peak."""


@dataclass(frozen=True)
class ResonanceFit:
    """Natural frequency and damping of a mode; two of their standard errors contain 95 %.

    Attributes:
        frequency, frequency_error: undamped natural frequency and its error [Hz].
        damping_ratio, damping_error: D and its error [-].
        participation: Γ of the point, 1.566 at the tip of a uniform cantilever [-].
        peak: frequency with the largest amplitude, as one reads it off [Hz].
        residual: rms of the differences over the largest displacement [-].
        late, late_error: time by which the record begins after the sweep, and its error [s].
        clock, clock_error: seconds of the sweep in one of the record, and its error [-].
        remarks: sentences on how the record differs from its description.
        cycles: of each cycle of the base, for a figure: its frequency [Hz], the amplitude of the
            absolute displacement over that of the base, and the same of the fit (R1), NaN beyond
            the band that was fitted [-], shape (3, k).
    """

    frequency: float
    frequency_error: float
    damping_ratio: float
    damping_error: float
    participation: float
    peak: float
    residual: float
    late: float
    late_error: float
    clock: float
    clock_error: float
    remarks: tuple[str, ...]
    cycles: FloatArray = field(repr=False)

    def bending_stiffness(self, lamina: Lamina) -> tuple[float, float]:
        """Return EI of a uniform cantilever with this frequency, and its standard error [N m2].

        EI = ρA (2π f L² / B₁²)²
        """
        B = float(beams.cantilever_roots(1)[0])
        rotation = 2.0 * math.pi * self.frequency * lamina.length**2 / B**2
        EI = lamina.mass_per_length * rotation**2
        return EI, 2.0 * EI * self.frequency_error / self.frequency


@dataclass(frozen=True)
class _Cycles:
    """Cycles of a sweep by the clock of a record.

    Attributes:
        edges: number of the first sample of each cycle, and the end, shape (k + 1,).
        turn: e^{-iφ} of the samples up to that end, with the phase φ of the base.
        time: middle of each cycle, shape (k,) [s].
        frequency: frequency of the base there, shape (k,) [Hz].
    """

    edges: npt.NDArray[np.intp]
    turn: beams.ComplexArray
    time: FloatArray
    frequency: FloatArray

    @classmethod
    def of(cls, time: FloatArray, motion: SweptMotion) -> _Cycles:
        """Return the cycles of a record.

        Raises:
            CaseError: there are too few cycles, or too few samples in one of them.
        """
        turns = motion.turns(time)
        edges = np.searchsorted(turns, np.arange(math.ceil(turns[0]), math.floor(turns[-1]) + 1))
        if edges.size <= FEWEST or np.diff(edges).min() < FEWEST:
            raise CaseError(
                f"swept sine: expected at least {FEWEST} cycles with {FEWEST} samples or more, "
                f"given {edges.size - 1} with {np.diff(edges).min() if edges.size > 1 else 0}"
            )
        middle = 0.5 * (time[edges[:-1]] + time[edges[1:] - 1])
        turn = np.exp(-2j * math.pi * turns[: edges[-1]])
        return cls(edges, turn, middle, motion.instantaneous_frequency(middle))

    def amplitudes(self, values: FloatArray) -> beams.ComplexArray:
        """Return the complex amplitude of each cycle, shape (k,)."""
        sums = np.add.reduceat(values[: self.turn.size] * self.turn, self.edges[:-1])
        return np.asarray(2j * sums / np.diff(self.edges))


@dataclass(frozen=True)
class _Band:
    """The part of a record in which the base passes the resonance.

    Attributes:
        time: equidistant times, shape (n,) [s].
        displacement: absolute displacement, shape (n,) [m].
        motion: motion of the base.
        by_mass: α of (R1) [1/s].
    """

    time: FloatArray
    displacement: FloatArray
    motion: SweptMotion
    by_mass: float = 0.0

    def on_sweep(self, at: FloatArray, delays: FloatArray) -> FloatArray:
        """Return u of (R1) at given times for the delays a and b [s]."""
        t = self.time
        share = (at - 0.5 * (t[0] + t[-1])) / (t[-1] - t[0])
        return np.asarray(at - delays[0] - delays[1] * share)

    def explained(self, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return x(t) of (R1) for p = (frequency [Hz], D, a [s], b [s]), and its best weights.

        These are g, Γ, r, Re c, -Im c and m: (R1) is linear in them.
        """
        t = self.time
        root = harmonics.pole(2.0 * math.pi * p[0], p[1])
        base = self.motion.states(self.on_sweep(t, p[2:]))

        def push(at: FloatArray) -> FloatArray:
            return _push(self.motion.states(self.on_sweep(at, p[2:])), self.by_mass)

        y = harmonics.driven(t, push, root)
        free = np.exp(root * (t - t[0]))
        columns = np.stack(
            [base[:, 0], 2.0 * y.real, base[:, 2], free.real, free.imag, np.ones_like(t)]
        )
        size = abs(columns).max(axis=1)
        solution = np.linalg.lstsq((columns / size[:, None]).T, self.displacement, rcond=None)[0]
        return (solution / size) @ columns, solution / size


def _push(states: FloatArray, by_mass: float) -> FloatArray:
    """Return z'' + α z' of states (z, z', z'') of the base, shape (n,) [m/s2]."""
    return np.asarray(states[:, 2] + by_mass * states[:, 1])


def fit(
    time: FloatArray, displacement: FloatArray, motion: SweptMotion, *, by_mass: float = 0.0
) -> ResonanceFit:
    """Fit natural frequency, damping ratio, participation, start and clock to a record.

    Args:
        time: times since the sweep began, by the clock of the record, shape (n,) [s].
        displacement: absolute displacement of the point, shape (n,) [m].
        motion: motion of the base.
        by_mass: α of (R1), the damping by mass over the mass [1/s].

    Raises:
        CaseError: there are fewer than `FEWEST` cycles near the peak, or samples in a cycle.
    """
    time, displacement = _even(time, displacement, motion)
    cycles = _Cycles.of(time, motion)
    a = cycles.amplitudes(displacement)
    peak = float(cycles.frequency[np.argmax(abs(a))])
    near = abs(cycles.frequency - peak) <= BAND * peak
    if np.count_nonzero(near) < FEWEST:
        raise CaseError(
            f"resonance: expected at least {FEWEST} cycles within {100 * BAND:.0f} % of the "
            f"peak at {peak:g} Hz, given {np.count_nonzero(near)}"
        )
    first, last = np.flatnonzero(near)[[0, -1]]
    samples = slice(cycles.edges[first], cycles.edges[last + 1])
    band = _Band(time[samples], displacement[samples], motion, by_mass)
    start, m = _by_amplitudes(time, cycles, a, near, band)
    phase = np.angle(a[near] / m)
    to_peak = np.argmax(abs(a[near])) + 1  # later it beats
    delays = [np.zeros(2)] + [
        _by_phases(band, cycles.time[near][:n], np.unwrap(phase[:n]))
        for n in (to_peak, phase.size)
        if n > FEWEST
    ]
    scale = [start[0] * start[1], start[1], *[0.1 / peak] * 2]
    ends = []
    for q in delays:
        solution = least_squares(
            lambda p: band.explained(p)[0] - band.displacement, [*start, *q], x_scale=scale,
            bounds=([0.0, LEAST_DAMPING, *[-np.inf] * 2], [np.inf, MOST_DAMPING, *[np.inf] * 2]),
        )  # fmt: skip
        ends.append(solution)
        if np.std(solution.fun) < NOT_NOISE * statistics.white_noise(solution.fun):
            break
    solution = min(ends, key=lambda end: float(end.cost))
    model, weights = band.explained(solution.x)
    covariance = _covariance(solution.jac, solution.fun)
    fitted = np.full(near.size, np.nan)
    curve = np.zeros_like(time)
    curve[samples] = model
    fitted[first : last + 1] = abs(cycles.amplitudes(curve))[first : last + 1] / motion.amplitude
    response = np.array([cycles.frequency, abs(a) / motion.amplitude, fitted])
    return _judged(band, solution.x, covariance, solution.fun, weights, peak, response)


def _even(
    time: FloatArray, displacement: FloatArray, motion: SweptMotion
) -> tuple[FloatArray, FloatArray]:
    """Return a record from the start of the sweep on, with equal steps and no more than needed."""
    step = np.diff(time)
    if np.ptp(step) > EVEN * step.mean():
        even = np.linspace(time[0], time[-1], time.size)
        time, displacement = even, CubicSpline(time, displacement)(even)
    highest = max(motion.start_frequency, motion.end_frequency)
    stride = max(1, int(1.0 / (MOST_SAMPLES * highest * step.mean())))
    return time[time >= 0.0][::stride], displacement[time >= 0.0][::stride]


def _by_amplitudes(
    time: FloatArray, cycles: _Cycles, a: beams.ComplexArray, near: BoolArray, band: _Band
) -> tuple[FloatArray, beams.ComplexArray]:
    """Return frequency [Hz] and D by the sizes of the cycles, and the amplitudes that follow.

    The size of a cycle hardly depends on when the record begins. Only the cycles `near` are fitted.
    """
    measured, motion, size = a[near], band.motion, band.motion.amplitude

    def of_mode(p: FloatArray) -> beams.ComplexArray:
        root = harmonics.pole(2.0 * math.pi * p[0], p[1])
        y = harmonics.driven(time, lambda at: _push(motion.states(at), band.by_mass), root)
        return cycles.amplitudes(2.0 * y.real)[near]

    def away(p: FloatArray) -> FloatArray:
        return np.asarray(abs(size + p[2] * of_mode(p)) - abs(measured))

    top = int(np.argmax(abs(a)))
    peak = cycles.frequency[top]
    passing = np.gradient(cycles.frequency, cycles.time)[top]
    starts = []
    for late, D in product(FIRST_SHIFTS, FIRST_DAMPING):
        p = np.array([peak - late * np.sign(passing) * math.sqrt(abs(passing)), D, 1.0])
        p[2] = abs(measured).max() / abs(of_mode(p)).max()
        starts.append(p)
    start = min(starts, key=lambda p: float(np.sum(away(p) ** 2)))
    solution = least_squares(
        away, start, x_scale=[peak * start[1], start[1], 1.0],
        bounds=([0.0, LEAST_DAMPING, 0.0], [np.inf, MOST_DAMPING, np.inf]),
    ).x  # fmt: skip
    return solution[:2], np.asarray(size + solution[2] * of_mode(solution))


def _by_phases(band: _Band, time: FloatArray, phase: FloatArray) -> FloatArray:
    """Return the delays a and b [s] by the phases of cycles, whose sign may be turned."""

    def away(q: FloatArray, constant: float) -> FloatArray:
        turns = band.motion.turns(band.on_sweep(time, q)) - band.motion.turns(time)
        return np.asarray(2.0 * math.pi * turns + constant - phase)

    free = least_squares(lambda q: away(q[:2], q[2]), np.zeros(3)).x
    multiple = math.pi * round(free[2] / math.pi)
    return np.asarray(least_squares(lambda q: away(q, multiple), free[:2]).x)


def _covariance(jacobian: FloatArray, residual: FloatArray) -> FloatArray:
    """Return the covariance of the unknowns, shape (4, 4).

    It is that for white noise. Fits to the record without one of `BLOCKS` parts (jackknife) may
    scatter more than such noise lets them. Then the variance is that of these fits, which also
    contains what the model leaves out.
    """
    scale = np.sqrt((jacobian**2).sum(axis=0))
    J = jacobian / scale
    variance = residual @ residual / (residual.size - J.shape[1] - LINEAR)
    white = np.linalg.inv(J.T @ J) * variance
    known = np.cumsum(J[:, 0] ** 2)
    part = np.minimum((BLOCKS * known / known[-1]).astype(int), BLOCKS - 1)
    shifts = np.empty((BLOCKS, J.shape[1]))
    expected = np.zeros(J.shape[1])
    for k in range(BLOCKS):
        left_out = J[part == k]
        others = np.linalg.inv(J[part != k].T @ J[part != k])
        # one Gauss-Newton step of the fit without part k, and its variance by white noise
        shifts[k] = others @ left_out.T @ residual[part == k]
        expected += variance * np.diag(others @ left_out.T @ left_out @ others)
    scattered = (BLOCKS - 1) * shifts.var(axis=0)
    is_more = scattered > SCATTERED * (BLOCKS - 1) / BLOCKS * expected
    widened = np.sqrt(np.where(is_more, scattered / np.diag(white), 1.0)).clip(1.0) / scale
    return np.asarray(white * np.outer(widened, widened))


def _judged(
    band: _Band, p: FloatArray, covariance: FloatArray, residual: FloatArray, weights: FloatArray,
    peak: float, cycles: FloatArray,
) -> ResonanceFit:  # fmt: skip
    """Return the resonance with its errors, and remarks on its record."""
    t = band.time
    error = np.sqrt(np.diag(covariance))
    middle = 0.5 * (t[0] + t[-1])
    length = float(t[-1] - t[0])
    clock = 1.0 - p[3] / length
    clock_error = error[3] / length
    at_zero = np.array([0.0, 0.0, -1.0, middle / length])  # u of (R1) at t = 0
    late = float(at_zero @ p)
    late_error = math.sqrt(at_zero @ covariance @ at_zero)
    rms = float(np.std(residual))
    top = float(abs(band.displacement).max())
    noise = statistics.white_noise(residual)
    remarks = []
    if rms > max(NOT_NOISE * noise, NOTHING_LEFT * top):
        remarks.append(
            f"one mode leaves {100.0 * rms / top:.2g} % of the largest displacement, "
            f"{rms / noise:.2g} times the noise of a sample: something else moves too, and all "
            "numbers, start and clock included, may be off by more than ±"
        )
    by_damping = p[1] / (math.pi * p[0])  # 2 D/ω, see (R1): by mass or not is not in the record
    if abs(late) > max(SIGNIFICANT * late_error, t[1] - t[0], by_damping):
        remarks.append(
            f"the record begins {abs(late):.4g} ± {late_error:.1g} s "
            f"{'after' if late > 0.0 else 'before'} the sweep, which the fit takes into account"
        )
    if abs(clock - 1.0) > SIGNIFICANT * clock_error:
        error[0] = math.hypot(error[0], p[0] * (clock - 1.0))
        if abs(clock - 1.0) > SAME_CLOCK:
            remarks.append(
                f"a second of the record is {clock:.6g} ± {clock_error:.1g} s of the sweep, so one "
                "clock is wrong: the frequency is by that of the record, its ± holds the other"
            )
    return ResonanceFit(
        float(p[0]), float(error[0]), float(p[1]), float(error[1]), float(weights[1] / weights[0]),
        peak, rms / top, late, late_error, clock, clock_error, tuple(remarks),
        cycles,
    )  # fmt: skip


HEADING = ("lamina", "peak read off", "frequency", "damping ratio", "EI", "EI of the case")


def resonance_figure(found: ResonanceFit) -> Figure:
    """Draw measured amplitudes, the fit, the peak and the natural frequency."""
    figure = Figure(figsize=(7.0, 4.0))
    panel = figure.subplots()
    frequency, amplitude, fitted = found.cycles
    panel.plot(frequency, amplitude, ".", color=style.BLUE, ms=2.5, label="measured")
    panel.plot(frequency, fitted, color=style.VERMILLION, label="fit")
    panel.axvline(found.peak, color=style.BLUE, linestyle=":", label=f"peak {found.peak:.4f} Hz")
    panel.axvline(
        found.frequency, color=style.GREEN, label=f"natural frequency {found.frequency:.4f} Hz"
    )
    panel.set_xlabel("frequency of the base  [Hz]")
    panel.set_ylabel("amplitude over that of the base  [–]")
    panel.legend()
    figure.tight_layout()
    return figure


@dataclass(frozen=True)
class Found(Finding):
    """The resonances of the laminae of a case.

    Attributes:
        case: the case.
        resonances: fitted resonance of each lamina.
    """

    case: Case
    resonances: tuple[ResonanceFit, ...]

    @property
    def report(self) -> Report:
        """Report of the finding in files and on the terminal."""
        numbers = {}
        rows = []
        pairs = list(zip(self.case.lamina, self.resonances, strict=True))
        for lamina, one in pairs:
            EI, error = one.bending_stiffness(lamina)
            rows.append(
                (
                    lamina.name,
                    f"{one.peak:.4f} Hz",
                    f"{one.frequency:.4f} ± {one.frequency_error:.1g} Hz",
                    f"{one.damping_ratio:.5f} ± {one.damping_error:.1g}",
                    f"{EI:.4g} ± {error:.1g} N m2",
                    f"{lamina.flexural_rigidity:.4g} N m2",
                )
            )
            numbers[lamina.name] = {
                "peak_hz": one.peak,
                "frequency_hz": one.frequency,
                "frequency_error_hz": one.frequency_error,
                "damping_ratio": one.damping_ratio,
                "damping_ratio_error": one.damping_error,
                "participation": one.participation,
                "begins_after_sweep_s": one.late,
                "begins_after_sweep_error_s": one.late_error,
                "clock": one.clock,
                "clock_error": one.clock_error,
                "remarks": one.remarks,
                "bending_stiffness_N_m2": EI,
                "bending_stiffness_error_N_m2": error,
                "relative_rms": one.residual,
            }
        return Report(
            name="resonance",
            numbers=numbers,
            tables=[Table(f"resonances of case {self.case.name}", HEADING, rows)],
            remarks=[f"{lamina.name}: {text}" for lamina, one in pairs for text in one.remarks],
            pictures={
                f"resonance-{lamina.name}": (partial(resonance_figure, one), "")
                for lamina, one in pairs
            },
        )


def identified(case: Case, options: Options, context: RunContext | None = None) -> Found:
    """Identify the resonances of all laminae.

    Args:
        case: a case whose base moves as a swept sine of given amplitude.
        options: file with the tips, whose times count from the start of the sweep, or how the case
            is simulated without contact.
        context: folder for a checkpoint, from which the run goes on; None: none is kept.

    Raises:
        CaseError: the excitation is no such sweep, or the file has not the tips of all laminae.
    """
    excitation = case.excitation
    if not isinstance(excitation, SweepExcitation) or excitation.amplitude is None:
        raise CaseError(
            'excitation.kind: expected "sweep" with an amplitude for a resonance, given '
            f'"{excitation.kind}"'
        )
    if case.is_apart and not case.support.is_cantilever:
        raise CaseError(
            "support: resonance: expected laminae clamped at x = 0 alone, whose bending stiffness "
            "follows from a frequency; take identify keys"
        )
    ratios: list[float] = []
    if options.measured is None:
        time, tips, ratios = _simulated(case, None if context is None else context.checkpoints)
    else:
        time, tips = measured_histories(
            options.measured, of_references([lamina.name for lamina in case.lamina])
        )
    tips = tips + options.noise * np.random.default_rng(options.seed).standard_normal(tips.shape)
    motion = swept_motion(excitation, excitation.amplitude)
    resonances = (
        fit(time, tip, motion, by_mass=case.rayleigh(lamina)[0]) for lamina, tip in enumerate(tips)
    )
    if options.measured is None:
        pairs = zip(resonances, ratios, strict=True)
        resonances = (_exact(one, case.time_step, ratio) for one, ratio in pairs)
    return Found(case, tuple(resonances))


def _exact(found: ResonanceFit, step: float, ratio: float) -> ResonanceFit:
    """Return a simulated resonance without what steps and elements change in it.

    e^{μ Δt} = (1 + λ Δt/2)/(1 - λ Δt/2) for the pole μ of average acceleration and λ of the mode.
    Elements change the damping about as much as the frequency, in a way that is not known: its
    error grows by that.

    Args:
        found: resonance in a simulated record.
        step: Δt [s].
        ratio: frequency of the elements over the exact one.
    """
    pole = harmonics.pole(2.0 * np.pi * found.frequency, found.damping_ratio)
    exact = 2.0 / step * np.tanh(0.5 * step * pole) / ratio
    frequency = abs(exact) / (2.0 * np.pi)
    damping = -exact.real / abs(exact)
    error = math.hypot(found.damping_error, damping * (ratio - 1.0))
    return replace(
        found, frequency=float(frequency), damping_ratio=float(damping), damping_error=error
    )


def _simulated(case: Case, kept: Path | None) -> tuple[FloatArray, FloatArray, list[float]]:
    """Return times [s] and absolute tips [m] without contact, and the ratios of `_exact`."""
    free = case.with_overrides(
        {
            "contact.law": "none",
            "output.window_periods": case.n_periods,
            "output.fields_per_period": 0,
        }
    )
    structure = assemble(free, needs_dolfinx=False)
    with session_of(free, structure.operators, engine="compiled") as opened:
        opened.run_with_checkpoints(kept, free)
        tips = probe_motion(opened.recorder, structure).displacement
    modes = (first_mode(structure, i) for i in range(len(case.lamina)))
    o = structure.operators
    frequencies = [math.sqrt((u @ o.stiffness @ u) / (u @ o.mass @ u)) for u in modes]
    ratios = [a / b for a, b in zip(frequencies, first_frequencies(case), strict=True)]
    return np.arange(1, tips.shape[1] + 1) * free.time_step, tips, ratios
