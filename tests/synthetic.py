"""A small history of prescribed motion: what every diagnostic of it must give is known exactly."""

import numpy as np
import xarray as xr

from delam_fem import Case, preset
from delam_fem.results.schema import add

STEPS = 200
"""Steps per period."""
WINDOW = 4
"""Periods of the window."""
PERIODS = 50
FRAMES = 20
"""Frames per period."""
AMPLITUDES = np.array([[0.010, 0.0, 0.0005], [0.012, 0.003, 0.0004]])
"""Amplitudes of harmonics 1, 2, 3 of both tips [m]."""
NODES = 6
LEDGER = {
    "kinetic": 1e-3, "strain": 2e-3, "spring": 1e-4, "base_work": 3e-3, "force_work": 0.0,
    "damping_loss": 2.5e-3, "contact_damping_loss": 0.0, "impact_loss": 1e-3,
    "spring_released": 5e-4, "residual": 0.0,
}  # fmt: skip
"""A ledger that closes: what the base puts in is lost, the stored energy stays [J]."""

SWEEP = {
    "excitation__kind": "sweep",
    "excitation__start_frequency": 1.0,
    "excitation__end_frequency": 4.0,
    "excitation__duration": 12.5,
}


def small_case(**overrides: object) -> Case:
    """Return a case of the synthetic history's size; `a__b` overrides the key a.b."""
    keys = {
        "time.steps_per_period": STEPS,
        "time.periods": PERIODS,
        "output.window_periods": WINDOW,
        "output.fields_per_period": FRAMES,
        "mesh.elements": NODES - 1,
    }
    return preset("paper", keys | {k.replace("__", "."): v for k, v in overrides.items()})


def tip_motion(t: np.ndarray, subharmonic: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return displacement and its derivative by phase at times in periods, shape (2, n)."""
    orders = np.arange(1, AMPLITUDES.shape[1] + 1)
    phase = 2.0 * np.pi * orders[:, None] * t
    q = AMPLITUDES @ np.sin(phase + 0.3)
    v = (AMPLITUDES * orders) @ np.cos(phase + 0.3)
    return (
        q + subharmonic * np.sin(np.pi * t + 0.7),
        2.0 * np.pi * v + np.pi * subharmonic * np.cos(np.pi * t + 0.7),
    )


def synthetic_history(
    case: Case, *, subharmonic: float = 0.0, tip_strikes: tuple[float, ...] = (0.5, 1.5, 2.5, 3.5)
) -> xr.Dataset:
    """Return a history whose laminae move as q(x, t) = (x/L)^2 q_tip(t).

    Args:
        case: from `small_case`.
        subharmonic: amplitude of half the excitation's frequency [m].
        tip_strikes: times of tip impacts after the start of the window, in periods.
    """
    T = case.period
    names = [lamina.name for lamina in case.lamina]
    first = PERIODS - WINDOW
    t = first + np.arange(1, STEPS * WINDOW + 1) / STEPS
    frames = first + np.arange(1, FRAMES * WINDOW + 1) / FRAMES
    x = np.linspace(0.0, case.lamina[0].length, NODES)
    strikes = first + np.array(tip_strikes)
    data = xr.Dataset(coords={"lamina": names})
    add(data, time=t * T)
    q, v = tip_motion(t, subharmonic)
    add(data, tip_displacement=q)
    add(data, tip_velocity=v / T)
    add(data, base_displacement=0.0025 * np.sin(2.0 * np.pi * t))
    add(data, x=x)
    data = data.set_coords("x")
    add(data, tip_node=NODES - 1)
    add(data, spring_share=np.r_[0.0, np.ones(x.size - 1)])
    add(data, gap0=0.030 * (x / x[-1]) ** 2)
    add(data, period=np.arange(PERIODS))
    q, v = tip_motion(np.arange(1.0, PERIODS + 1), subharmonic)
    add(data, strobe_displacement=q)
    add(data, strobe_velocity=v / T)
    add(data, envelope_min=q - 0.01)
    add(data, envelope_max=q + 0.01)
    add(data, impulse_sum=np.zeros(PERIODS))
    add(data, impact_count=np.zeros(PERIODS, dtype=np.int64))
    _add_frames(data, case, frames, x)
    _add_events(data, strikes * T)
    for name, value in LEDGER.items():
        add(data, **{f"energy_{name}": np.full(PERIODS, value)})
    data.attrs = {"outcome": "completed", "engine": "petsc", "delam_fem": "0.1.0"}
    return data


def _add_frames(data: xr.Dataset, case: Case, frames: np.ndarray, x: np.ndarray) -> None:
    shape = (x / x[-1]) ** 2
    q, v = tip_motion(frames)
    add(data, frame=frames * case.period)
    add(data, displacement=q[:, :, None] * shape)
    add(data, velocity=v[:, :, None] / case.period * shape)
    add(data, slope=q[:, :, None] * 2.0 * x / x[-1] ** 2)
    curvature = 2.0 * q[:, :, None] / x[-1] ** 2 + 0.0 * x
    rigidity = np.array([lamina.flexural_rigidity for lamina in case.lamina])
    add(data, moment=rigidity[:, None, None] * curvature)
    state = np.zeros((frames.size, NODES), dtype=np.int8)
    state[::FRAMES, 1:4] = 1
    state[1::FRAMES, 1:3] = 2
    add(data, contact_state=state)


def _add_events(data: xr.Dataset, tip_strikes: np.ndarray) -> None:
    """Add strikes at the tip that grow, and after each a weaker one beside it."""
    n = tip_strikes.size
    growing = np.tile(1e-3 * np.arange(1, n + 1), 2)
    add(data, event_time=np.concatenate([tip_strikes, tip_strikes + 1e-4]))
    add(data, event_node=np.repeat([NODES - 1, NODES - 2], n))
    add(data, event_impulse=growing * np.repeat([1, 0.5], n))
    add(data, event_velocity_before=np.full(2 * n, -0.5))
    add(data, event_energy=np.full(2 * n, -1e-5))
