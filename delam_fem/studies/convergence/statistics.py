"""Reduce the periods of a motion to numbers, and these numbers to means with their scatter.

Trajectories of an impacting motion depend on round-off; these statistics do not. The scatter of a
motion that repeats after P periods is taken between blocks of P periods, so that alternating cycles
do not count as scatter. The names of statistics contain the number of the lamina: 1, 2, ….
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from delam_fem.numerics import harmonics
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results import diagnostics
from delam_fem.simulation.recorder import LEDGER, N_BASE, N_SIZES, Recorder

Statistics: TypeAlias = dict[str, tuple[float, float]]
"""Mean and scatter (standard deviation between blocks) of each statistic by name."""

HARMONICS = 100
"""Harmonics in the distortion factor; higher ones are of the size of a nanometre."""
SHOWN_HARMONICS = 5
"""Number of harmonics whose amplitudes are statistics."""


@dataclass(frozen=True)
class Statistic:
    """The way in which tables and figures show a statistic.

    Attributes:
        name: name of the statistic.
        symbol: symbol in headings.
        unit: unit in headings.
        factor: factor from SI to this unit.
    """

    name: str
    symbol: str
    unit: str
    factor: float = 1.0

    @property
    def heading(self) -> str:
        """Symbol and unit as a heading."""
        return f"{self.symbol} [{self.unit}]"


WORK = Statistic("contact_work", "contact work", "mJ", 1e3)


def extrema(n_laminae: int) -> tuple[Statistic, ...]:
    """Return the mean extremes of the displacements within a period, lamina by lamina.

    The extremes over several periods would grow with the scatter of cycles.
    """
    return tuple(
        Statistic(f"tip_{end}_{i}", f"y{i} {end}", "mm", 1e3)
        for i in range(1, n_laminae + 1)
        for end in ("min", "max")
    )


def general(n_laminae: int) -> tuple[Statistic, ...]:
    """Return distortion factors, modal impulse and energy lost in contact, per period.

    The plain sum of impulses is none of them: near a clamp pairs hardly move, and the share that
    each of them takes has no limit in their number. Their work on the first mode has one.
    """
    return (
        *(Statistic(f"distortion_factor_{i}", f"d{i}", "%", 1e2) for i in range(1, n_laminae + 1)),
        Statistic("modal_impulse", "Σ p φ1", "mN s", 1e3),
        WORK,
    )


def amplitudes(n_laminae: int) -> tuple[Statistic, ...]:
    """Return the amplitudes of the first harmonics, lamina by lamina."""
    return tuple(
        Statistic(f"amplitude_{i}_{k}", f"A{k} of {i}", "mm", 1e3)
        for i in range(1, n_laminae + 1)
        for k in range(1, SHOWN_HARMONICS + 1)
    )


def converging(n_laminae: int) -> tuple[Statistic, ...]:
    """Return all statistics of which a limit is computed."""
    return (*extrema(n_laminae), *general(n_laminae), *amplitudes(n_laminae))


@dataclass(frozen=True)
class PeriodRow:
    """The numbers of one period.

    Attributes:
        low, high: smallest and largest tip displacements, each of shape (n_laminae,) [m].
        harmonics: complex amplitudes of the excitation's harmonics at the tips, shape
            (n_laminae, n) [m].
        modal_impulse: sum of impulses, each times the opening of its pair in the first mode [N s].
        impacts: number of impulses on pairs.
        work: net energy lost in contact by impacts, springs and dampers [J].
        gain: energy added by the impacts that gain energy; `work` already contains it [J].
        steps: number of steps of all sizes.
    """

    low: FloatArray
    high: FloatArray
    harmonics: npt.NDArray[np.complex128]
    modal_impulse: float
    impacts: float
    work: float
    gain: float
    steps: float


def row_of(recorder: Recorder, n_laminae: int, opening: FloatArray) -> PeriodRow:
    """Return the numbers of the last period of a recorder.

    Args:
        recorder: recorder of the run; its first probes are the tips, one for each lamina.
        n_laminae: number of laminae.
        opening: of each pair in the first mode, shape (n_pairs,); see `linear.openings`.
    """
    record, k = recorder.window[-1], recorder.n_closed - 1
    u = record.u[1 : record.n_steps + 1, N_BASE : N_BASE + n_laminae].T
    below_nyquist = min(HARMONICS, (u.shape[1] - 1) // 2)
    coefficients = 2.0 * np.fft.rfft(u, axis=1)[:, 1 : below_nyquist + 1] / u.shape[1]
    jumps = record.jumps.columns()
    ledger = dict(zip(LEDGER, recorder.ledger[k].tolist(), strict=True))
    return PeriodRow(
        low=recorder.envelope[k, 0, :n_laminae],
        high=recorder.envelope[k, 1, :n_laminae],
        harmonics=coefficients,
        modal_impulse=float(jumps.impulses @ opening[jumps.hit]),
        impacts=float(recorder.impulse[k, 1]),
        work=ledger["impact_loss"] + ledger["contact_damping_loss"] - ledger["spring_released"],
        gain=float(recorder.impulse[k, 2]),
        steps=float(recorder.effort[k, :N_SIZES].sum()),
    )


def statistics(rows: list[PeriodRow], strobe: FloatArray) -> Statistics:
    """Return the mean and the scatter of each statistic of a motion.

    Args:
        rows: numbers of the periods.
        strobe: tip displacements at the ends of these periods, shape (n_laminae, n_periods) [m].
    """
    low, high = (np.array([getattr(row, name) for row in rows]) for name in ("low", "high"))
    half_range = (high.max(axis=0) - low.min(axis=0)) / 2.0
    P = diagnostics.periodicity(strobe, half_range)[0]
    size = P or 1
    first = len(rows) % size
    blocks = [rows[k : k + size] for k in range(first, len(rows), size)]
    table = [_of_block(block) for block in blocks]
    found = {
        name: (
            float(np.mean([entry[name] for entry in table])),
            float(np.std([entry[name] for entry in table])),
        )
        for name in table[0]
    }
    return found | {"periodicity": (float(P or 0), 0.0), "blocks": (float(len(blocks)), 0.0)}


def _of_block(rows: list[PeriodRow]) -> dict[str, float]:
    """Return the statistics of a block of successive periods by name."""
    of_harmonics = np.abs(np.mean([row.harmonics for row in rows], axis=0))
    factors = harmonics.distortion_factor(of_harmonics)
    values: dict[str, float] = {}
    for i in range(len(of_harmonics)):
        values[f"tip_min_{i + 1}"] = float(np.mean([row.low[i] for row in rows]))
        values[f"tip_max_{i + 1}"] = float(np.mean([row.high[i] for row in rows]))
        values[f"distortion_factor_{i + 1}"] = float(factors[i])
        for k, amplitude in enumerate(of_harmonics[i, :SHOWN_HARMONICS].tolist()):
            values[f"amplitude_{i + 1}_{k + 1}"] = amplitude
    values["modal_impulse"] = float(np.mean([row.modal_impulse for row in rows]))
    values["impacts"] = float(np.mean([row.impacts for row in rows]))
    values["contact_work"] = float(np.mean([row.work for row in rows]))
    values["steps"] = float(np.mean([row.steps for row in rows]))
    values["impact_gain"] = float(np.mean([row.gain for row in rows]))
    return values
