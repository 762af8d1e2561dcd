"""`measure overlay`.

Records of 2 s of both tips of `paper`, near 3.25 and 3.65 Hz, after the end of the run, with noise
of 0.05 … 0.3 mm. No share of "differs" is printed; 100 % is the aim.

The runs are of the preset `paper`, 400 periods, at ten frequencies within 0.01 Hz of 3.25 Hz (most
of them with cycles that differ) and at ten of 3.65 Hz (doubled). A record is 2 s of the same motion
after the end of the run: both tips, with or without the base, from any instant, 300 … 600 samples
per second, noise of 0.05 … 0.3 mm. Each run has a tenth of the records of a row: all records of one
run share what it is off. Of another draw of eight runs about 3.65 Hz, without the base, 69 starts,
66 clocks and 45 amplitudes of 80 lay within two errors before these held the scatter of the cycles
to the full. A start is right within 5 % of a period of the drive; on the doubled motion there are
two to choose from. Records that differ have one tip that is wrong, a wrong clock, or a base of
another frequency. "Differs" is right if a finding of the kind that it should have is about the
wrong tip. Which tip is late without the base, or a period of the drive late, nobody can tell: there
it may be about the other tip. Records of rigs that differ from the run have the base, whose clock
and start are judged alone; how many of them get "differs" is in the note. Rows of records that are
not of the run's own motion have 100 truths. No share of "differs" is printed; 100 % is the aim.
Laminae that are apart have rigid clamps: `support.rotational_stiffness` is that of bonded beams.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from calibration.row import Row
from calibration.settled import laminae
from scipy.interpolate import CubicSpline

import delam_fem as df
from delam_fem.api import (
    Case,
    FloatArray,
    Result,
    assemble,
    base_motion,
    modes_of,
    scheme_of,
    session,
    span_of,
)
from delam_fem.studies.sweeps.point import probe_motion

BEFORE, WINDOW, AFTER = 400, 40, 60
"""Periods of the run, those that it keeps, and those after it, of which records are taken."""
FREQUENCIES = {1: 3.25, 2: 3.65}
NEAR = 0.01
RUNS = 10
SAME = 20
OTHERS = 10
"""Of the base, by the period of the motion, and by how much a run may differ from them [Hz]; runs
about each frequency; records of the same motion of each run, and of others."""
DURATION, STEP = 2.0, 0.05
"""Of a record [s]; largest distance of a start that is right [periods of the drive]."""
TWO_ERRORS, MOST, ALL = 0.9545, 0.99, 1.0
TIPS = ("tip thick", "tip thin")


@dataclass(frozen=True)
class Record:
    """How a record differs from the motion.

    Attributes:
        kind: of the finding that it should get; empty: none.
        gain: of the wrong tip.
        late: by which it is late [periods of the drive].
        clock: seconds of the motion in one of the record.
        frequency: of the base over that of the run.
        speckle: standard deviation of the logarithm of the noise from tip to tip.
        shaker: second harmonic of the base acceleration over the first.
    """

    kind: str = ""
    gain: float = 1.0
    late: float = 0.0
    clock: float = 1.0
    frequency: float = 1.0
    speckle: float = 0.0
    shaker: float = 0.0


RIGS: dict[str, tuple[Record, dict[str, float]]] = {
    "EI + 5 %": (Record(), laminae("bending_stiffness", 1.05)),
    "EI − 5 %": (Record(), laminae("bending_stiffness", 0.95)),
    "damping × 2": (Record(), laminae("damping_ratio", 2.0)),
    "damping × ½": (Record(), laminae("damping_ratio", 0.5)),
    "40 elements, not 20": (Record(), {"mesh.elements": 40}),
    "noise differs between tips (log-normal, σ 0.7)": (Record(speckle=0.7), {}),
    "shaker with 1 % of second harmonic": (Record(shaker=0.01), {}),
}
"""How the record of each rig differs, and the keys of its case."""


def changed(rng: np.random.Generator, period: int, has_base: bool) -> dict[str, Record]:
    """Return records that differ, drawn anew for each truth."""
    way = rng.choice([-1.0, 1.0])
    clock = 1.0 + way * np.exp(rng.uniform(*np.log([0.003, 0.02])))
    records = {
        "a tip 1.1 … 2 times as large or small": Record("amplitude", rng.uniform(1.1, 2.0) ** way),
        "a tip 10° … 90° late": Record("phase", late=rng.uniform(10.0, 90.0) / 360.0),
        "clock 0.3 … 2 % fast or slow": Record("clock", clock=clock),
        "5 % more frequency": Record("clock", frequency=1.05),
    }
    if has_base:
        records["a tip with its sign turned"] = Record("amplitude", -1.0)
    if period > 1:
        records["a tip one period of the drive late"] = Record("shape", late=1.0)
    return records


def rows(is_long: bool, folder: Path) -> list[Row]:
    """Return the rows of the page."""
    result: list[Row] = []
    n_runs, n_same, n_others = (RUNS, SAME, OTHERS) if is_long else (1, 2, 1)
    for period, frequency in FREQUENCIES.items():
        runs = list(islice(runs_near(frequency, period), n_runs))
        truths = n_runs * n_others
        path = folder / "record.csv"
        own_motions = [{k: motion(k / run.case.period) for k in (1.0, 1.05)} for run in runs]
        for has_base in (True, False):
            rig = f"{frequency:g} Hz with{'' if has_base else 'out'} base"
            rng = np.random.default_rng([3, period, has_base])
            setting = [(*both, path, has_base, rng) for both in zip(runs, own_motions, strict=True)]
            same = np.array([trial(Record(), *one) for one in setting * n_same])
            for what, share, k, most in (
                ("start, of all periods", ALL, 0, STEP), ("start ± 2 errors", TWO_ERRORS, 1, 2.0),
                ("clock ± 2 errors", TWO_ERRORS, 2, 2.0), ("“agrees”", MOST, 3, 0.5),
                ("amplitude of a tip ± 2 errors", TWO_ERRORS, 5, 2.0),
                ("phase of a tip ± 2 errors", TWO_ERRORS, 6, 2.0),
            ):  # fmt: skip
                result.append(Row(what, rig, share, int((same[:, k] < most).sum()), len(same)))
            for name in changed(rng, period, has_base):
                records = (
                    (changed(rng, period, has_base)[name], one) for one in setting * n_others
                )
                right = sum(bool(trial(record, *one)[4]) for record, one in records)
                result.append(Row(f"“differs”: {name}", rig, ALL, right, truths))
        for number, (rig, (record, keys)) in enumerate(RIGS.items() if is_long else ()):
            rng = np.random.default_rng([6, period, number])
            moved = [{1.0: motion(1.0 / run.case.period, keys, record.shaker)} for run in runs]
            both = list(zip(runs, moved, strict=True)) * n_others
            outcomes = np.array([trial(record, *one, path, True, rng) for one in both])
            named = int((outcomes[:, 3] > 0.0).sum())
            result += [
                Row(what, f"{frequency:g} Hz, {rig}", TWO_ERRORS, int((outcomes[:, k] < 2.0).sum()),
                    truths, warned=named, note=f"“differs” in {named}")
                for what, k in (("start ± 2 errors", 1), ("clock ± 2 errors", 2))
            ]  # fmt: skip
    return result


def runs_near(frequency: float, period: int) -> Iterator[Result]:
    """Yield runs about a frequency [Hz] that have a period."""
    rng = np.random.default_rng([2, period])
    while True:
        case = case_of(frequency + NEAR * rng.uniform(-1.0, 1.0), BEFORE, WINDOW, {})
        run = df.run(case, engine="compiled")
        if run.summary["periodicity"] == period:
            yield run


def case_of(frequency: float, periods: int, window: int, keys: dict[str, float]) -> Case:
    """Return the preset at a frequency; it keeps its last periods."""
    return df.preset("paper", {
        "excitation.frequency": frequency, "time.periods": periods,
        "output.window_periods": window, "output.fields_per_period": 0, **keys,
    })  # fmt: skip


def motion(
    frequency: float, keys: dict[str, float] | None = None, shaker: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return times, shape (n,) [s], and tips, shape (2, n) [m], of a motion after the run."""
    case = case_of(frequency, BEFORE + AFTER, AFTER, keys or {})
    tips = shaken(case, shaker, 0.0)
    steps = np.arange(1, 1 + tips.shape[1])
    return case.period * (BEFORE + steps / case.steps_per_period), tips


def shaken(case: Case, shaker: float, phase: float) -> FloatArray:
    """Return the tips of a case in its window, shape (2, n) [m].

    Args:
        case: under a harmonic base.
        shaker: second harmonic of the acceleration of its base over the first.
        phase: of that [rad].
    """
    structure = assemble(case, needs_dolfinx=False)
    span = span_of(case)
    base = base_motion(case.excitation)
    once = base.states(span.time_step * np.arange(span.steps_per_period + 1))
    angle = 2.0 * np.linspace(0.0, 2.0 * np.pi, len(once)) + phase
    omega = 4.0 * np.pi / case.period
    A = 0.25 * shaker * case.excitation.amplitude
    second = [np.sin(angle), omega * np.cos(angle), -(omega**2) * np.sin(angle)]
    table = once + A * np.stack(second, axis=-1)
    with session(
        structure.operators, case.contact_law, scheme_of(case), lambda period: table, span,
        modes=modes_of(case),
    ) as opened:  # fmt: skip
        opened.run()
        return probe_motion(opened.recorder, structure).displacement


def trial(
    record: Record, run: Result, motions: dict[float, tuple[FloatArray, FloatArray]], path: Path,
    has_base: bool, rng: np.random.Generator,
) -> tuple[float, float, float, int, bool, float, float]:  # fmt: skip
    """Return what `overlay` says of one record.

    Returns:
        Distance of the start [periods of the drive]; those of start and clock over their errors;
        the number of findings, and whether the record's own is among them; for a record of the
        run's own motion, how far amplitude and phase of a tip are off over their errors.
    """
    turn, (time, tips) = run.case.period, motions[record.frequency]
    noise = np.exp(rng.uniform(*np.log([5e-5, 3e-4])))
    t = np.arange(0.0, DURATION, 1.0 / rng.uniform(300.0, 600.0))
    start = rng.uniform(time[0] + 2.0 * turn, time[-1] - 1.1 * DURATION)
    u = start + record.clock * t
    wrong = int(rng.integers(2))
    channels = {}
    for k, name in enumerate(TIPS):
        gain, late = (record.gain, record.late) if k == wrong else (1.0, 0.0)
        course = CubicSpline(time, gain * tips[k])
        size = noise * np.exp(record.speckle * rng.normal()) if record.speckle else noise
        channels[name] = course(u - late * turn) + size * rng.standard_normal(t.size)
    if has_base:
        frequency = record.frequency / turn
        angle = 2.0 * np.pi * frequency * u
        base_course = np.sin(angle) + 0.25 * record.shaker * np.sin(2.0 * angle)
        channels["base"] = run.case.excitation.amplitude * base_course
        channels["base"] += 0.01 * noise * rng.standard_normal(t.size)
    head = ",".join(["time [s]", *(f"{name} [m]" for name in channels)])
    np.savetxt(path, np.stack([t, *channels.values()]).T, delimiter=",", header=head, comments="")
    comparison = df.overlay(run, path)
    repeats = turn * run.summary["periodicity"]
    away = abs((comparison.offset - start + repeats / 2) % repeats - repeats / 2)
    alignment = comparison.alignment
    is_named = any(
        one.kind == record.kind
        and (one.channel in ("", TIPS[wrong]) or not has_base or record.kind == "shape")
        for one in comparison.findings
    )
    clock = abs(alignment.rate - record.clock) / alignment.rate_error
    tip = next(one for one in comparison.channels if one.name == TIPS[wrong])
    gain = abs(tip.gain - 1.0) / tip.gain_error
    phase = abs(tip.delay) / tip.delay_error
    return (
        away / turn,
        away / alignment.start_error,
        clock,
        len(comparison.findings),
        is_named,
        gain,
        phase,
    )
