"""Map how well excitations show a delamination, and recommend one.

With an opening at rest the motion depends on g₀/A, the opening over the amplitude of the base; the
map then has this ratio as a second axis. A delamination that is closed at rest has no such axis:
twice the excitation gives exactly twice the motion.

A plate is reduced to its modes once. Its frequencies stand beside the local defect resonances of
its patches, as a patch that is driven there, or at half of it, vibrates most by itself.
"""

from __future__ import annotations

import json
import math
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
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
    reduced_case,
    style,
    write_json,
)
from delam_fem.studies.detection.detect import (
    drive_responses,
    folder_of_model,
    in_modes,
    intact,
    per_shape,
    with_scan,
)
from delam_fem.studies.detection.indices import SHARE, Mark, mark, repeated
from delam_fem.studies.detection.maps import draw_outlines, patches_of
from delam_fem.studies.detection.population import PERIODS, SAMPLES, SETTLED, scanned
from delam_fem.studies.detection.study import Excite, Scan
from delam_fem.studies.executors import ExecutorName
from delam_fem.studies.linear import settling_periods
from delam_fem.studies.modes.frequencies import structure_modes
from delam_fem.studies.modes.plates import DEFECT_RESONANCE, plate_modes
from delam_fem.studies.signals.scan import Shapes, points_of, surface_of
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
OUTLINED = 0.5
"""Least overlap of marked region and patches of a recommended excitation, about what one frequency
reaches on plates (docs/evidence/plate_detection.md)."""
RANGE = (40.0, 400.0)
"""First and last frequency for beams [Hz]."""
AROUND = (0.25, 1.25)
"""First and last frequency for plates over the lowest defect resonance: it and its half are within.
"""
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
        error: larger error of the two ends, as medians over repeated noise [m]; NaN: not called,
            or a plate.
        beam_modes: frequencies of the structure kept closed [Hz].
        opening_modes: frequencies of the modes that open a delamination [Hz].
        second: largest |V₂| of the points, without noise [m/s].
        z: positions of the index across a plate, shape (n,) [m]; None: along a beam.
        overlap: of a plate, overlap of marked region and patches, median over repeated noise [-];
            NaN: not called.
        defect_resonances: local defect resonance of each patch of a plate by its name [Hz], as
            `modes` names them; those beyond the modes of the model are missing.
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
    second: FloatArray
    z: FloatArray | None = None
    overlap: FloatArray | None = None
    defect_resonances: dict[str, float] = field(default_factory=dict)

    @property
    def is_avoided(self) -> BoolArray:
        """Whether each frequency misleads, shape (n_frequencies,).

        The double of such a frequency is near a resonance of the closed beam, or the index is
        nearly as large outside as inside wherever it is above its limit. Of plates the latter alone
        counts, because their resonances lie too close together.
        """
        near = np.abs(2.0 * self.frequencies[:, None] / self.beam_modes - 1.0) < NEAR
        near &= self.z is None
        is_visible = self.visibility > 1.0
        poor = is_visible.any(axis=0) & ~(is_visible & (self.contrast >= MISLEADS)).any(axis=0)
        return np.asarray(near.any(axis=1) | poor)

    @property
    def recommended(self) -> tuple[int, int] | None:
        """Numbers of ratio and frequency of the best excitation; None: none shows it surely.

        Only excitations that call in 90 % of repetitions and need not be avoided are compared; of
        these, if there are any, those with ends within one spacing of the points, or on plates with
        an overlap of a half. The best has the largest `worst` visibility, because clapping changes
        much from frequency to frequency.
        """
        sure = (self.calls >= SURE) & ~self.is_avoided[None, :]
        if self.overlap is None:
            spacing = float(np.diff(self.x)[0])
            exact = sure & (self.error <= 1.01 * spacing)
        else:
            exact = sure & (self.overlap >= OUTLINED)
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
    def loudest(self) -> float:
        """The frequency at which 2f of the response is largest [Hz]."""
        largest = np.nanmax(self.second, axis=0)
        return float(self.frequencies[np.nanargmax(largest)])

    @property
    def reason(self) -> str:
        """The recommendation in words."""
        avoided = [f"{f:g}" for f in self.frequencies[self.is_avoided]]
        of_resonances = "their doubles are resonances or " if self.z is None else ""
        less = (
            f" Avoided, as {of_resonances}their contrast is below {MISLEADS:g}: "
            f"{', '.join(avoided)} Hz."
            if avoided
            else ""
        )
        less = self._beside_resonances + less
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
        where = (
            f"the ends are {1e3 * self.error[best]:.1f} mm wrong at most (median)."
            if self.overlap is None
            else f"the marked region overlaps the patches by {self.overlap[best]:.2f} (median)."
        )
        return (
            f"{f:g} Hz{opening}: in simulated scans there and at the neighbouring frequencies the "
            f"index is at least {self.worst[best]:.1f} times its limit of noise. Its contrast is "
            f"{self.contrast[best]:.1f}, {100.0 * self.calls[best]:.0f} % of repetitions call, and "
            f"{where}{self._near_modes(f) if self.z is None else ''}{less}"
        )

    @property
    def _beside_resonances(self) -> str:
        """A sentence on where 2f of the response is largest, beside the defect resonances."""
        if self.z is None:
            return ""
        named = [f"{name} {f:.4g} Hz" for name, f in self.defect_resonances.items()]
        known = ", ".join(named) if named else "none among the modes of the model"
        return (
            f" 2f of the response is largest at {self.loudest:.4g} Hz, where it is "
            f"{2.0 * self.loudest:.4g} Hz; defect resonance: {known}."
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
            "largest_2f": self.second,
        }
        if self.overlap is not None:
            numbers |= {
                "overlap": self.overlap,
                "defect_resonance": self.defect_resonances,
                "largest_2f_at": self.loudest,
            }
        words = (
            "The 2f-curvature over its limit of noise, over frequency and place; dashed: the "
            "delamination. Below: its largest value, its contrast without noise, and how often "
            "it is called."
            if self.z is None
            else "The largest |V₂| of the points, and the Laplacian of V₂: its largest value over "
            "its limit of noise, its contrast without noise, how often it is called, and the "
            "overlap of the marked region with the patches. Dashed: the defect resonances, "
            "dash-dotted: half of them. Below: the index over its limit at one frequency."
        )
        drawn: dict[str, Picture] = {
            "figures/excitation": (
                (lambda: excitation_figure(self))
                if self.z is None
                else (lambda: plate_figure(self)),
                words,
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


@dataclass(frozen=True)
class _Prepared:
    """A case as its map is computed: of a plate as a model of modes.

    Attributes:
        model: with its delaminations.
        intact: without them.
        defect_resonances: see `ExcitationMap`.
    """

    model: Case
    intact: Case
    defect_resonances: dict[str, float]


def _prepared(case: Case, spacing: float, modes: int, folder: Path, *, resume: bool) -> _Prepared:
    """Return a case as its map is computed.

    Args:
        case: the case, with delaminations.
        spacing: distance of the points of a plate without a [scan] of its own [m].
        modes: number of modes that a plate is reduced to.
        folder: folder of the sweep.
        resume: whether to take models that are in the folder.

    Raises:
        CaseError: the case has no delamination, or a plate cannot be scanned or reduced.
    """
    if not case.delamination:
        raise CaseError("excite: expected a case with [[delamination]], given none")
    if not case.is_plate:
        return _Prepared(case, intact(case), {})
    plate = with_scan(case, Scan(spacing=spacing))
    models = folder / f"modes-{modes}"
    path = folder_of_model(plate, modes, models) / "defect_resonances.json"
    resonances = _kept(path) if resume else None
    if resonances is None:
        resonances = _reduced(plate, modes, path.parent)
        write_json(path, resonances)
    return _Prepared(
        in_modes(plate, modes, models, resume=True),
        in_modes(intact(plate), modes, models, resume=resume),
        resonances,
    )


def _reduced(plate: Case, modes: int, folder: Path) -> dict[str, float]:
    """Reduce a plate in a folder; return its local defect resonances, see `ExcitationMap`."""
    reduction = reduced_case(plate, modes)
    reduction.save(folder)
    body = reduction.full.body
    assert body is not None  # a plate is a solid
    basis = reduction.basis
    order = np.flatnonzero(basis.is_mode)
    order = order[np.argsort(basis.squares[order])]
    frequencies = np.sqrt(basis.squares[order]) / (2.0 * math.pi)
    shapes = plate_modes(body, plate, basis.vectors[:, order])
    assert shapes is not None  # there is one rank
    names = shapes.named(("",) * order.size)
    return {
        name.removeprefix(DEFECT_RESONANCE): float(f)
        for name, f in zip(names, frequencies, strict=True)
        if name.startswith(DEFECT_RESONANCE)
    }


def _kept(path: Path) -> dict[str, float] | None:
    """Return the defect resonances in a file; None: there are none that can be read."""
    try:
        content = json.loads(path.read_text("utf-8"))
        return {name: float(f) for name, f in content.items()}
    except (OSError, ValueError, TypeError, AttributeError):
        return None


def excitation_map(
    case: Case,
    frequencies: FloatArray,
    directory: str | Path,
    executor: Executor | ExecutorName | None = None,
    *,
    noise_db: float = 40.0,
    spacing: float = 0.01,
    modes: int = 60,
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
        modes: number of modes that a plate is reduced to.
        sweeping: further arguments of `run_sweep`.

    Raises:
        CaseError: the case has no delamination, or see `run_sweep`.
        KeyboardInterrupt: the sweep was interrupted; `resume` goes on.
    """
    folder = Path(directory)
    resume = bool(sweeping.get("resume", False))
    prepared = _prepared(case, spacing, modes, folder, resume=resume)
    return _mapped(prepared, frequencies, folder, noise_db, spacing, executor=executor, **sweeping)


def _mapped(
    prepared: _Prepared,
    frequencies: FloatArray,
    folder: Path,
    noise_db: float,
    spacing: float,
    **sweeping: Any,
) -> ExcitationMap:
    """Compute the map of a case that is prepared; see `excitation_map`."""
    case = prepared.model
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
    record = ScanRecord() if case.is_plate else ScanRecord(spacing=spacing)
    data = scanned("excitation", case, axes, record, folder, **sweeping)
    values = data["scan_real"].to_numpy() + 1j * data["scan_imag"].to_numpy()
    orders = tuple(data["order"].to_numpy().tolist())
    x = data["scan_x"].to_numpy()
    z = data["scan_z"].to_numpy() if case.is_plate else None
    noise = per_shape(1.0, PERIODS * SAMPLES)
    surface = surface_of(case, None)
    points = points_of(prepared.intact, spacing)
    responses = [drive_responses(prepared.intact, surface, points, f) for f in frequencies.tolist()]
    with np.errstate(invalid="ignore"):  # NaN where a motion failed
        judged = [
            _judged(
                case,
                Shapes(x, f, orders, shape_values, between, z=z).without_drive(response),
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
    numbers = np.array([entry[1] for entry in judged]).reshape(*shape, 5)
    structure = assemble(case, needs_dolfinx=False)
    free = structure_modes(structure, case, N_MODES, kind="free")
    contrast, visibility, calls, error, overlap = np.moveaxis(numbers, -1, 0)
    marks = [entry[0] for entry in judged]
    return ExcitationMap(
        case,
        noise_db,
        frequencies,
        ratios,
        marks[0].x,
        np.array([index_mark.over_limits for index_mark in marks]).reshape(*shape, -1),
        contrast,
        visibility,
        calls,
        error,
        structure_modes(structure, case, N_MODES, kind="closed").frequencies,
        free.frequencies[free.openings.max(axis=1) > OPENS],
        np.abs(values[:, orders.index(2.0)]).max(axis=1).reshape(shape),
        marks[0].z,
        overlap if case.is_plate else None,
        prepared.defect_resonances,
    )


def _judged(
    case: Case, pure: Shapes, per_rms: float, noise_db: float
) -> tuple[Mark, tuple[float, float, float, float, float]]:
    """Return what a scan marks, and its contrast, visibility, calls, error and overlap."""
    noise = np.hypot(per_rms * 10.0 ** (-noise_db / 20.0), pure.noise)
    limited = mark("curvature", replace(pure, noise=noise))
    again = repeated("curvature", pure, noise, repetitions=_REPETITIONS)
    visible = limited.over_limits
    if limited.z is not None:
        patches = patches_of(case)
        inside = patches.contains(limited.x, limited.z)
        contrast = limited.contrast_of(inside)
        visibility = float(visible[inside].max(initial=0.0))
        return limited, (contrast, visibility, again.calls, math.nan, again.overlap(patches))
    start = min(delamination.start for delamination in case.delamination)
    end = max(delamination.end for delamination in case.delamination)
    inside = (limited.x >= start - 1e-9) & (limited.x <= end + 1e-9)
    error = max(abs(float(again.middle[0]) - start), abs(float(again.middle[1]) - end))
    contrast = limited.contrast(start, end)
    return limited, (contrast, float(visible[inside].max()), again.calls, error, math.nan)


TOP = 100.0
"""Index over its limit at which the colours end."""


def excitation_figure(found: ExcitationMap) -> Figure:
    """Draw the index over frequency and place, and contrast, visibility and calls below."""
    row, _ = _shown(found)
    figure, panels = style.stacked(2, 8.0, sharex=True, height_ratios=(3, 2))
    _map(panels[0], found, found.x, found.index[row].T, "2f-curvature over its limit of noise")
    for delamination in found.case.delamination:
        for edge in (delamination.start, delamination.end):
            panels[0].axhline(edge, color="white", linestyle="--", linewidth=1.0)
    panels[0].set(ylabel="x [m]")
    _lines(panels[1], found, row)
    style.legend_outside(figure, panels[1], ncols=5, loc="outside lower center")
    style.label_x(panels, "frequency of the excitation [Hz]")
    figure.suptitle(_heading(found, row), x=0.01, ha="left")
    return figure


def plate_figure(found: ExcitationMap) -> Figure:
    """Draw |V₂| and what is called over frequency, and the index on the plate at one of them."""
    row, column = _shown(found)
    figure, (first, lines, plan) = style.stacked(3, 10.0, height_ratios=(2, 2, 3))
    f = found.frequencies
    first.plot(f, found.second[row], color=style.BLUE, marker=".")
    first.set(ylabel="largest |V₂| [m/s]", yscale="log")
    _lines(lines, found, row)
    for axes in (first, lines):
        axes.set(xlabel="frequency of the excitation [Hz]", xlim=(f.min(), f.max()))
        for resonance in found.defect_resonances.values():
            axes.axvline(resonance, color="black", ls="--", lw=1.0)
            axes.axvline(0.5 * resonance, color="black", ls="-.", lw=1.0)
    named = [f"{name} {resonance:.4g} Hz" for name, resonance in found.defect_resonances.items()]
    lines_of = ", ".join(named) + " (dashed), and a half of it (dash-dotted)" if named else "none"
    first.set_title(f"defect resonance: {lines_of}", loc="left")
    lines.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    assert found.z is not None
    colours = plan.tripcolor(
        found.x, found.z, np.clip(found.index[row, column], 1.0, TOP), shading="gouraud",
        norm=LogNorm(1.0, TOP),
    )  # fmt: skip
    draw_outlines(plan, patches_of(found.case))
    figure.colorbar(colours, ax=plan, label="Laplacian of V₂ over its limit")
    plan.set(xlabel="x [m]", ylabel="z [m]", aspect="equal")
    plan.set_title(f"{f[column]:g} Hz", loc="left")
    figure.suptitle(_heading(found, row), x=0.01, ha="left")
    return figure


def _shown(found: ExcitationMap) -> tuple[int, int]:
    """Return the ratio and frequency that are drawn, the recommended or most visible ones."""
    if found.recommended is not None:
        return found.recommended
    return divmod(int(np.nanargmax(found.visibility)), found.frequencies.size)


def _heading(found: ExcitationMap, row: int) -> str:
    """Return the heading of a figure."""
    ratio = found.ratios[row]
    more = f", g₀/A = {ratio:g}" if np.isfinite(ratio) else ""
    return f"{found.case.name}, {found.noise_db:g} dB{more}"


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
    if found.overlap is not None:
        axes.plot(f, found.overlap[row], color=style.PURPLE, marker=".", label="overlap")
    if found.recommended is not None:
        axes.axvline(f[found.recommended[1]], color="black", linestyle=":", label="recommended")
    axes.set(yscale="log", ylabel="[–]")
    if f.size > 1:
        axes.set_xlim(f.min(), f.max())


def compute(case: Case, options: Excite, context: RunContext) -> ExcitationMap:
    """Compute the map of a case with the options of a user."""
    prepared = _prepared(
        case, options.spacing, options.modes, context.folder, resume=context.resume
    )
    lowest, highest = RANGE
    if case.is_plate and None in (options.lowest, options.highest):
        if not prepared.defect_resonances:
            raise CaseError(
                f"excite: expected --from and --to, because no defect resonance is among the "
                f"{options.modes} modes of the plate"
            )
        resonance = min(prepared.defect_resonances.values())
        lowest, highest = (share * resonance for share in AROUND)
    frequencies = np.linspace(
        lowest if options.lowest is None else options.lowest,
        highest if options.highest is None else options.highest,
        options.number,
    )
    return _mapped(
        prepared, frequencies, context.folder, options.noise_db, options.spacing, **context.sweeping
    )
