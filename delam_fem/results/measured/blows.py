"""Find the blows of a hammer in a measured force, and cut the record into a segment for each.

A segment reaches from before a blow to before the next. If the response decays in it, the ratio of
the spectra needs no window. If not, force and response are multiplied by exp(-a t); their ratio is
then H(iω + a), and `on_axis` leads it back to H(iω).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import detrend, find_peaks

from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.measured.columns import Values

QUIET = 15.0
"""Largest force over the deviation of its noise from which it is of blows; noise has 4 to 6."""
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
"""Lines that tell what is left: above this multiple of the median and share of the largest."""
PROMINENCE, DRIVEN, EXPLAINED = 0.3, 0.1, 0.99
"""Peaks that are led back: decades of |H|^2, share of the largest force, size in the pole."""


PASSES = 5
"""Passes over the peaks; each leaves out what the others add to a peak."""


def pulses(force: FloatArray) -> list[tuple[int, int]]:
    """Return first and last sample, exclusive, of each pulse of a force that rests between them.

    Returns:
        In order of time; none: the force is not that of blows.
    """
    size = np.abs(force - np.median(force))
    noise = 1.4826 * float(np.median(size))  # deviation of a normal number by its median
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
        time: of the samples, at equal steps [s], shape (n,).
        force: shape (n,).
        response: shape (n_outputs, n).
        struck: pulses of the force.
        length: of the segments in samples; None: up to the next blow.

    Returns:
        Nothing of the force but its pulses, shape (n_blows, 1, m); responses without their means,
        zero behind their ends, shape (n_blows, n_outputs, m); a of the window per sample, 0 where
        there is none; what a user has to know.

    Raises:
        CaseError: the record holds no whole blow.
    """
    width = max(end - start for start, end in struck)
    starts = np.array([start for start, _ in struck])
    spaces = np.diff(np.r_[starts, time.size])
    firsts = np.flatnonzero(np.r_[True, spaces[:-1] > TOGETHER * spaces.max()])
    ends = [*np.maximum(starts[firsts] - width, 0).tolist(), time.size]
    cuts, notes = [], []
    for own, begin, stop in zip(np.split(struck, firsts[1:]), ends, ends[1:], strict=False):
        at, quiet = f"blow at {time[own[0, 0]]:.6g} s", int(own[-1, 1]) + width
        if own[0, 0] == 0 or stop <= max(begin + SHORTEST * spaces.max(), quiet):
            notes.append(f"{at}: left out, the record begins in it or the decay is cut off")
            continue
        if len(own) > 1:
            notes.append(f"{at}: a double hit, again {np.diff(time[own[:2, 0]])[0]:.3g} s later")
        cuts.append((begin, quiet, max(min(stop, begin + (length or stop)), quiet)))
    if not cuts:
        raise CaseError(f"excitation: expected a whole blow, given none ({'; '.join(notes)})")
    if width < FEWEST:
        notes.append(f"a blow lasts {width} samples, its force is known roughly: sample faster")
    lefts = np.array([_left(response[:, quiet:stop]) for _, quiet, stop in cuts])
    sizes = np.array([stop - begin for begin, _, stop in cuts])
    n, decay = max(length or 0, sizes.max()), 0.0
    if lefts.max() > DECAYED:
        n, decay = FILLED * n, float(np.max(np.log(lefts / WINDOWED + 1e-9) / sizes))
        disturbing = " and disturbs the next" if len(cuts) > 1 else ""
        notes.append(f"{100 * lefts.max():.2g} % of a response is left at its end{disturbing}")
    forces, responses = np.zeros((len(cuts), 1, n)), np.zeros((len(cuts), len(response), n))
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
    return float(np.minimum(np.max(late[is_clear] / early[is_clear], initial=0.0), 1.0) ** (4 / 3))


def on_axis(
    frequency: FloatArray, response: Values, force: FloatArray, decay: float
) -> tuple[Values, FloatArray]:
    """Return responses H(iω) of those behind an exponential window, H(iω + a).

    About each peak H is r / (s - λ) and a straight line. The pole λ follows by linear least
    squares, which the window does not change; its term is exchanged for that at s = iω.

    Args:
        frequency: at equal steps [Hz], shape (n,).
        response: H(iω + a), shape (n_outputs, n).
        force: |F|, shape (n,).
        decay: a [1/s].

    Returns:
        H(iω); the frequencies of the peaks that were led back [Hz].

    Source: W. G. Halvorsen, D. L. Brown, "Impulse technique for structural frequency response
    testing", Sound and Vibration 11 (1977), for the window.
    """
    size = (np.abs(response) ** 2).sum(axis=0)
    peaks, _ = find_peaks(np.log10(size + np.finfo(float).tiny), prominence=PROMINENCE)
    reach = max(3, int(np.ceil(0.5 * decay / frequency[1])))
    s = 2j * np.pi * frequency + decay
    peaks = peaks[(force[peaks] > DRIVEN * force.max()) & (peaks > reach)]
    modes: dict[int, tuple[complex, Values]] = {k: (0.0, np.zeros(len(response))) for k in peaks}
    for k in np.tile(peaks, PASSES):
        near = slice(k - reach, k + reach + 1)
        pole, residue = modes[k]
        h = response[:, near] - sum(_terms(s[near], *mode) for mode in modes.values())
        h = h + np.outer(residue, 1.0 / (s[near] - pole))
        line, _ = np.linalg.qr(np.array([np.ones(s[near].size), s[near] - s[k]]).T)
        h, sh = (v - (v @ line.conj()) @ line.T for v in (h, s[near] * h))
        pole = complex(np.vdot(h, sh) / np.vdot(h, h))
        term = 1.0 / (s[near] - pole)
        term = term - (term @ line.conj()) @ line.T
        residue = h @ term.conj() / np.vdot(term, term)
        is_mode = pole.real < 0.0 and abs(pole.imag - s[k].imag) < reach * s[1].imag
        is_mode &= np.linalg.norm(np.outer(residue, term)) > EXPLAINED * np.linalg.norm(h)
        modes[k] = (pole, is_mode * residue)
    found = response + sum(_terms(s - decay, *own) - _terms(s, *own) for own in modes.values())
    return found, frequency[[k for k, (_, residue) in sorted(modes.items()) if residue.any()]]


def _terms(s: Values, pole: complex, residue: Values) -> Values:
    """Return what a mode adds to responses, r / (s - λ) + r* / (s - λ*), shape (n_outputs, n)."""
    own, conjugate = np.outer(residue, 1.0 / (s - pole)), residue.conj()
    return np.asarray(own + np.outer(conjugate, 1.0 / (s - pole.conjugate())))
