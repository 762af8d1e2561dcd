"""Frequency responses from measured histories: blows of a hammer, coherence, poles, pictures.

The blows of a hammer are found in the measured force, and the record is cut into a segment for
each. A segment reaches from before a blow to before the next. If the response decays in it, the
ratio of the spectra needs no window. If not, force and response are multiplied by exp(-a t); their
ratio is then H(iω + a), and `on_axis` leads it back to H(iω).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from scipy.interpolate import CubicSpline
from scipy.signal import detrend, find_peaks, resample_poly

from delam_fem.api import BoolArray, CaseError, FloatArray, spectra, style
from delam_fem.studies.signals.channels import Values
from delam_fem.studies.signals.reading import histories_in, history_named, history_of
from delam_fem.studies.signals.units import ratio_of

QUIET = 15.0
"""Largest force over the deviation of its noise, least for blows; noise alone has 4 to 6."""
MOST_LOUD = 0.1
"""Largest share of the time in which blows act."""
FEWEST = 6
"""Samples of a blow below which the integral of the force is wrong by 2 % and more."""
TRIGGER, CLEAR = 0.05, 6.0
"""Where a blow begins: share of the largest force, and multiple of the deviation of its noise."""
TOGETHER, SHORTEST = 0.1, 0.25
"""Shares of the longest segment: until a double hit, and below which a blow is left out."""
DECAYED, WINDOWED, FILLED = 0.005, 0.001, 4
"""Share of the response that may be left at the end without a window, and with one; such segments
are filled with zeros to that many times their length, to show peaks narrower than 1/length."""
IN_NOISE, FAINT = 5.0, 1e-3
"""Lines of a spectrum that show something: multiple of the median, share of the largest line."""
RESONANT, DRIVEN, EXPLAINED = 0.3, 0.1, 0.99
"""Peaks that are led back: least height in decades of |H|^2, least share of the largest force,
least share of the peak that its pole explains."""


CUT = 0.01
"""What is left of an impulse response at the end of half a segment with a Hann window."""
CLEAN = 1e-2
"""Least noise of a response over that of the noisiest, by which responses are weighted."""
OF_WINDOW = 0.2
"""Share of what a Hann window had added to a pole that counts as a standard error of its removal;
chosen by twelve records of noise, not derived."""
PARTS, SWEPT = 16, 3.0
"""Parts of a record in which the frequency of a sweep rises, and spectral lines by which the power
of a part may be wider than what is swept in it."""
AFTER_BURST = 1e-3
"""Share of a burst that may be left of the excitation in the last fifth of its record."""
MOST_PEAKS = 40
"""Peaks that are led back, the most prominent."""
OF_PEAK = 12
"""Lines on each side of a peak in a long segment, of which many are within the peak."""
EVEN = 1e-3
"""Share of a step up to which frequencies are multiples of it."""
STEPS, CONVERGED, LARGEST_STEP = 30, 1e-6, 0.02
"""Most steps of the roots; relative gain that ends them; their largest relative length."""
PASSES = 5
"""Passes over the peaks; each subtracts what the other modes add to a peak."""
COHERENT = 0.5
"""Coherence below which a line of a faint excitation is noise over noise, which a window taken out
would spread over the others."""


def pulses(force: FloatArray) -> list[tuple[int, int]]:
    """Return first and last sample, exclusive, of each pulse of a force that rests between them.

    Returns:
        The pulses in order of time; an empty list if the force is not one of blows.
    """
    size = np.abs(force - np.median(force))
    noise = float(_scatter(size))
    is_loud = size > max(TRIGGER * size.max(), CLEAR * noise)
    if size.max() <= QUIET * noise or is_loud.mean() > MOST_LOUD:
        return []
    edges = np.flatnonzero(np.diff(np.r_[False, is_loud, False].astype(int))).reshape(-1, 2)
    width = max(np.diff(edges))
    starts = np.r_[True, edges[1:, 0] - edges[:-1, 1] > width]  # else noise at the edge of a pulse
    return list(zip(edges[starts, 0].tolist(), edges[np.roll(starts, -1), 1].tolist(), strict=True))


def cut(
    time: FloatArray,
    force: FloatArray,
    response: FloatArray,
    struck: Sequence[tuple[int, int]],
    length: int | None = None,
) -> tuple[FloatArray, FloatArray, float, list[str]]:
    """Return the segments of a record of blows.

    Args:
        time: times of the samples, at equal steps [s], shape (n,).
        force: measured force, shape (n,).
        response: measured responses, shape (n_outputs, n).
        struck: pulses of the force.
        length: length of the segments in samples; None: up to the next blow.

    Returns:
        Forces, zero but for the pulses, shape (n_blows, 1, m); responses without their means, zero
        behind their ends, shape (n_blows, n_outputs, m); the decay a of the window per sample, 0
        without a window; notes for the user.

    Raises:
        CaseError: the record holds no whole blow.
    """
    width = max(end - start for start, end in struck)
    starts = np.array([start for start, _ in struck])
    spaces = np.diff(np.r_[starts, time.size])
    firsts = np.flatnonzero(np.r_[True, spaces[:-1] > TOGETHER * spaces.max()])
    ends = [*np.maximum(starts[firsts] - width, 0).tolist(), time.size]
    cuts = []
    notes = []
    for blow, begin, stop in zip(np.split(struck, firsts[1:]), ends, ends[1:], strict=False):
        at = f"blow at {time[blow[0, 0]]:.6g} s"
        quiet = int(blow[-1, 1]) + width
        if blow[0, 0] == 0 or stop <= max(begin + SHORTEST * spaces.max(), quiet):
            notes.append(f"{at}: left out, the record begins in it or the decay is cut off")
            continue
        if len(blow) > 1:
            notes.append(f"{at}: a double hit, again {np.diff(time[blow[:2, 0]])[0]:.3g} s later")
        cuts.append((begin, quiet, max(min(stop, begin + (length or stop)), quiet)))
    if not cuts:
        raise CaseError(f"excitation: expected a whole blow, given none ({'; '.join(notes)})")
    if width < FEWEST:
        notes.append(f"a blow lasts {width} samples, its force is known roughly: sample faster")
    lefts = np.array([_left(response[:, quiet:stop]) for _, quiet, stop in cuts])
    sizes = np.array([stop - begin for begin, _, stop in cuts])
    n = max(length or 0, sizes.max())
    decay = 0.0
    if lefts.max() > DECAYED:
        n = FILLED * n
        decay = float(np.max(np.log(lefts / WINDOWED + 1e-9) / sizes))
        disturbing = " and disturbs the next" if len(cuts) > 1 else ""
        notes.append(f"{100 * lefts.max():.2g} % of a response is left at its end{disturbing}")
    forces = np.zeros((len(cuts), 1, n))
    responses = np.zeros((len(cuts), len(response), n))
    for k, (begin, quiet, stop) in enumerate(cuts):
        forces[k, 0, : quiet - begin] = force[begin:quiet] - np.median(force)  # a sensor at rest
        responses[k, :, : stop - begin] = detrend(response[:, begin:stop], type="constant")
    window = np.exp(-decay * np.arange(n))
    return forces * window, responses * window, decay, notes


def _left(decaying: FloatArray) -> float:
    """Return the share of a response that is left at its end, by its slowest clear line.

    Lines of the last quarter are compared with those of the first, and led on to the whole.

    Args:
        decaying: shape (n_outputs, n).
    """
    n = decaying.shape[1] // 4
    if n < 8:
        return 1.0
    parts = np.stack([decaying[:, :n], decaying[:, -n:]])
    parts = np.hanning(n) * (parts - parts.mean(axis=2, keepdims=True))
    early, late = np.abs(np.fft.rfft(parts))[:, :, 2:]
    is_clear = late > IN_NOISE * np.median(late, axis=1, keepdims=True)
    is_clear &= early > FAINT * early.max(axis=1, keepdims=True)
    # the two quarters are 3/4 of the segment apart
    return float(np.minimum(np.max(late[is_clear] / early[is_clear], initial=0.0), 1.0) ** (4 / 3))


def on_axis(
    frequency: FloatArray, response: Values, force: FloatArray, decay: float, least: int = 3
) -> tuple[Values, FloatArray]:
    """Return responses H(iω) from those that an exponential window has made H(iω + a).

    About each peak H is r / (s - λ) and a straight line. The pole λ follows by linear least
    squares, which the window does not change; its term is exchanged for that at s = iω.

    Args:
        frequency: frequencies at equal steps [Hz], shape (n,).
        response: H(iω + a), shape (n_outputs, n).
        force: |F|, shape (n,).
        decay: a [1/s].
        least: least number of lines on each side of a peak that show its pole.

    Returns:
        H(iω); the frequencies of the peaks that were led back [Hz].

    Source: W. G. Halvorsen, D. L. Brown, "Impulse technique for structural frequency response
    testing", Sound and Vibration 11 (1977), for the window.
    """
    size = (np.abs(response) ** 2).sum(axis=0)
    heights = np.log10(size + np.finfo(float).tiny)
    peaks, about = find_peaks(heights, prominence=RESONANT)
    reach = max(least, int(np.ceil(0.5 * decay / frequency[1])))
    s = 2j * np.pi * frequency + decay
    is_driven = (force[peaks] > DRIVEN * force.max()) & (peaks > reach)
    order = np.argsort(-about["prominences"][is_driven], kind="stable")
    peaks = np.sort(peaks[is_driven][order[:MOST_PEAKS]])  # noise has thousands in long segments
    modes: dict[int, tuple[complex, Values]] = {k: (0.0, np.zeros(len(response))) for k in peaks}
    for k in np.tile(peaks, PASSES):
        near = slice(k - reach, k + reach + 1)
        pole, residue = modes[k]
        h = response[:, near] - sum(_terms(s[near], *mode) for mode in modes.values())
        h = h + np.outer(residue, 1.0 / (s[near] - pole))
        pole, h, line = _pole_beside_a_line(s[near], h, s[k])
        term = 1.0 / (s[near] - pole)
        term = term - (term @ line.conj()) @ line.T
        residue = h @ term.conj() / np.vdot(term, term)
        is_mode = pole.real < 0.0 and abs(pole.imag - s[k].imag) < reach * s[1].imag
        is_mode &= np.linalg.norm(np.outer(residue, term)) > EXPLAINED * np.linalg.norm(h)
        modes[k] = (pole, is_mode * residue)
    response_without_decay = response + sum(
        _terms(s - decay, *mode) - _terms(s, *mode) for mode in modes.values()
    )
    return response_without_decay, frequency[
        [k for k, (_, residue) in sorted(modes.items()) if residue.any()]
    ]


def _pole_beside_a_line(
    s: Values, values: Values, middle: complex
) -> tuple[complex, Values, Values]:
    """Return the pole λ of r / (s - λ) beside a straight line, which is projected out.

    As (s - λ) h = r is projected out with it, s h = λ h is left, by linear least squares.

    Args:
        s: where the responses are known, shape (n,) [1/s].
        values: responses, shape (n_outputs, n).
        middle: about which the line is [1/s].

    Returns:
        The pole; the responses without the line; an orthonormal basis of lines, shape (n, 2).
    """
    line, _ = np.linalg.qr(np.array([np.ones(s.size), s - middle]).T)
    h, sh = (v - (v @ line.conj()) @ line.T for v in (values, s * values))
    return complex(np.vdot(h, sh) / np.vdot(h, h)), h, line


def _terms(s: Values, pole: complex, residue: Values) -> Values:
    """Return a mode's part of the responses, r / (s - λ) + r* / (s - λ*), shape (n_outputs, n)."""
    term = np.outer(residue, 1.0 / (s - pole))
    conjugate = residue.conj()
    return np.asarray(term + np.outer(conjugate, 1.0 / (s - pole.conjugate())))


ESTIMATORS = ("H1", "H2", "Hv")
"""Estimators: noise in the responses, in the excitation, in both."""
SEGMENTS = 8
"""Segments without overlap that a record is cut into where their length is not given."""
UNEVEN = 0.5
"""Largest deviation of a sample from equal steps, in steps; more is refused."""


def with_responses(
    data: xr.Dataset,
    excitation: str,
    *,
    segment: float | None = None,
    estimator: str = "H1",
) -> xr.Dataset:
    """Return a measurement with the frequency responses of all channels to one of them.

    The window follows from the excitation: none of blows, sweeps and bursts, Hann of all others.

    sdypy-FRF averages over segments that overlap by half, each with a Hann window; where the
    excitation is that of a hammer, over one segment for each blow (`pulses`), without a window.

        H1 = S_fx / S_ff,  H2 = S_xx / S_xf,  coherence = |S_fx|^2 / (S_ff S_xx)

    Args:
        data: a measurement with at least two histories.
        excitation: name of the channel of the excitation, such as "force".
        segment: length of the segments [s], the reciprocal of the step of the frequency; None:
            an eighth of the record, or up to the next blow.
        estimator: one of `ESTIMATORS`.

    Returns:
        The measurement with `response(frequency, output)`, complex, and `coherence`, NaN of a
        single blow; what was done with blows is in the notes. Where segments are averaged also
        `psd(frequency, output)` and `psd_excitation(frequency)`, one-sided.

    Raises:
        CaseError: there is no such channel or estimator, the samples are not evenly spaced, the
            record is shorter than two segments, or it holds no whole blow.

    Source: N. M. M. Maia, J. M. M. Silva, Theoretical and Experimental Modal Analysis, 1997.
    """
    from sdypy.FRF import FRF

    if estimator not in ESTIMATORS:
        raise CaseError(f"estimator: expected one of {', '.join(ESTIMATORS)}, given {estimator!r}")
    first, outputs = chosen(data, excitation)
    time: FloatArray = data["time"].to_numpy()
    step = step_of(time)
    n = time.size
    force = history_of(data, first)
    motions = np.array([history_of(data, k) for k in outputs])
    if not np.ptp(force):
        raise CaseError(f"excitation: expected a channel that moves, given {excitation!r} at rest")
    struck = pulses(force)
    sweep = None if struck else swept(force, step)
    is_burst = not struck and ends_early(force)
    is_single = (bool(sweep) or is_burst) and segment is None
    longest, limit = (n, "the record") if struck else (n // 2, "half the record")
    length = n // (1 if struck else SEGMENTS) if segment is None else round(segment / step)
    if not 8 <= length <= longest:
        raise CaseError(
            f"segment: expected from {8 * step:.3g} s to {limit}, {longest * step:.3g} s, given "
            f"{length * step:.3g} s"
        )
    exc = force[None, None]
    resp = motions[None]
    decay = 0.0
    notes = list[str]()
    if struck:
        exc, resp, decay, notes = cut(time, force, motions, struck, length if segment else None)
        length = exc.shape[2]
    elif is_single:
        length = n
        decay = 0.0 if _is_over(motions) else -np.log(CUT) / n
        window = np.exp(-decay * np.arange(n))
        exc = exc * window
        resp = resp * window
    if sweep is not None:
        notes.append(_of_sweep(*sweep, is_single=is_single))
    elif is_single:
        notes.append("the excitation is a burst: one segment, without a window and a coherence")
    has_window = not struck and not is_single
    estimate = FRF(
        1, exc=exc, resp=resp, exc_type="f", resp_type="d", window="hann" if has_window else "none",
        fft_len=length, nperseg=length, frf_estimator=estimator,
    )  # fmt: skip
    # in samples, and without conversions from velocity or acceleration: the ratio as it is
    responses = np.nan_to_num(estimate.get_FRF()[:, 0, :])
    coherence = np.nan_to_num(estimate.get_coherence()).real
    frequency = np.fft.rfftfreq(length, step)
    if struck:
        responses[:, 0] = 0.0  # the library takes the mean out, so nothing is known of it
        notes.insert(0, f"{len(exc)} blow(s), one segment of up to {length * step:.6g} s for each")
        if len(exc) == 1:
            coherence[:] = np.nan
            notes.append("coherence: of one segment it means nothing (always 1), and is left out")
    if is_single:
        coherence[:] = np.nan
    damped = responses
    rate = decay / step
    if has_window:
        density = estimate.S_FF[0, 0].real
        is_nothing = (density < FAINT * density[1:].max()) & (coherence < COHERENT)
        damped, rate = _without_hann(_bridged(responses, is_nothing), step)
    if decay:
        size = np.sqrt(estimate.S_FF[0, 0].real)
        if is_single:  # the window makes the force small where the sweep is late, and it is known
            ends = sorted(sweep[:2]) if sweep else [0.0, np.inf]
            size = ((frequency >= ends[0]) & (frequency <= ends[1])).astype(np.float64)
        least = OF_PEAK if is_single else 3
        responses, led = on_axis(frequency, responses, size, decay / step, least)
        peaks = ", ".join(f"{f:.5g}" for f in led) or "none"
        notes.append(f"exponential window, its damping taken out at the peaks: {peaks} Hz")
    data = data.assign_attrs(notes="\n".join(filter(None, [data.attrs.get("notes"), *notes])))
    data = with_estimates(data, frequency, (responses, coherence), (first, outputs))
    if has_window:
        data = _with_densities(data, step, length, (first, outputs))
    if rate:
        about = {"units": data["response"].attrs["units"], "long_name": "damped response"}
        about |= {"decay": rate, "window": "Hann" if has_window else "exponential"}
        data["damped_response"] = (("frequency", "output"), damped.T, about)
    return data


def ends_early(force: FloatArray) -> bool:
    """Return whether an excitation is a burst: over before the last fifth of its record."""
    end = force.size // 5
    return bool(end) and float(np.ptp(force[-end:])) < AFTER_BURST * float(np.ptp(force))


def _with_densities(
    data: xr.Dataset, step: float, length: int, channels: tuple[int, list[int]]
) -> xr.Dataset:
    """Return the measurement with one-sided power spectral densities of all channels."""
    first, outputs = channels
    units = [str(u) for u in data["channel_units"].to_numpy()]
    histories = np.array([history_of(data, k) for k in (first, *outputs)])
    _, densities = spectra.densities(histories, step, length)
    squared = [f"({units[k]})²/Hz" for k in (first, *outputs)]
    same = squared[1] if len(set(squared[1:])) == 1 else "of each channel squared, per Hz"
    words = "one-sided power spectral density"
    data["psd"] = (("frequency", "output"), densities[1:].T, {"units": same, "long_name": words})
    about = {"units": squared[0], "long_name": f"{words} of the excitation"}
    data["psd_excitation"] = ("frequency", densities[0], about)
    return data


def _bridged(responses: Values, is_nothing: BoolArray) -> Values:
    """Return responses with straight lines where nothing is known, to 0 at the last line.

    Args:
        responses: shape (n_outputs, n).
        is_nothing: where nothing is known, shape (n_outputs, n).
    """
    bridged = responses.copy()
    for row, is_unknown in zip(bridged, is_nothing, strict=True):
        known = np.flatnonzero(~is_unknown)
        if 0 < known.size < row.size:
            ends = np.concatenate([[0], known, [row.size - 1]])
            values = np.concatenate([[row[known[0]].real], row[known], [0.0]])
            row[is_unknown] = np.interp(np.flatnonzero(is_unknown), ends, values)
    return bridged


def _without_hann(response: Values, step: float) -> tuple[Values, float]:
    """Return responses H(iω + a) free of the Hann window of the segments, and a [1/s].

    Averaged over segments, a cross spectrum is that of the response function times the
    autocorrelation of the window, which widens peaks. In half of a segment it is divided by that,
    and multiplied by exp(-a t), so that little is left at its end.

    Args:
        response: H1, H2 or Hv, shape (n_outputs, n // 2 + 1).
        step: time between samples [s].

    Source: J. S. Bendat, A. G. Piersol, Random Data, 2010, section 8.5 (bias of spectra).
    """
    n = 2 * (response.shape[1] - 1)
    half = n // 2
    decay = -np.log(CUT) / (half * step)
    window = np.hanning(n + 1)[:n]
    spectrum = np.abs(np.fft.rfft(window, 2 * n)) ** 2
    correlation = np.fft.irfft(spectrum)[:half]
    weight = np.exp(-decay * step * np.arange(half)) * correlation[0] / correlation
    impulse = np.fft.irfft(response)
    impulse[:, :half] *= weight
    impulse[:, half:] = 0.0
    return np.fft.rfft(impulse), float(decay)


def swept(force: FloatArray, step: float) -> tuple[float, float, float] | None:
    """Return first and last frequency [Hz] and rate [Hz/s] of a sweep; None: the force is none.

    In each of `PARTS` parts of a sweep one frequency has most of the power, and it rises or falls
    from part to part.

    Args:
        force: measured force, shape (n,).
        step: time between samples [s].
    """
    n = force.size // PARTS
    if n < 16:
        return None
    parts = force[: n * PARTS].reshape(PARTS, n)
    power = np.abs(np.fft.rfft(np.hanning(n) * (parts - parts.mean(axis=1, keepdims=True)))) ** 2
    largest = power.max(axis=1)
    parts_on = np.flatnonzero(largest > FAINT * largest.max())  # it may begin late or end early
    lines = np.arange(power.shape[1])
    middles = (power @ lines)[parts_on] / power.sum(axis=1)[parts_on]
    off = (lines - middles[:, None]) ** 2
    spreads = np.sqrt((power[parts_on] * off).sum(axis=1) / power.sum(axis=1)[parts_on])
    steps = np.diff(middles)
    is_sweep = len(steps) >= PARTS // 2 and (np.all(steps > 0.0) or np.all(steps < 0.0))
    if not is_sweep or np.any(spreads > np.abs(steps).max() + SWEPT):
        return None
    first, last = (float(middle) / (n * step) for middle in (middles[0], middles[-1]))
    return first, last, (last - first) / (len(steps) * n * step)


def _is_over(motions: FloatArray) -> bool:
    """Return whether all motions have decayed at the end of a record."""
    end = max(8, motions.shape[1] // 50)
    size = motions - motions.mean(axis=1, keepdims=True)
    return bool(np.all(np.ptp(size[:, -end:], axis=1) < DECAYED * np.ptp(size, axis=1)))


def _of_sweep(first: float, last: float, rate: float, *, is_single: bool) -> str:
    """Return what is said of a sweep."""
    text = f"the excitation is a sweep from about {first:.4g} to {last:.4g} Hz, {rate:.3g} Hz/s"
    if is_single:
        return f"{text}: the record is one segment, without a Hann window and without a coherence"
    return (
        f"{text}: a segment holds only a part of it, and a mode that decays for longer is cut off; "
        "peaks and damping may be wrong by 10 %; leave out --segment"
    )


def chosen(data: xr.Dataset, excitation: str) -> tuple[int, list[int]]:
    """Return the numbers of the channels of the excitation and of the responses."""
    first = history_named(data, excitation, "excitation")
    outputs = [k for k in histories_in(data) if k != first]
    if not outputs:
        raise CaseError("excitation: expected a response beside it, found none")
    return first, outputs


def with_estimates(
    data: xr.Dataset,
    frequency: FloatArray,
    found: tuple[Values, FloatArray],
    channels: tuple[int, list[int]],
) -> xr.Dataset:
    """Return the measurement with responses and coherences, each of shape (outputs, n)."""
    first, outputs = channels
    names = [str(name) for name in data["channel"].to_numpy()]
    units = [str(u) for u in data["channel_units"].to_numpy()]
    ratios = [ratio_of(units[k], units[first]) for k in outputs]
    about = {
        "units": ratios[0] if len(set(ratios)) == 1 else "see response_units",
        "long_name": f"frequency response to {names[first]}",
        "excitation": names[first],
        "excitation_units": units[first],
    }
    data = data.assign_coords(
        frequency=("frequency", frequency, {"units": "Hz", "long_name": "frequency"}),
        output=[names[k] for k in outputs],
    )
    dims = ("frequency", "output")
    of_coherence = {"units": "1", "long_name": "coherence"}
    data["response"] = (dims, found[0].T, about)
    data["coherence"] = (dims, found[1].T, of_coherence)
    data["response_units"] = (("output",), np.array(ratios), {"units": "1"})
    return data


def step_of(time: FloatArray) -> float:
    """Return the time between samples [s].

    Raises:
        CaseError: the samples are not evenly spaced.
    """
    step = float((time[-1] - time[0]) / (time.size - 1))
    off = np.abs(time - time[0] - step * np.arange(time.size)) / step
    if off.max() > UNEVEN:
        steps = np.diff(time)
        k = int(np.argmax(steps))
        raise CaseError(
            f"time: expected samples at equal steps, given one that is {off.max():.2g} steps off, "
            f"and the longest step, {steps[k] / np.median(steps):.3g} times the usual one, from "
            f"{time[k]:.6g} to {time[k + 1]:.6g} s; --between takes a part without holes, --fill "
            "interpolates short ones"
        )
    return step


ORDER = 20
"""Highest order of the polynomials; poles of its upper half are compared."""
NEAR = 0.05
"""Relative distance from a peak within which a pole belongs to it."""
LARGEST_DAMPING = 0.3
LEAST_DAMPING = 1e-3
"""Damping ratio with which a fit begins at least."""
ABOUT = 3
"""Lines on each side of a peak that show its root, where they are not even."""
PROMINENCE = 0.05
"""Height of a peak above its surroundings, in decades of the summed amplitude squared."""
AGREEING, STABLE = 0.7, 0.003
"""Share of the orders that must have a pole, and its largest relative scatter of frequency."""


@dataclass(frozen=True)
class Pole:
    """A natural frequency with its damping.

    Attributes:
        frequency: natural frequency [Hz].
        damping: ratio of critical damping [-].
        frequency_error: two standard errors of the frequency [Hz].
        damping_error: two standard errors of the damping ratio [-].
    """

    frequency: float
    damping: float
    frequency_error: float
    damping_error: float


def poles(data: xr.Dataset, lower: float, upper: float) -> tuple[list[Pole], dict[str, float]]:
    """Return the poles between two frequencies, and what they leave of each response.

    Each response is divided by its size there, so that none counts more for its unit. Each peak of
    their sum gets the median of the poles near it over the orders of the polynomial, by the
    least-squares complex frequency method, if enough orders have one. All are then fitted together
    by least squares. Where windows have damped the responses, H(iω + a) is fitted, whose poles are
    by a away from those of H(iω): nothing of the window is left in them.

    Args:
        data: a measurement with `response(frequency, output)`.
        lower: least frequency [Hz].
        upper: largest frequency [Hz].

    Returns:
        The poles by frequency; by name of the response, the rms of what the poles and a smooth
        remainder leave of it between the frequencies, relative to it.

    Raises:
        CaseError: sdypy-EMA is not installed, there are no responses, or the range holds none.
    """
    try:
        ema: Any = import_module("sdypy.EMA")
    except ImportError:
        raise CaseError(
            'poles: need the package sdypy-EMA; install it by pip install "delam_fem[ema]"'
        ) from None
    if "response" not in data:
        raise CaseError("poles: expected frequency responses, found none; --excitation makes them")
    frequency: FloatArray = data["frequency"].to_numpy()
    step = float(np.median(np.diff(frequency)))
    least = frequency[0] if frequency[0] > step else 0.0
    if not least <= lower < upper <= frequency[-1] or upper - lower < 4 * step:
        raise CaseError(
            f"poles: expected a range from {least:.6g} to {frequency[-1]:.6g} Hz, at least "
            f"{4 * step:.3g} Hz wide, given {lower:g} to {upper:g}"
        )
    is_in = (frequency >= lower) & (frequency <= upper) & (frequency > 0.0)
    response = np.nan_to_num(data["response"].to_numpy().T)
    size = np.sqrt(np.mean(np.abs(response[:, is_in]) ** 2, axis=1, keepdims=True))
    size[size == 0.0] = 1.0
    damped = response / size
    decay = 0.0
    if "damped_response" in data:
        damped = np.nan_to_num(data["damped_response"].to_numpy().T) / size
        decay = float(data["damped_response"].attrs["decay"])
    lines, rows = _on_multiples(frequency, damped, step)
    if len(lines) < ORDER + 2:
        raise CaseError(
            f"poles: expected responses of at least {ORDER + 2} lines, given {len(lines)}; take "
            "longer segments, or a multisine with a smaller spacing"
        )
    model = ema.Model(
        frf=rows, freq=lines, lower=lower, upper=upper, pol_order_high=ORDER,
        frf_form="receptance",
    )  # fmt: skip
    model.get_poles(method="lscf", show_progress=False)
    roots = [np.asarray(every) + decay for every in model.all_poles]
    starts: list[complex] = []
    for peak in _peaks(frequency, response / size, lower, upper):
        if all(abs(abs(start) / (2.0 * np.pi) - peak) > NEAR * peak for start in starts):
            start = _at_peak(roots, peak)
            if start is None and lines is not frequency:  # between its lines nothing is known
                start = _of_lines(2j * np.pi * frequency + decay, damped, frequency, peak)
            starts += filter(None, [start])
    names = [str(name) for name in data["output"].to_numpy()]
    if not starts:
        return [], dict.fromkeys(names, 1.0)
    s = 2j * np.pi * frequency[is_in] + decay
    is_averaged = bool(decay) and data["damped_response"].attrs["window"] == "Hann"
    n_dependent = max(1.0, (2.0 if is_averaged else 0.5) * decay / step)
    wanted = damped[:, is_in]
    roots_at_first, _, shares = _fitted(s, wanted, np.array(starts), 3, n_dependent)
    wanted = wanted / np.maximum(shares, CLEAN * shares.max())[:, None]  # noise counts as it is
    fitted, errors, shares = _fitted(s, wanted, roots_at_first, 3, n_dependent)
    others, _, _ = _fitted(s, wanted, fitted, 4, n_dependent)
    if is_averaged:
        on_the_axis = (response / size)[:, is_in]
        widened, _, _ = _fitted(s - decay, on_the_axis, fitted, 3, n_dependent)
        errors = np.hypot(errors, OF_WINDOW * np.abs(widened - fitted)[:, None])
    result = []
    for root, error, other in zip(fitted, errors, others, strict=True):
        pole = _pole(
            root, 2.0 * np.hypot(error, [abs((other - root).real), abs((other - root).imag)])
        )
        if 0.0 < pole.damping < LARGEST_DAMPING and pole.frequency_error < NEAR * pole.frequency:
            result.append(pole)
    return sorted(result, key=lambda pole: pole.frequency), dict(zip(names, shares, strict=True))


def _on_multiples(frequency: FloatArray, values: Values, step: float) -> tuple[FloatArray, Values]:
    """Return responses at whole multiples of the step, as the library takes them for."""
    offset = frequency[0] / step
    if abs(offset - round(offset)) < EVEN:
        return frequency, values
    moved = step * np.arange(np.ceil(offset), np.floor(frequency[-1] / step) + 1)
    return moved, CubicSpline(frequency, values, axis=1)(moved)


def _pole(root: complex, error: FloatArray) -> Pole:
    """Return a root λ with the errors of its real and imaginary part [1/s] as a pole."""
    size = abs(root)
    damping = -root.real / size
    # d|λ| = (Re λ dRe + Im λ dIm)/|λ|; damping -Re λ/|λ| changes by -(1 - D²) dRe/|λ| and so on
    of_size = float(np.hypot(root.real * error[0], root.imag * error[1])) / size
    of_damping = (
        float(
            np.hypot((1.0 - damping**2) * error[0], damping * np.sqrt(1.0 - damping**2) * error[1])
        )
        / size
    )
    return Pole(size / (2.0 * np.pi), damping, of_size / (2.0 * np.pi), of_damping)


def _peaks(frequency: FloatArray, values: Any, lower: float, upper: float) -> FloatArray:
    """Return the frequencies at which the summed responses have peaks, the highest first."""
    size = (np.abs(values) ** 2).sum(axis=0)
    peak_rows, _ = find_peaks(np.log10(np.maximum(size, 1e-300)), prominence=PROMINENCE)
    peaks: FloatArray = frequency[peak_rows[np.argsort(-size[peak_rows])]]
    return peaks[(peaks >= lower) & (peaks <= upper)]


def _at_peak(roots: Sequence[Values], peak: float) -> complex | None:
    """Return the root near a peak on which the orders agree; None: they do not.

    Args:
        roots: roots of each order [1/s].
        peak: frequency of the peak [Hz].
    """
    near = []
    for every in roots[len(roots) // 2 :]:
        sizes = np.abs(every) / (2.0 * np.pi)
        damping = -every.real / np.abs(every)
        fits = (np.abs(sizes - peak) < NEAR * peak) & (damping > 0.0) & (every.imag > 0.0)
        fits &= damping < LARGEST_DAMPING
        if fits.any():
            near.append(every[fits][np.argmin(np.abs(sizes[fits] - peak))])
    if len(near) < AGREEING * (len(roots) - len(roots) // 2):
        return None
    table = np.array(near)
    middle = complex(np.median(table.real), np.median(table.imag))
    scatter = float(_scatter(np.abs(table) - abs(middle)))
    return None if scatter > STABLE * abs(middle) else middle


def _of_lines(s: Values, values: Values, frequency: FloatArray, peak: float) -> complex | None:
    """Return the root of the lines about a peak, of any distances; None: they show none.

    Args:
        s: where the responses are known, shape (n,) [1/s].
        values: responses, shape (n_outputs, n).
        frequency: shape (n,) [Hz].
        peak: frequency of the peak [Hz].
    """
    k = int(np.argmin(np.abs(frequency - peak)))
    near = slice(max(0, k - ABOUT), k + ABOUT + 1)
    root, _, _ = _pole_beside_a_line(s[near], values[:, near], s[k])
    size = abs(root)
    if abs(size / (2.0 * np.pi) - peak) > NEAR * peak or root.imag < 0.0:
        return None
    damping = min(max(-root.real / size, LEAST_DAMPING), LARGEST_DAMPING)
    return complex(-damping * size, size * np.sqrt(1.0 - damping**2))


def _fitted(
    s: Values, values: Values, roots: Values, n_terms: int, n_dependent: float
) -> tuple[Values, FloatArray, FloatArray]:
    """Return roots, fitted together with residues and a smooth remainder of each response.

        H(s) = sum of r / (s - λ) + r* / (s - λ*), and b/s² + c + d s + …

    The residues are linear and projected out (variable projection); Gauss and Newton's method takes
    steps of the roots.

    Args:
        s: where the responses are known, shape (n,) [1/s].
        values: responses, shape (n_outputs, n).
        roots: roots to begin with, shape (n_roots,).
        n_terms: terms of the remainder.
        n_dependent: how many lines next to each other share their noise.

    Returns:
        The roots; standard errors of their real and imaginary parts, shape (n_roots, 2), by noise
        that is even or as it is left at each line, whichever is larger; the rms of what is left of
        each response, relative to it.

    Source: G. H. Golub, V. Pereyra, "Separable nonlinear least squares: the variable projection
    method and its applications", Inverse Problems 19 (2003); the Jacobian is that of Kaufman.
    """
    scale = np.abs(s).max()
    x = s / scale
    smooth = np.array([x**-2, np.ones_like(x), x, x**2][:n_terms])
    remainder = _stacked([*smooth, *(1j * smooth)]).T
    wanted = _stacked(values)
    left = np.inf
    jacobian = np.zeros((1, 1))
    remaining = wanted
    step = np.zeros(2 * roots.size)
    for _ in range(STEPS):
        trial = roots + step[::2] + 1j * step[1::2]
        basis, parts = _basis(s, trial, remainder)
        residues = np.linalg.lstsq(basis, wanted.T, rcond=None)[0]
        remaining_now = wanted - (basis @ residues).T
        size = float(np.sum(remaining_now**2))
        if size > left:
            step = 0.5 * step
            continue
        is_done = size > (1.0 - CONVERGED) * left
        roots = trial
        left = size
        remaining = remaining_now
        q = np.linalg.qr(basis)[0]
        slopes = []
        for k, term in enumerate(parts):
            r = residues[2 * k] + 1j * residues[2 * k + 1]
            direct = r[:, None] * term[0] ** 2
            mirrored = r.conj()[:, None] * term[1] ** 2
            slopes += [_stacked(direct + mirrored), _stacked(1j * (direct - mirrored))]
        jacobian = np.array([(slope - (slope @ q) @ q.T).ravel() for slope in slopes]).T
        step = np.linalg.lstsq(jacobian, remaining.ravel(), rcond=None)[0]
        largest = LARGEST_STEP * np.abs(roots)
        step *= min(
            1.0, float(np.min(largest / np.maximum(np.abs(step[::2] + 1j * step[1::2]), 1e-300)))
        )
        if is_done:
            break
    n_free = max(1.0, wanted.size / n_dependent - 2 * roots.size - basis.shape[1] * len(values))
    inverse = np.linalg.pinv(jacobian)
    even = np.sum(inverse**2, axis=1) * left / n_free
    uneven = (inverse**2) @ remaining.ravel() ** 2 * wanted.size / n_free
    errors = np.sqrt(np.maximum(even, uneven)).reshape(-1, 2)
    shares = np.linalg.norm(remaining, axis=1) / np.linalg.norm(wanted, axis=1)
    return roots, errors, shares


def _basis(
    s: Values, roots: Values, remainder: FloatArray
) -> tuple[FloatArray, list[tuple[Values, Values]]]:
    """Return the columns of residues and remainder, real over imaginary parts, and 1/(s - λ)."""
    parts = [(1.0 / (s - root), 1.0 / (s - root.conjugate())) for root in roots]
    columns = [column for a, b in parts for column in (a + b, 1j * (a - b))]
    return np.hstack([_stacked(columns).T, remainder]), parts


def _stacked(values: Any) -> FloatArray:
    """Return complex rows as real ones, the real parts before the imaginary ones."""
    rows = np.asarray(values)
    return np.hstack([rows.real, rows.imag])


def _scatter(deviations: FloatArray) -> FloatArray:
    """Return the standard deviation of normal numbers by the median of their deviations."""
    return np.asarray(1.4826 * np.median(np.abs(deviations), axis=0))


ORDERS = (4, 6, 8)
"""Numbers of damped exponentials, two for each mode: 2, 3 or 4 modes may be close together."""
CYCLES = 10.0
"""Length of a segment in cycles of the least frequency, where it is not given."""
OVERSAMPLED = 4.0
"""Rate to which a record is thinned, over its highest frequency."""


def with_free_vibrations(
    data: xr.Dataset, channel: str, lower: float, upper: float, segment: float | None = None
) -> xr.Dataset:
    """Return a measurement with frequency and damping of a free vibration over time.

    Each segment is fitted by a sum of damped exponentials, by the matrix pencil. Of those between
    the two frequencies the one with the most energy counts. Another mode close by is another
    exponential and does no harm; a segment in which the structure changes has large errors.

    Args:
        data: a measurement, or the result of a run.
        channel: name of a history.
        lower: least frequency [Hz].
        upper: largest frequency [Hz].
        segment: length of the segments, which overlap by half [s]; None: `CYCLES` of the least
            frequency.

    Returns:
        The measurement with `free_frequency(free_time)`, `free_damping`, `free_amplitude` at the
        beginning of the segment, and standard errors; NaN where nothing vibrates.

    Raises:
        CaseError: there is no such history, or the range or the segments do not suit it.

    Source: Y. Hua, T. K. Sarkar, "Matrix pencil method for estimating parameters of exponentially
    damped/undamped sinusoids in noise", IEEE Trans. ASSP 38 (1990).
    """
    number = history_named(data, channel, "free")
    time: FloatArray = data["time"].to_numpy()
    step = step_of(time)
    thinned = max(1, int(1.0 / (OVERSAMPLED * upper * step)))
    segment = CYCLES / max(lower, 1e-9) if segment is None else segment
    n = round(segment / (thinned * step))
    least = 4 * ORDERS[-1]
    if not 0.0 <= lower < upper < 0.4 / step or not least <= n <= time.size // thinned:
        raise CaseError(
            f"free: expected LOW below HIGH up to {0.4 / step:.6g} Hz, and segments from "
            f"{least * thinned * step:.3g} s to the whole record, given {lower:g} to {upper:g} Hz "
            f"and {segment:g} s"
        )
    values = resample_poly(history_of(data, number), 1, thinned, padtype="line")
    starts = np.arange(0, values.size - n + 1, max(1, n // 2))
    vibrations = [_strongest(values[k : k + n], thinned * step, lower, upper) for k in starts]
    at = {"units": "s", "long_name": "middle of the segment"}
    middles = time[0] + (starts + 0.5 * (n - 1)) * thinned * step
    data = data.assign_coords(free_time=("free_time", middles, at))
    units = str(data["channel_units"].to_numpy()[number])
    for (name, unit), column in zip(FREE.items(), np.transpose(vibrations), strict=True):
        words = f"{name.replace('_', ' ')} of the free vibration of {channel}"
        about = {"units": unit or units, "long_name": words, "segment": segment}
        data[f"free_{name}"] = ("free_time", column, about)
    return data


FREE = {"frequency": "Hz", "frequency_error": "Hz", "damping": "1", "damping_error": "1",
        "amplitude": ""}  # fmt: skip
"""Variables `free_…` with their units."""


def _strongest(
    values: FloatArray, step: float, lower: float, upper: float
) -> tuple[float, float, float, float, float]:
    """Return the `FREE` numbers of the strongest mode between two frequencies.

    They are medians over the orders. The errors hold the standard deviation of the orders, and the
    effect of the residual on the poles, by linear least squares of the sum and its derivatives.
    """
    t = step * np.arange(values.size)
    modes = []
    rows = np.lib.stride_tricks.sliding_window_view(values, values.size // 2 + 1)
    vectors = np.linalg.svd(rows, full_matrices=False)[2]
    for order in ORDERS:
        # the first vectors span the exponentials: a shift by a sample multiplies each by its z
        shifted = vectors[:order]
        z = np.linalg.eigvals(np.linalg.lstsq(shifted[:, :-1].T, shifted[:, 1:].T, rcond=None)[0])
        roots = np.log(z[np.abs(z) > 0.5].astype(complex)) / step
        sums = np.exp(np.outer(t, roots))
        sizes = np.linalg.lstsq(sums, values.astype(complex), rcond=None)[0]
        residual = values - (sums @ sizes).real
        noise = float(np.sqrt(residual @ residual / (values.size - 2 * order)))
        size = np.abs(roots) / (2.0 * np.pi)
        damping = -roots.real / np.abs(roots)
        fits = (roots.imag > 0.0) & (lower < size) & (size < upper) & (damping > -LARGEST_DAMPING)
        fits &= damping < LARGEST_DAMPING
        if not fits.any():
            continue
        k = int(
            np.argmax(np.where(fits, np.abs(sizes) ** 2 * (np.abs(sums) ** 2).sum(axis=0), 0.0))
        )
        slopes = t[:, None] * sums * sizes
        # how the root λ_k follows noise in each sample; its imaginary part is the frequency
        of_root = np.linalg.pinv(np.hstack([sums, slopes]))[roots.size + k]
        errors = noise * np.linalg.norm([of_root.imag, of_root.real], axis=1) / np.abs(roots[k])
        modes.append([size[k], size[k] * errors[0], damping[k], errors[1], 2.0 * np.abs(sizes[k])])
    if len(modes) < 2:
        return (np.nan,) * 5
    table = np.array(modes)
    result = np.median(table, axis=0)
    scatter = np.sqrt(((table - result) ** 2).sum(axis=0) / (len(table) - 1))
    result[[1, 3]] = np.hypot(result[[1, 3]], scatter[[0, 2]])
    return tuple(result.tolist())


def responses(data: xr.Dataset) -> Figure:
    """Draw amplitudes, a panel for each unit, phases and, where there is one, the coherence.

    Where the drive has no energy there is no response, and nothing is drawn.
    """
    names = [str(name) for name in data["output"].to_numpy()]
    colours = style.lamina_colours(len(names))
    units = [str(data["response"].attrs.get("units", ""))] * len(names)
    if "response_units" in data:
        units = [str(unit) for unit in data["response_units"].to_numpy()]
    groups = list(dict.fromkeys(units))
    data = data.isel(frequency=data["frequency"].to_numpy() > 0.0)  # nothing is known at 0 Hz
    f = data["frequency"].to_numpy()
    h = data["response"].to_numpy()
    h = np.where(h == 0.0, np.nan, h)
    has_coherence = "coherence" in data and bool(np.isfinite(data["coherence"]).any())
    ratios = [2] * len(groups) + [1] * (1 + has_coherence)
    figure, panels = style.stacked(
        len(ratios), 1.9 * sum(ratios), sharex=True, height_ratios=ratios
    )
    phases = panels[len(groups)]
    for k, (name, colour) in enumerate(zip(names, colours, strict=True)):
        panel = panels[groups.index(units[k])]
        marker = "." if np.isnan(h[:, k]).any() else None  # single lines between what is left out
        panel.semilogy(f, np.abs(h[:, k]), color=colour, label=name, marker=marker)
        phases.plot(f, np.degrees(np.angle(h[:, k])), ".", markersize=2, color=colour)
        if has_coherence:
            panels[-1].plot(f, data["coherence"].to_numpy()[:, k], color=colour)
    for panel, unit in zip(panels, groups, strict=False):
        panel.set_ylabel(f"amplitude [{unit}]")
        style.legend_above(panel)
    phases.set(ylabel="phase [°]", ylim=(-190, 190), yticks=[-180, -90, 0, 90, 180])
    if has_coherence:
        panels[-1].set(ylabel="coherence [–]", ylim=(0.0, 1.05))
    style.label_x(panels, "frequency [Hz]")
    figure.suptitle(str(data["response"].attrs.get("long_name", "frequency responses")))
    return figure


def free_vibration(data: xr.Dataset) -> Figure:
    """Draw frequency and damping of a free vibration over time, where the errors are small."""
    figure, panels = style.stacked(2, 5.0, sharex=True)
    data = data.isel(free_time=data["free_frequency_error"] < STABLE * data["free_frequency"])
    for panel, name, unit, factor in zip(
        panels, ("frequency", "damping"), ("Hz", "%"), (1, 100), strict=True
    ):
        values, errors = (factor * data[f"free_{column}"] for column in (name, f"{name}_error"))
        panel.errorbar(data["free_time"], values, 2.0 * errors, fmt=".", color=style.BLUE)
        panel.set_ylabel(f"{name} [{unit}]\n± two errors")
    style.label_x(panels, "time [s]")
    figure.suptitle(str(data["free_frequency"].attrs["long_name"]))
    return figure
