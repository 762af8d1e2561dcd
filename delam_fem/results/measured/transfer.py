"""Estimate frequency responses and their coherence from measured histories."""

from __future__ import annotations

import numpy as np
import xarray as xr

from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.measured.blows import cut, on_axis, pulses
from delam_fem.results.measured.columns import Values
from delam_fem.results.measured.reading import history_of
from delam_fem.results.measured.units import unit_of

ESTIMATORS = ("H1", "H2", "Hv")
"""Estimators: noise in the responses, in the excitation, in both."""
SEGMENTS = 8
"""Segments without overlap that a record is cut into where their length is not given."""
UNEVEN = 0.5
"""Deviation of a sample from equal steps that is refused, in steps."""


def with_responses(
    data: xr.Dataset,
    excitation: str,
    *,
    segment: float | None = None,
    estimator: str = "H1",
) -> xr.Dataset:
    """Return a measurement with the frequency responses of all channels to one of them.

    sdypy-FRF averages over segments that overlap by half, each with a Hann window; where the
    excitation is that of a hammer, over one segment for each blow (`blows`), without it.

        H1 = S_fx / S_ff,  H2 = S_xx / S_xf,  coherence = |S_fx|^2 / (S_ff S_xx)

    Args:
        data: a measurement with at least two histories.
        excitation: name of the channel of the excitation, such as "force".
        segment: length of the segments [s], the reciprocal of the step of the frequency; None:
            an eighth of the record, or up to the next blow.
        estimator: one of `ESTIMATORS`.

    Returns:
        The measurement with `response(frequency, output)`, complex, and `coherence`, NaN of a
        single blow; what was done with blows is in the notes.

    Raises:
        CaseError: there is no such channel or estimator, the samples are not evenly spaced, the
            record is shorter than two segments, or it holds no whole blow.

    Source: N. M. M. Maia, J. M. M. Silva, Theoretical and Experimental Modal Analysis, 1997.
    """
    from sdypy.FRF import FRF

    if estimator not in ESTIMATORS:
        raise CaseError(f"estimator: expected one of {', '.join(ESTIMATORS)}, given {estimator!r}")
    first, outputs = _chosen(data, excitation)
    time: FloatArray = data["time"].to_numpy()
    step, n = _step(time), time.size
    force, motions = history_of(data, first), np.array([history_of(data, k) for k in outputs])
    if not np.ptp(force):
        raise CaseError(f"excitation: expected a channel that moves, given {excitation!r} at rest")
    struck = pulses(force)
    longest, whole = (n, "the record") if struck else (n // 2, "half the record")
    length = n // (1 if struck else SEGMENTS) if segment is None else round(segment / step)
    if not 8 <= length <= longest:
        raise CaseError(
            f"segment: expected from {8 * step:.3g} s to {whole}, {longest * step:.3g} s, given "
            f"{length * step:.3g} s"
        )
    exc, resp, decay, notes = force[None, None], motions[None], 0.0, list[str]()
    if struck:
        exc, resp, decay, notes = cut(time, force, motions, struck, length if segment else None)
        length = exc.shape[2]
    found = FRF(
        1, exc=exc, resp=resp, exc_type="f", resp_type="d", window="none" if struck else "hann",
        fft_len=length, nperseg=length, frf_estimator=estimator,
    )  # fmt: skip
    # in samples, and without conversions from velocity or acceleration: the ratio as it is
    responses = np.nan_to_num(found.get_FRF()[:, 0, :])
    coherence = np.nan_to_num(found.get_coherence()).real
    frequency = np.fft.rfftfreq(length, step)
    if struck:
        responses[:, 0] = 0.0  # the library takes the mean out, so nothing is known of it
        notes.insert(0, f"{len(exc)} blow(s), one segment of up to {length * step:.6g} s for each")
        if len(exc) == 1:
            coherence[:] = np.nan
            notes.append("coherence: of one segment it means nothing (always 1), and is left out")
    if decay:
        size = np.sqrt(found.S_FF[0, 0].real)
        responses, led = on_axis(frequency, responses, size, decay / step)
        peaks = ", ".join(f"{f:.5g}" for f in led) or "none"
        notes.append(f"exponential window, its damping taken out at the peaks: {peaks} Hz")
    data = data.assign_attrs(notes="\n".join(filter(None, [data.attrs.get("notes"), *notes])))
    return _with(data, frequency, (responses, coherence), (first, outputs))


def _chosen(data: xr.Dataset, excitation: str) -> tuple[int, list[int]]:
    """Return the numbers of the channels of the excitation and of the responses."""
    names = [str(name) for name in data["channel"].to_numpy()]
    variables = [str(name) for name in data["channel_variable"].to_numpy()]
    histories = [k for k, v in enumerate(variables) if v in data and "time" in data[v].dims]
    if excitation not in [names[k] for k in histories]:
        held = ", ".join(names[k] for k in histories) or "none"
        raise CaseError(f"excitation: expected one of the histories {held}, given {excitation!r}")
    first = names.index(excitation)
    outputs = [k for k in histories if k != first]
    if not outputs:
        raise CaseError("excitation: expected a response beside it, found none")
    return first, outputs


def _with(
    data: xr.Dataset,
    frequency: FloatArray,
    found: tuple[Values, FloatArray],
    channels: tuple[int, list[int]],
) -> xr.Dataset:
    """Return the measurement with responses and coherences, each of shape (outputs, n)."""
    first, outputs = channels
    names = [str(name) for name in data["channel"].to_numpy()]
    units = [str(u) for u in data["channel_units"].to_numpy()]
    ratios = [unit_of(f"({units[k]})/({units[first]})", names[k]).units for k in outputs]
    about = {
        "units": ratios[0] if len(set(ratios)) == 1 else "see response_units",
        "long_name": f"frequency response to {names[first]}",
    }
    data = data.assign_coords(
        frequency=("frequency", frequency, {"units": "Hz", "long_name": "frequency"}),
        output=[names[k] for k in outputs],
    )
    dims, of_coherence = ("frequency", "output"), {"units": "1", "long_name": "coherence"}
    data["response"] = (dims, found[0].T, about)
    data["coherence"] = (dims, found[1].T, of_coherence)
    data["response_units"] = (("output",), np.array(ratios), {"units": "1"})
    return data


def _step(time: FloatArray) -> float:
    """Return the time between samples [s].

    Raises:
        CaseError: the samples are not evenly spaced.
    """
    step = float((time[-1] - time[0]) / (time.size - 1))
    off = np.abs(time - time[0] - step * np.arange(time.size)) / step
    if off.max() > UNEVEN:
        raise CaseError(
            f"time: expected samples at equal steps, given one that is {off.max():.2g} steps off"
        )
    return step
