"""Map how well excitations show a delamination, and recommend one.

With an opening at rest the motion depends on g₀/A, the opening over the amplitude of the base; the
map then has this ratio as a second axis. A delamination that is closed at rest has no such axis:
twice the excitation gives exactly twice the motion.
"""

from __future__ import annotations

import math
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from delam_fem.api import (
    BoolArray,
    Case,
    CaseError,
    Finding,
    FloatArray,
    Picture,
    Report,
    RunContext,
    assemble,
    style,
)
from delam_fem.studies.detection.detect import drive_responses, intact, per_shape
from delam_fem.studies.detection.indices import SHARE, mark, repeated
from delam_fem.studies.detection.population import PERIODS, SAMPLES, SETTLED, scanned
from delam_fem.studies.detection.study import Excite
from delam_fem.studies.executors import ExecutorName
from delam_fem.studies.linear import settling_periods
from delam_fem.studies.modes.frequencies import structure_modes
from delam_fem.studies.signals.scan import Shapes, surface_of
from delam_fem.studies.sweeps.grid import Axis, ScanRecord

RATIOS = (0.1, 0.3, 1.0, 3.0, 10.0)
"""Values of g₀/A, if there is an opening: from one that hardly matters to one that hardly closes.
"""
NEAR = 0.04
"""A frequency is avoided if its double is nearer to a resonance of the beam, relatively. So far
away, a mode with the damping ratio of the presets, 0.005, answers with an eighth of its peak."""
MISLEADS = 1.0 / SHARE
"""A frequency is avoided if its contrast is below this: points outside are marked, too."""
OPENS = 0.3
"""A mode is an opening mode if it opens a delamination by this share of its largest deflection. In
the presets `embedded` and `edge` the lowest mode, which moves the whole beam, opens one by 0.27 and
0.28; the others that open one reach 0.64 to 1.9."""
SURE = 0.9
"""Least rate of calls of a recommended excitation, that of a90 in a probability of detection."""
N_MODES = 12
"""Modes among which resonances are looked for; in these presets they reach 1.1 and 1.6 kHz."""
_REPETITIONS = 50
"""Repetitions with other noise; they know a rate of 0.9 to 0.04, one standard error."""


@dataclass(frozen=True)
class ExcitationMap(Finding):
    """How well each excitation shows a delamination, by the 2f-curvature.

    The arrays have the shape (n_ratios, n_frequencies); without an opening n_ratios is 1.

    Attributes:
        case: the case with its delaminations.
        noise_db: signal over noise of the simulated sensor [dB].
        frequencies: frequencies of the excitation, shape (n_frequencies,) [Hz].
        ratios: g₀/A; NaN without an opening, shape (n_ratios,).
        x: positions of the index, shape (n,) [m].
        index: index over its limit of noise, shape (n_ratios, n_frequencies, n). As in a scan,
            motion between the harmonics counts as noise.
        contrast: largest index inside over that outside, without noise.
        visibility: largest index inside over the limit of noise.
        calls: share of repetitions that call.
        error: larger error of the two ends, as medians over repeated noise [m]; NaN: not called.
        beam_modes: frequencies of the structure kept closed [Hz].
        opening_modes: frequencies of the modes that open a delamination [Hz].
    """

    case: Case
    noise_db: float
    frequencies: FloatArray
    ratios: FloatArray
    x: FloatArray
    index: FloatArray
    contrast: FloatArray
    visibility: FloatArray
    calls: FloatArray
    error: FloatArray
    beam_modes: FloatArray
    opening_modes: FloatArray

    @property
    def is_avoided(self) -> BoolArray:
        """Whether each frequency misleads, shape (n_frequencies,).

        The double of such a frequency is near a resonance of the closed structure, or the index is
        nearly as large outside as inside wherever it is above its limit.
        """
        near = np.abs(2.0 * self.frequencies[:, None] / self.beam_modes - 1.0) < NEAR
        is_visible = self.visibility > 1.0
        poor = is_visible.any(axis=0) & ~(is_visible & (self.contrast >= MISLEADS)).any(axis=0)
        return np.asarray(near.any(axis=1) | poor)

    @property
    def recommended(self) -> tuple[int, int] | None:
        """Numbers of ratio and frequency of the best excitation; None: none shows it surely.

        Only excitations that call in 90 % of repetitions and need not be avoided are compared; of
        these, if there are any, those with ends within one spacing of the points. The best has the
        largest `worst` visibility, because clapping changes much from frequency to frequency.
        """
        spacing = float(np.diff(self.x)[0])
        sure = (self.calls >= SURE) & ~self.is_avoided[None, :]
        exact = sure & (self.error <= 1.01 * spacing)
        allowed = exact if exact.any() else sure
        if not allowed.any():
            return None
        best = np.where(allowed, self.worst, -np.inf).argmax()
        return divmod(int(best), self.frequencies.size)

    @property
    def worst(self) -> FloatArray:
        """Smallest visibility of each frequency and its neighbours, shape of `visibility`.

        Neighbours whose motion failed are NaN, and do not count.
        """
        wide = np.pad(self.visibility, ((0, 0), (1, 1)), mode="edge")
        return np.asarray(np.fmin(np.fmin(wide[:, :-2], wide[:, 2:]), self.visibility))

    @property
    def reason(self) -> str:
        """The recommendation in words."""
        avoided = [f"{f:g}" for f in self.frequencies[self.is_avoided]]
        less = (
            f" Avoided, as their doubles are resonances or their contrast is below {MISLEADS:g}: "
            f"{', '.join(avoided)} Hz."
            if avoided
            else ""
        )
        best = self.recommended
        if best is None:
            return (
                f"No excitation is called in {100.0 * SURE:.0f} % of repetitions at "
                f"{self.noise_db:g} dB; the best is called in {100.0 * self.calls.max():.0f} %."
                + less
            )
        f = float(self.frequencies[best[1]])
        ratio = float(self.ratios[best[0]])
        opening = f", g0/A = {ratio:g}" if math.isfinite(ratio) else ""
        return (
            f"{f:g} Hz{opening}: in simulated scans there and at the neighbouring frequencies the "
            f"index is at least {self.worst[best]:.1f} times its limit of noise. Its contrast is "
            f"{self.contrast[best]:.1f}, {100.0 * self.calls[best]:.0f} % of repetitions call, and "
            f"the ends are {1e3 * self.error[best]:.1f} mm wrong at most (median)."
            f"{self._near_modes(f)}{less}"
        )

    def _near_modes(self, frequency: float) -> str:
        """Return sentences on modes near an excitation, and on opening modes near its double."""
        texts = []
        for name, modes, multiple in (
            ("a mode of the beam", self.beam_modes, 1.0),
            ("a mode that opens the delamination", self.opening_modes, 1.0),
            ("a mode that opens the delamination", self.opening_modes, 2.0),
        ):
            if modes.size:
                nearest = float(modes[np.abs(modes - multiple * frequency).argmin()])
                if abs(multiple * frequency / nearest - 1.0) < 0.1:
                    subject = "It" if multiple == 1.0 else "Its double"
                    texts.append(f" {subject} is near {name}, {nearest:.4g} Hz.")
        return "".join(texts)

    @property
    def report(self) -> Report:
        """Report of the finding in files and on the terminal."""
        best = self.recommended
        numbers = {
            "case": self.case.name,
            "noise_db": self.noise_db,
            "recommended_frequency": None if best is None else self.frequencies[best[1]],
            "recommended_ratio": None if best is None else self.ratios[best[0]],
            "reason": self.reason,
            "frequency": self.frequencies,
            "ratio": self.ratios,
            "avoided": self.is_avoided,
            "contrast": self.contrast,
            "visibility": self.visibility,
            "call_rate": self.calls,
            "error": self.error,
            "beam_modes": self.beam_modes,
            "opening_modes": self.opening_modes,
        }
        drawn: dict[str, Picture] = {
            "figures/excitation": (
                lambda: excitation_figure(self),
                "The 2f-curvature over its limit of noise, over frequency and place; dashed: the "
                "delamination. Below: its largest value, its contrast without noise, and how often "
                "it is called.",
            )
        }
        if self.ratios.size > 1:
            drawn["figures/ratios"] = (
                lambda: ratio_figure(self),
                "The largest 2f-curvature over its limit of noise, over frequency and "
                "opening/amplitude.",
            )
        return Report(
            name="excitation",
            numbers=numbers,
            case=self.case,
            is_sweep=True,
            title=f"Excitation of {self.case.name}",
            sentences=[self.reason],
            pictures=drawn,
        )


def excitation_map(
    case: Case,
    frequencies: FloatArray,
    directory: str | Path,
    executor: Executor | ExecutorName | None = None,
    *,
    noise_db: float = 40.0,
    spacing: float = 0.01,
    **sweeping: Any,
) -> ExcitationMap:
    """Compute the map of excitations of a case as a sweep in a folder; see `run_sweep`.

    Args:
        case: case with delaminations and a harmonic excitation: base motion, or a force at a point.
        frequencies: frequencies of the excitation, shape (n,) [Hz].
        directory: folder of the sweep.
        executor: see `run_sweep`.
        noise_db: overall root mean square of the signal over that of the noise [dB].
        spacing: distance of the points [m].
        sweeping: further arguments of `run_sweep`.

    Raises:
        CaseError: the case has no delamination, or see `run_sweep`.
        KeyboardInterrupt: the sweep was interrupted; `resume` goes on.
    """
    if not case.delamination:
        raise CaseError("excite: expected a case with [[delamination]], given none")
    # g₀/A, NaN without an opening or under a force
    opening = max(delamination.opening for delamination in case.delamination)
    is_map = opening > 0.0 and case.excitation.acts_on == "base"
    ratios = np.array(RATIOS if is_map else (math.nan,))
    settling = settling_periods(case, SETTLED) / case.excitation.top_frequency
    every = frequencies.tolist() * ratios.size  # for each ratio
    columns: dict[str, list[Any]] = {
        "excitation.frequency": every,
        "time.periods": [PERIODS + math.ceil(settling * f) for f in every],
    }
    if is_map:
        columns["excitation.amplitude"] = np.repeat(opening / ratios, frequencies.size).tolist()
    axes = [Axis(key=key, values=tuple(values)) for key, values in columns.items()]
    data = scanned(
        "excitation", case, axes, ScanRecord(spacing=spacing), Path(directory), executor=executor,
        **sweeping,
    )  # fmt: skip
    values = data["scan_real"].to_numpy() + 1j * data["scan_imag"].to_numpy()
    orders = tuple(data["order"].to_numpy().tolist())
    x = data["scan_x"].to_numpy()
    noise = per_shape(1.0, PERIODS * SAMPLES)
    intact_case = intact(case)
    surface = surface_of(case, None)
    responses = [drive_responses(intact_case, surface, x, f) for f in frequencies.tolist()]
    with np.errstate(invalid="ignore"):  # NaN where a motion failed
        judged = [
            _judged(
                case,
                Shapes(x, f, orders, shape_values, between).without_drive(response),
                noise * rms,
                noise_db,
            )
            for shape_values, between, rms, f, response in zip(
                values,
                data["scan_between"].to_numpy(),
                data["scan_rms"].to_numpy(),
                every,
                responses * ratios.size,
                strict=True,
            )
        ]
    shape = (ratios.size, frequencies.size)
    numbers = np.array([entry[1] for entry in judged]).reshape(*shape, 4)
    structure = assemble(case, needs_dolfinx=False)
    free = structure_modes(structure, case, N_MODES, kind="free")
    contrast, visibility, calls, error = np.moveaxis(numbers, -1, 0)
    return ExcitationMap(
        case,
        noise_db,
        frequencies,
        ratios,
        x[1:-1],
        np.array([entry[0] for entry in judged]).reshape(*shape, x.size - 2),
        contrast,
        visibility,
        calls,
        error,
        structure_modes(structure, case, N_MODES, kind="closed").frequencies,
        free.frequencies[free.openings.max(axis=1) > OPENS],
    )


def _judged(
    case: Case, pure: Shapes, per_rms: float, noise_db: float
) -> tuple[FloatArray, tuple[float, float, float, float]]:
    """Return the index over its limit, and contrast, visibility, calls and error of a scan."""
    noise = np.hypot(per_rms * 10.0 ** (-noise_db / 20.0), pure.noise)
    start = min(delamination.start for delamination in case.delamination)
    end = max(delamination.end for delamination in case.delamination)
    limited = mark("curvature", replace(pure, noise=noise))
    visible = limited.over_limits
    inside = (limited.x >= start - 1e-9) & (limited.x <= end + 1e-9)
    again = repeated("curvature", pure, noise, repetitions=_REPETITIONS)
    error = max(abs(float(again.middle[0]) - start), abs(float(again.middle[1]) - end))
    return visible, (limited.contrast(start, end), float(visible[inside].max()), again.calls, error)


TOP = 100.0
"""Index over its limit at which the colours end."""


def excitation_figure(found: ExcitationMap) -> Figure:
    """Draw the index over frequency and place, and contrast, visibility and calls below."""
    best = found.recommended
    row = best[0] if best is not None else int(found.visibility.max(axis=1).argmax())
    figure, panels = style.stacked(2, 8.0, sharex=True, height_ratios=(3, 2))
    _map(panels[0], found, found.x, found.index[row].T, "2f-curvature over its limit of noise")
    for delamination in found.case.delamination:
        for edge in (delamination.start, delamination.end):
            panels[0].axhline(edge, color="white", linestyle="--", linewidth=1.0)
    panels[0].set(ylabel="x [m]")
    _lines(panels[1], found, row)
    style.legend_outside(figure, panels[1], ncols=5, loc="outside lower center")
    style.label_x(panels, "frequency of the excitation [Hz]")
    ratio = found.ratios[row]
    more = f", g₀/A = {ratio:g}" if np.isfinite(ratio) else ""
    figure.suptitle(f"{found.case.name}, {found.noise_db:g} dB{more}", x=0.01, ha="left")
    return figure


def ratio_figure(found: ExcitationMap) -> Figure:
    """Draw the visibility over frequency and g₀/A."""
    figure, (axes,) = style.stacked(1, 4.0)
    rows = np.arange(float(found.ratios.size))
    _map(axes, found, rows, found.visibility, "largest index over its limit of noise")
    axes.set_yticks(rows, [f"{ratio:g}" for ratio in found.ratios])
    axes.set(xlabel="frequency of the excitation [Hz]", ylabel="g₀/A")
    return figure


def _map(
    axes: Axes, found: ExcitationMap, rows: FloatArray, values: FloatArray, label: str
) -> None:
    """Draw values over frequency and rows, shape (n_rows, n_frequencies)."""
    clipped = np.clip(values, 1.0, TOP)
    picture = axes.pcolormesh(
        style.edges(found.frequencies), style.edges(rows), clipped, norm=LogNorm(1.0, TOP)
    )
    axes.grid(visible=False)
    axes.figure.colorbar(picture, ax=axes, label=label)


def _lines(axes: Axes, found: ExcitationMap, row: int) -> None:
    """Draw contrast, visibility and calls over frequency, and what is avoided."""
    f = found.frequencies
    half = 0.5 * (f[1] - f[0]) if f.size > 1 else 0.0
    for number, avoided in enumerate(f[found.is_avoided]):
        axes.axvspan(
            avoided - half, avoided + half, color=style.BASE_COLOUR, alpha=0.3, linewidth=0.0,
            label=None if number else "avoid",
        )  # fmt: skip
    axes.plot(f, found.visibility[row], color=style.BLUE, marker=".", label="index over limit")
    axes.plot(f, found.contrast[row], color=style.GREEN, marker=".", label="contrast")
    calls = np.maximum(found.calls[row], 1e-2)  # on a logarithmic axis
    axes.plot(f, calls, color=style.VERMILLION, marker=".", label="rate of calls")
    if found.recommended is not None:
        axes.axvline(f[found.recommended[1]], color="black", linestyle=":", label="recommended")
    axes.set(yscale="log", ylabel="[–]")
    if f.size > 1:
        axes.set_xlim(f.min(), f.max())


def compute(case: Case, options: Excite, context: RunContext) -> ExcitationMap:
    """Compute the map of a case with the options of a user."""
    return excitation_map(
        case,
        np.linspace(options.lowest, options.highest, options.number),
        context.folder,
        noise_db=options.noise_db,
        spacing=options.spacing,
        **context.sweeping,
    )
