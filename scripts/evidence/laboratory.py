"""Estimate responses and poles of one synthetic record by the project and by its peers.

    .venv/bin/python scripts/evidence/laboratory.py

writes docs/evidence/laboratory.md. The record is that of a uniform cantilever on a base that is
driven from 5 to 150 Hz; its tip follows from the exact transmissibility. The peers are called as
their manuals do, pyFRF and sdypy-EMA.
"""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy.signal import csd, welch

from delam_fem.api import FloatArray, beams
from delam_fem.studies.signals.reading import SCHEMA
from delam_fem.studies.signals.responses import poles, with_responses

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "evidence" / "laboratory.md"
LENGTH = 0.3
EI = 1.0
RHO_A = 0.108
RAYLEIGH = (0.5, 1e-4)
RATE = 512
DURATION = 256
SEGMENT = 8
"""Samples per second, and lengths of the record and of a segment [s]."""
BAND = (5.0, 150.0)
ORDER, WINDOW = 60, 5
"""Highest order of the polynomials of sdypy-EMA, and width [Hz] about a mode in which it looks for
stable poles: in its own 50 Hz it finds none of the first mode."""
NOISES = (0.0, 0.01, 0.05)
"""Noise of the tip over its rms."""
HEAD = """# Responses and poles beside pyFRF and sdypy-EMA

`scripts/evidence/laboratory.py` computes this page from a record of 256 s at 512 samples/s: the
base of a cantilever is shaken at random from 5 to 150 Hz, and its tip follows by the exact
transmissibility, with noise. All take segments of 8 s that overlap by half, with Hann windows.
"""


def transmissibility(frequency: FloatArray) -> beams.ComplexArray:
    """Return the displacement of the tip over that of the base."""
    return beams.transmissibility(
        2.0 * np.pi * frequency, length=LENGTH, flexural_rigidity=EI, mass_per_length=RHO_A,
        rayleigh=RAYLEIGH,
    )  # fmt: skip


def exact_modes() -> FloatArray:
    """Return frequency [Hz] and damping ratio of the modes in the band, shape (2, 2)."""
    omega = beams.cantilever_roots(2) ** 2 * np.sqrt(EI / RHO_A) / LENGTH**2
    alpha, beta = RAYLEIGH
    return np.stack([omega / (2.0 * np.pi), 0.5 * (alpha / omega + beta * omega)], axis=1)


def record(noise: float, duration: int = DURATION, seed: int = 1) -> tuple[FloatArray, FloatArray]:
    """Return base and tip [m/s2], shape (n,) each; the motion repeats after the record."""
    rng = np.random.default_rng(seed)
    n = duration * RATE
    frequency = np.fft.rfftfreq(n, 1.0 / RATE)
    is_driven = (frequency >= BAND[0]) & (frequency <= BAND[1])
    base = np.zeros(frequency.size, np.complex128)
    base[is_driven] = rng.standard_normal((int(is_driven.sum()), 2)) @ [1.0, 1j]
    tip = np.zeros_like(base)
    tip[is_driven] = base[is_driven] * transmissibility(frequency[is_driven])
    histories = [np.fft.irfft(spectrum, n) for spectrum in (base, tip)]
    scale = 1.0 / histories[0].std()
    y = scale * histories[1]
    return scale * histories[0], y + noise * y.std() * rng.standard_normal(n)


def measurement(base: FloatArray, tip: FloatArray) -> xr.Dataset:
    """Return the record as `measure read` reads it."""
    names = ["base", "tip"]
    return xr.Dataset(
        {
            "base": ("time", base),
            "sensor_tip": ("time", tip),
            "channel_variable": ("channel", ["base", "sensor_tip"]),
            "channel_units": ("channel", ["m/s2", "m/s2"]),
            "channel_quantity": ("channel", ["acceleration", "acceleration"]),
            "channel_position": ("channel", [np.nan, np.nan]),
            "channel_source": ("channel", names),
            "channel_lamina": ("channel", ["", ""]),
        },
        {"time": np.arange(base.size) / RATE, "channel": names},
        attrs={"schema": SCHEMA, "title": "measurement", "notes": ""},
    )


def by_project(
    base: FloatArray, tip: FloatArray
) -> tuple[FloatArray, beams.ComplexArray, FloatArray]:
    """Return lines, response and modes as `measure response --poles` does."""
    data = with_responses(measurement(base, tip), "base", segment=SEGMENT)
    pole_list, _ = poles(data, BAND[0] + 1.0, BAND[1] - 1.0)
    modes = np.array([(pole.frequency, pole.damping) for pole in pole_list])
    return data["frequency"].to_numpy(), data["response"].to_numpy()[:, 0], modes


def by_peers(
    base: FloatArray, tip: FloatArray
) -> tuple[FloatArray, beams.ComplexArray, FloatArray]:
    """Return lines and H1 of pyFRF, and the modes that sdypy-EMA finds in it."""
    from pyFRF import FRF

    length = SEGMENT * RATE
    estimate = FRF(
        RATE, exc=base, resp=tip, exc_type="f", resp_type="d", window="hann", fft_len=length,
        nperseg=length, noverlap=length // 2,
    )  # fmt: skip
    frequency = estimate.get_f_axis()
    response = estimate.get_FRF()[0, 0]
    ema: Any = import_module("sdypy.EMA")
    model = ema.Model(
        frf=response[None], freq=frequency, lower=BAND[0] + 1.0, upper=BAND[1] - 1.0,
        pol_order_high=ORDER,
        frf_form="receptance",
    )  # fmt: skip
    with contextlib.redirect_stdout(io.StringIO()):
        model.get_poles(show_progress=False)
        model.select_closest_poles(exact_modes()[:, 0].tolist(), f_window=WINDOW)
    return frequency, response, np.stack([model.nat_freq, model.nat_xi], axis=1)


def by_spectra(base: FloatArray, tip: FloatArray) -> beams.ComplexArray:
    """Return H1 from the spectra of SciPy."""
    options = {"fs": RATE, "window": "hann", "nperseg": SEGMENT * RATE}
    return csd(base, tip, **options)[1] / welch(base, **options)[1]


def peak_error(frequency: FloatArray, response: beams.ComplexArray) -> float:
    """Return by how much the first peak is higher than the exact one, at the same lines [-]."""
    near = np.abs(frequency - exact_modes()[0, 0]) < 2.0
    return float(
        np.abs(response[near]).max() / np.abs(transmissibility(frequency[near])).max() - 1.0
    )


def rows(noise: float, duration: int = DURATION) -> tuple[list[list[str]], dict[str, float]]:
    """Return the rows of the page for a noise, and numbers that a test asks for."""
    base, tip = record(noise, duration)
    frequency, ours, our_modes = by_project(base, tip)
    lines, theirs, their_modes = by_peers(base, tip)
    is_in = (frequency >= BAND[0]) & (frequency <= BAND[1])
    scipys = by_spectra(base, tip)
    exact = exact_modes()
    size = np.abs(ours[is_in]).max()
    numbers = {
        "pyfrf": float(np.abs(ours - theirs)[is_in].max() / size),
        "scipy": float(np.abs(ours - scipys)[is_in].max() / size),
    }
    assert np.allclose(lines, frequency)
    result = []
    for name, response, modes in (
        ("delam_fem", ours, our_modes), ("pyFRF, sdypy-EMA", theirs, their_modes)
    ):  # fmt: skip
        errors = modes / exact - 1.0
        key = "ours" if response is ours else "theirs"
        numbers[f"{key}_peak"] = peak_error(frequency, response)
        for k in range(2):
            numbers[f"{key}_f{k + 1}"] = float(errors[k, 0])
            numbers[f"{key}_D{k + 1}"] = float(errors[k, 1])
        cells = [numbers[f"{key}_{what}"] for what in ("peak", "f1", "D1", "f2", "D2")]
        result.append([f"{100.0 * noise:g} %", name, *(f"{100.0 * x:+.2g} %" for x in cells)])
    return result, numbers


def table(headings: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """Return a table of a page."""
    every = [headings, ["---"] * len(headings), *lines]
    return "\n".join(f"| {' | '.join(line)} |" for line in every) + "\n"


def page() -> str:
    """Return the page."""
    lines = []
    largest = {"pyfrf": 0.0, "scipy": 0.0}
    for noise in NOISES:
        of_noise, numbers = rows(noise)
        lines += of_noise
        largest = {name: max(value, numbers[name]) for name, value in largest.items()}

    def size(name: str) -> str:
        return f"{largest[name]:.1g}"

    modes = " and ".join(f"{f:.4f} Hz with D = {D:.5f}" for f, D in exact_modes())
    return f"""{HEAD}
The exact modes are {modes}. Errors against them,
and of the first peak of H against the exact one at the same lines:

{table(["noise", "program", "peak", "f1", "D1", "f2", "D2"], lines)}
`measure response` takes H1 from pyFRF (sdypy-FRF): they differ by {size("pyfrf")} of the largest
value, and from `scipy.signal.csd` by {size("scipy")}. The window makes the peak too low. `--poles`
takes the window out, begins at poles of sdypy-EMA and fits them by least squares. Those of
sdypy-EMA alone are the stable ones nearest to the exact frequencies, of orders up to {ORDER}, in H1
as it is.
"""


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    sys.exit(0)
