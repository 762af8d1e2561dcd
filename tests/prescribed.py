"""A laboratory of the paper that prescribes its motions: figures then do not follow from chaos."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from delam_fem import Case
from delam_fem.api import FloatArray, Result, base_motion
from delam_fem.paper.runs import FREQUENCIES, Laboratory
from delam_fem.results.diagnostics import summary
from delam_fem.results.schema import add

THROW = 0.045
"""Largest distance of the tips [m]; their rate of 0.9 m/s jumps at a strike."""
DEEP = 0.004
"""The tips go this share of it below a gap of zero."""
SHARES = dict(zip(FREQUENCIES, (0.5, 0.8, 0.6, 0.4), strict=True))
"""What the thin lamina does of the gap's motion."""


class Prescribed(Laboratory):
    """Prescribes histories, and computes sweeps."""

    def motions(self, cases: Sequence[Case]) -> list[Result]:
        """Return prescribed results of cases."""
        return [prescribed(case) for case in cases]


def prescribed(case: Case) -> Result:
    """Return a result whose tips strike as at one of the paper's frequencies."""
    if not case.is_periodic:
        return swept(case)
    history = tips(case)
    numbers = summary(history, case) | {
        "energy_residual": 0.0,
        "impact_energy_gain": 1e-6 * size_of(case),
        "microseconds_per_step": 0.01 * case.mesh.elements,
    }
    return Result(case, history, numbers, np.zeros(0))


def size_of(case: Case) -> float:
    """Return a number that differs from case to case, about 1."""
    keys = (
        case.contact.law == "newton",
        case.contact.impulse == "lumped",
        case.time.mass == "lumped",
    )
    return 1.0 + 0.01 * (
        np.dot(keys, (7.0, 2.0, 3.0)) + 2.0 * case.gap.exponent + 0.1 * case.mesh.elements
        + 50.0 * case.contact.threshold_velocity
    )  # fmt: skip


def motion(case: Case, t: FloatArray) -> FloatArray:
    """Return displacements of both tips at times in periods, shape (2, n) [m]."""
    frequency = 1.0 / case.period
    nearest = min(FREQUENCIES, key=lambda f: abs(f - frequency))
    size, share = size_of(case), SHARES[nearest]
    turn = np.pi * (t - 0.37) / (2.0 if nearest == FREQUENCIES[3] else 1.0)
    gap = THROW * size * (np.abs(np.sin(turn)) - DEEP)
    if nearest == FREQUENCIES[0]:
        gap = gap + 2.0 * DEEP * THROW
    at_rest = 0.012
    lower = 0.01 * size * np.sin(2.0 * np.pi * t + 0.3) + 2e-5 * np.sin(60.0 * np.pi * t)
    if nearest == FREQUENCIES[3]:
        lower = lower + 0.004 * np.sin(np.pi * t + 0.7)
    return np.stack([lower - (1.0 - share) * (gap - at_rest), lower + share * (gap - at_rest)])


def tips(case: Case) -> xr.Dataset:
    """Return the history of a case: its tips as `motion` says, and along x as (x/L)²."""
    T, N, last = case.period, case.steps_per_period, case.n_periods
    first, per_period, n = last - case.n_window_periods, case.frames_per_period, case.mesh.elements
    x = np.linspace(0.0, case.length, n + 1)
    shape = (x / x[-1]) ** 2
    data = xr.Dataset(coords={"lamina": [lamina.name for lamina in case.lamina]})
    steps = first + np.arange(1, N * (last - first) + 1) / N
    q = motion(case, steps)
    add(
        data,
        time=steps * T,
        tip_displacement=q,
        tip_velocity=(q - motion(case, steps - 1.0 / N)) * N / T,
    )
    add(data, x=x, tip_node=n, gap0=0.012 * shape)
    data = data.set_coords("x")
    strobe = motion(case, np.arange(1.0, last + 1)) * (1.0 + 0.8 ** np.arange(last))
    add(data, period=np.arange(last), strobe_displacement=strobe)
    u = q[:, :, None] * shape
    u[1, :, : n // 3] -= 3.0 * DEEP * THROW * shape[: n // 3]  # near the clamp they touch, too
    add_contact(data, case, u)
    if per_period:
        every = slice(N // per_period - 1, None, N // per_period)
        add(data, frame=data["time"].to_numpy()[every], displacement=u[:, every])
        is_resting = data.attrs.pop("held")[every].astype(np.int8)
        add(data, contact_state=2 * is_resting)
    data.attrs = {"outcome": "completed", "engine": "petsc"}
    return data


def add_contact(data: xr.Dataset, case: Case, u: FloatArray) -> None:
    """Add an impact where a pair closes; those of even nodes, and no others, stay closed."""
    closed = data["gap0"].to_numpy() + u[1] - u[0] <= 0.0
    closed[:, 0] = False
    hit = closed & ~np.vstack([np.zeros_like(closed[:1]), closed[:-1]])
    node = np.arange(closed.shape[1])
    step, at = np.nonzero(hit)
    data.attrs["held"] = closed & (node % 2 == 0)
    speed = 0.001 * (1.0 + at)
    add(data, event_time=data["time"].to_numpy()[step], event_node=at)
    add(data, event_impulse=1e-3 * speed * size_of(case), event_velocity_before=-speed)


def swept(case: Case) -> Result:
    """Return a swept sine whose extremes are those of linear vibration, shifted upwards."""
    data = xr.Dataset(coords={"lamina": [lamina.name for lamina in case.lamina]})
    middle = (np.arange(case.n_periods) + 0.5) * case.period
    f = base_motion(case.excitation).instantaneous_frequency(middle)
    size = np.stack([np.minimum(case.linear_amplitude(i, f), 0.2 - 0.1 * i) for i in range(2)])
    add(data, envelope_min=-0.9 * size, envelope_max=1.1 * size)
    data.attrs = {"outcome": "completed"}
    return Result(case, data, {}, np.zeros(0))
