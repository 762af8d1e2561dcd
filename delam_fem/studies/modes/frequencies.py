"""Natural frequencies and shapes of laminae, and of structures with delaminations open or closed.

All modes are those about the state of rest, with the axial forces of weight and loads.

Free: laminae pass through one another where they are apart. Closed: they share their deflection
there and slide. A motion with contact lies between both: while a delamination opens and closes
along one shape, its frequency is the bilinear one, 2 f_free f_closed / (f_free + f_closed). Modes
of both kinds are paired by their shape, never by their number: a mode that breathes has no partner.
The modes of single laminae stand beside those of the exact cantilever.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from matplotlib.figure import Figure

from delam_fem.api import (
    Case,
    CaseSource,
    Factor,
    Finding,
    FloatArray,
    IntArray,
    Operators,
    Report,
    RunContext,
    Structure,
    Table,
    assemble,
    beams,
    closed_by,
    factored,
    find_case,
    keeping_closed,
    lowest,
    n_columns,
    nodal,
    number,
    opening_amplitude,
    require,
    restricted,
    springs_of,
    style,
    times,
    together,
)
from delam_fem.studies.modes.plates import PlateModes, plate_modes
from delam_fem.studies.modes.study import Modes as Options

if TYPE_CHECKING:
    from delam_fem.api import MPI

Kind = Literal["free", "closed"]

ALIKE = 0.95
"""Modal assurance criterion above which a free and a closed mode count as one shape."""
PANEL = 2.4
"""Height of a panel in the picture [in]."""
BENDING = "bending"
SLIGHT = 0.1
"""Largest deflection of the middle lines, over the largest displacement, below which a mode is no
bending: of what moves sideways, turns or stretches they deflect by round-off."""
_MORE = 4
"""Further modes of the other kind among which partners are sought."""


@dataclass(frozen=True)
class StructureModes(Finding):
    """The lowest modes of a structure.

    Attributes:
        kind: "free" or "closed" delaminations.
        names: names of the laminae.
        frequencies: increasing, shape (n,) [Hz].
        x: positions of the nodes, shape (n_nodes,) [m].
        shapes: deflections, the largest of each mode is 1, shape (n, n_laminae, n_nodes) [-].
        places: names of the delaminations.
        spans: start and end of each delamination, shape (n_delaminations, 2) [m].
        openings: by how much each mode opens each delamination where it opens most, in parts of the
            largest deflection, shape (n, n_delaminations) [-].
        partners: number, from 0, of the mode of the other kind with the same shape, or -1, shape
            (n,).
        partner_frequencies: frequencies of these modes, NaN without a partner, shape (n,) [Hz].
        motions: what each mode is: "bending"; of solids also "sideways", "torsion" and "stretch",
            whose openings are in parts of the largest displacement; "impactor", which moves alone.
        buckling_factor: factor on weight and axial forces together at which the structure buckles.
        opening_amplitudes: of the drive at each frequency, at which the first pair opens that
            weight and loads keep closed; None: none is closed.
        unit: unit of these amplitudes.
        plate: of plates, what lies above the patches, and the surface.
    """

    kind: Kind
    names: tuple[str, ...]
    frequencies: FloatArray
    x: FloatArray
    shapes: FloatArray
    places: tuple[str, ...]
    spans: FloatArray
    openings: FloatArray
    partners: IntArray
    partner_frequencies: FloatArray
    motions: tuple[str, ...] = ()
    buckling_factor: float | None = None
    opening_amplitudes: tuple[float | None, ...] = ()
    unit: str = "m"
    plate: PlateModes | None = None

    @property
    def bilinear_frequencies(self) -> FloatArray:
        """Bilinear frequency of each mode with its partner, NaN without one, shape (n,) [Hz]."""
        f, g = self.frequencies, self.partner_frequencies
        with np.errstate(invalid="ignore"):
            return np.asarray(2.0 * f * g / (f + g))

    @property
    def report(self) -> Report:
        """Report of the finding in files and on the terminal."""
        other = "closed" if self.kind == "free" else "free"
        numbers: dict[str, object] = {
            "lamina": self.names,
            "delaminations": self.kind,
            "structure_frequency_hz": self.frequencies,
            "structure_shape": self.shapes,
            "x_m": self.x,
            "opening": self.openings,
            "opening_of": self.places,
            "motion": self.motions,
            f"{other}_frequency_hz": self.partner_frequencies,
            "bilinear_frequency_hz": self.bilinear_frequencies,
            "buckling_factor": self.buckling_factor,
            "opening_amplitude": self.opening_amplitudes,
        }
        if self.plate is not None:
            numbers["defect_share"] = self.plate.shares
        is_closed = any(amplitude is not None for amplitude in self.opening_amplitudes)
        has_shares = self.plate is not None and self.plate.shares.size > 0
        shares = self.plate.shares if self.plate is not None and has_shares else None
        heading = (
            "mode",
            "frequency [Hz]",
            *(["motion"] if self._has_others else []),
            *(f"opens {place}" for place in self.places),
            *(f"energy at {place}" for place in self.places if has_shares),
            f"{other} mode alike [Hz]",
            "bilinear [Hz]",
            *([f"drive that opens [{self.unit}]"] if is_closed else []),
        )
        rows = [
            (
                str(k + 1),
                f"{frequency:.6g}",
                *([self.motions[k]] if self._has_others else []),
                *(f"{opening:.3f}" for opening in self.openings[k]),
                *([] if shares is None else [f"{share:.1%}" for share in shares[k]]),
                number(self.partner_frequencies[k], ".6g"),
                number(self.bilinear_frequencies[k], ".6g"),
                *([number(self.opening_amplitudes[k] or np.nan, ".4g")] if is_closed else []),
            )
            for k, frequency in enumerate(self.frequencies)
        ]
        return Report(
            name="modes",
            numbers=numbers,
            tables=[Table(f"modes of the structure, delaminations {self.kind}", heading, rows)],
            pictures={"modes": (self.figure, "")},
        )

    @property
    def _has_others(self) -> bool:
        """Whether a mode is no bending."""
        return any(motion != BENDING for motion in self.motions)

    def figure(self) -> Figure:
        """Draw the shape of each mode; shaded where laminae are apart; of a plate its plan."""
        if self.plate is not None:
            titles = [
                f"{k + 1}: {frequency:.5g} Hz, {self.motions[k]}"
                for k, frequency in enumerate(self.frequencies)
            ]
            return self.plate.figure(titles, f"Modes, delaminations {self.kind}")
        figure, panels = style.side_by_side(
            len(self.frequencies), PANEL, above=0.7, sharex=True, sharey=True
        )
        for k, axes in enumerate(panels):
            for j, (start, end) in enumerate(self.spans):
                axes.axvspan(start, end, color=style.GAP_COLOUR, label=None if j else "delaminated")
            axes.axhline(0.0, color="0.7", linewidth=0.6)
            styles = ("-", "--", ":", "-.")
            for i, colour in enumerate(style.lamina_colours(len(self.names))):
                axes.plot(
                    self.x, self.shapes[k, i], color=colour, linestyle=styles[i % 4],
                    linewidth=2.4 if i == 0 else 1.6, label=self.names[i],
                )  # fmt: skip
            text = f"{k + 1}: {self.frequencies[k]:.5g} Hz"
            if self._has_others:
                text += f", {self.motions[k]}"
            if self.kind == "free" and self.openings.shape[1]:
                text += f", opens by {self.openings[k].max():.2g}"
                if self.partners[k] >= 0:
                    text += f"; closed {self.partner_frequencies[k]:.5g} Hz"
            axes.set_title(text, loc="left", fontsize=9)
            axes.set(ylim=(-1.15, 1.15), yticks=(-1, 0, 1), xlim=(self.x[0], self.x[-1]))
        style.label_x(panels, "x [m]")
        style.legend_outside(figure, panels[0], 4, "outside upper right")
        figure.suptitle(f"Modes, delaminations {self.kind}", x=0.02, ha="left")
        return figure


def structure_modes(
    structure: Structure,
    case: Case,
    n: int = 6,
    *,
    kind: Kind = "free",
    factor: Factor | None = None,
) -> StructureModes:
    """Return the lowest modes of a structure.

    Args:
        structure: the discretised case.
        case: the case; contact, springs and gaps at rest do not matter here.
        n: number of modes.
        kind: "free" or "closed" delaminations.
        factor: factors of the stiffness of a structure that is held; None: they are computed.

    Raises:
        CaseError: there is no such kind, or the structure has fewer dofs.
    """
    require(kind in get_args(Kind), "delaminations", "free or closed", kind)
    o, layout = structure.operators, structure.layout
    S = keeping_closed(structure)
    n_closed = n_columns(S)
    require(1 <= n <= n_closed, "number of modes", f"1 to {n_closed}", n)
    solutions = {}
    is_floating = case.n_rigid > 0
    is_tied = n_closed < o.n_dofs
    for name in get_args(Kind) if is_tied else (kind,):
        count = n if name == kind else min(n + _MORE, n_closed if name == "closed" else o.n_dofs)
        K, M = o.stiffness, o.mass
        if name == "closed":
            K, M = (closed_by(S, A) for A in (K, M))
        known = factor if name == "free" or not is_tied else None
        frequencies, vectors = lowest(K, M, count, is_floating=is_floating, factor=known)
        has_mass = np.isfinite(frequencies)
        vectors = vectors[:, has_mass]
        solutions[name] = frequencies[has_mass], times(S, vectors) if name == "closed" else vectors
    frequencies, vectors = solutions[kind]
    n_open = frequencies.size
    require(n == n_open, "number of modes", f"1 to {n_open}, as no more motions have mass", n)
    other_kind = "closed" if kind == "free" else "free"
    other_frequencies, other = solutions.get(other_kind, solutions[kind])
    partners = _partners(vectors, other, o)
    deflections = nodal(layout, vectors.T, np.zeros(n))[0].swapaxes(0, 1)
    largest = np.abs(deflections).max(axis=(1, 2))
    motions, sizes = _motions(structure, vectors, largest)
    is_bending = np.array([motion == BENDING for motion in motions])
    largest = np.where(is_bending & (not case.is_plate), largest, sizes)
    places, spans, pairs = _delaminations(case, structure)
    gaps = np.abs(o.total(o.gap_matrix @ vectors))
    openings = np.array([gaps[rows].max(axis=0, initial=0.0) / largest for rows in pairs])
    shapes = deflections / largest[:, None, None]
    plate = None
    if case.is_plate and structure.body is not None:
        plate = plate_modes(structure.body, case, vectors)
        motions = motions if plate is None else plate.named(motions)
    flat = shapes.reshape(n, -1)
    upwards = np.sign(flat[np.arange(n), np.abs(flat).argmax(axis=1)])  # the largest deflection
    return StructureModes(
        kind,
        layout.names,
        frequencies,
        layout.x,
        shapes * upwards[:, None, None],
        places,
        spans,
        openings.reshape(len(places), n).T,
        partners,
        np.where(partners < 0, np.nan, other_frequencies[partners]),
        motions,
        o.buckling_factor,
        tuple(opening_amplitude(o, f, springs_of(o, case)) for f in frequencies.tolist()),
        "N" if o.base.is_force else "m",
        plate,
    )


def _motions(
    structure: Structure, vectors: FloatArray, deflections: FloatArray
) -> tuple[tuple[str, ...], FloatArray]:
    """Return what each mode is, and its largest displacement.

    Args:
        structure: the discretised case.
        vectors: the modes, shape (n_dofs, n).
        deflections: largest deflection of the middle lines in each mode, shape (n,).
    """
    count = structure.layout.n_impactors
    body = structure.body
    n = vectors.shape[0] - count
    sizes = {"impactor": np.abs(vectors[n:]).max(axis=0, initial=0.0)}
    if body is not None:
        along, up, *across = body.largest(vectors[:n]).T
        sizes |= {"stretch": along, "torsion": up}  # up beside middle lines that do not deflect
        if across:
            is_turned = up >= SLIGHT * across[0]
            sizes["torsion"] = np.where(is_turned, np.maximum(up, across[0]), 0.0)
            sizes["sideways"] = np.where(is_turned, 0.0, across[0])
    names = list(sizes)
    table = np.array(list(sizes.values()))
    largest = np.maximum(table.max(axis=0), deflections)
    motions = tuple(
        BENDING if deflection >= SLIGHT * size else names[other]
        for deflection, size, other in zip(
            deflections, largest, table.argmax(axis=0).tolist(), strict=True
        )
    )
    return motions, largest


def _partners(vectors: FloatArray, other: FloatArray, o: Operators) -> IntArray:
    """Return for each vector the number of the one in `other` with the same shape, or -1."""

    def unit(v: FloatArray) -> FloatArray:
        return np.asarray(v / np.sqrt(o.total(np.einsum("ij,ij->j", v, times(o.mass, v)))))

    alike = o.total(unit(vectors).T @ times(o.mass, unit(other))) ** 2
    best = alike.argmax(axis=1)
    return np.asarray(np.where(alike.max(axis=1) > ALIKE, best, -1))


def _delaminations(
    case: Case, structure: Structure
) -> tuple[tuple[str, ...], FloatArray, list[IntArray]]:
    """Return names, spans [m] and pairs of the delaminations of a case.

    Laminae that are apart without any [[delamination]] have one between all neighbours.
    """
    layout = structure.layout
    entries: list[tuple[str, tuple[float, float], IntArray]] = []
    for interface in layout.interfaces:
        lower, upper = (layout.names[part] for part in interface.parts)
        delaminations = [d for d in case.delamination if d.between == (lower, upper)]
        x, z = layout.positions_of(interface)
        rows = np.arange(interface.pairs.start, interface.pairs.stop)
        if case.gap is not None:
            entries.append((f"{lower}-{upper}", (0.0, case.length), rows))
        for d in delaminations:
            inside = (x > d.start - 1e-9 * case.length) & (x < d.end + 1e-9 * case.length)
            name = f"{lower}-{upper} at {d.start:g} m"
            if d.across is not None:
                inside = d.contains(x, z)
                name = f"{lower}-{upper} at {d.start:g} m, {d.across[0]:g} m"
            entries.append((name, (d.start, d.end), rows[inside]))
    spans = np.array([span for _, span, _ in entries]).reshape(-1, 2)
    return tuple(name for name, _, _ in entries), spans, [rows for _, _, rows in entries]


@dataclass(frozen=True)
class NaturalModes(Finding):
    """Natural frequencies and mode shapes, computed and exact.

    Attributes:
        names: names of the laminae.
        frequencies: computed, shape (n_laminae, n) [Hz].
        exact: of the Euler-Bernoulli cantilever, shape (n_laminae, n) [Hz].
        x: positions of the nodes, shape (n_nodes,) [m].
        shapes: deflections at the nodes, 1 at the last one, shape (n_laminae, n, n_nodes) [-].
        structure: the modes of the whole structure, if they are asked for.
    """

    names: tuple[str, ...]
    frequencies: FloatArray
    exact: FloatArray
    x: FloatArray
    shapes: FloatArray
    structure: StructureModes | None = None

    @property
    def relative_differences(self) -> FloatArray:
        """Relative differences (computed - exact) / exact, shape (n_laminae, n) [-]."""
        return self.frequencies / self.exact - 1.0

    @property
    def report(self) -> Report:
        """Report of the finding in files and on the terminal."""
        heading = ("lamina", "mode", "computed [Hz]", "exact [Hz]", "relative difference")
        rows = [
            (
                self.names[i],
                str(k + 1),
                f"{self.frequencies[i, k]:.6g}",
                f"{self.exact[i, k]:.6g}",
                f"{self.relative_differences[i, k]:+.1e}",
            )
            for i in range(len(self.names))
            for k in range(self.frequencies.shape[1])
        ]
        structure_report = None if self.structure is None else self.structure.report
        numbers: dict[str, object] = {
            "lamina": self.names,
            "frequency_hz": self.frequencies,
            "exact_hz": self.exact,
            "relative_difference": self.relative_differences,
        }
        return Report(
            name="modes",
            numbers=numbers
            if structure_report is None
            else {**numbers, **(structure_report.numbers or {})},
            tables=[
                Table("modes of the laminae", heading, rows),
                *(structure_report.tables if structure_report else ()),
            ],
            pictures={"modes": (self.figure, "")},
        )

    def figure(self) -> Figure:
        """Draw the computed shapes as dots on the exact lines, lowest mode at the bottom."""
        figure = Figure(figsize=(9.0, 6.0), layout="constrained")
        fine = np.linspace(0.0, 1.0, 400)
        all_axes = figure.subplots(1, len(self.names), sharey=True, squeeze=False)[0]
        for i, axes in enumerate(all_axes):
            for k, shape in enumerate(self.shapes[i]):
                level = 2.5 * k
                axes.axhline(level, color="0.85", linewidth=0.8)
                axes.plot(fine * self.x[-1], level + beams.cantilever_mode(k + 1, fine), "k-")
                axes.plot(self.x, level + shape, "o", color=f"C{i}", markersize=4)
                label = f"{self.frequencies[i, k]:.4g} Hz ({self.relative_differences[i, k]:+.0e})"
                axes.annotate(label, (1.03 * self.x[-1], level + 1.0), fontsize=8, va="center")
            axes.set_xlim(0.0, 1.45 * self.x[-1])
            axes.set(title=self.names[i], xlabel="x [m]")
        all_axes[0].set(ylabel="mode shapes (tip = 1), one above the other", yticks=[])
        figure.suptitle("Mode shapes: finite elements (dots), exact cantilever (lines)")
        return figure


def modes(
    case: CaseSource, n: int = 6, *, delaminations: Kind = "free"
) -> NaturalModes | StructureModes:
    """Return the lowest modes from the weak forms in dolfinx.

    Args:
        case: the case; springs and contact do not matter here.
        n: number of modes of each lamina, and of the structure.
        delaminations: of the structure: "free" or "closed".

    Returns:
        For laminae that are apart over their whole length, the modes of each beside the exact
        cantilever, and those of the structure. For a bonded stack, and with point masses or other
        supports, those of the structure alone.

    Raises:
        CaseError: n is below 1 or above the number of dofs, or `delaminations` is another word.
    """
    return together(_modes, find_case(case).without_impactors, n, delaminations)


def _modes(
    case: Case, n: int, delaminations: Kind, *, comm: MPI.Intracomm | None
) -> NaturalModes | StructureModes:
    """Return the lowest modes (collective); see `modes`."""
    structure = assemble(case, comm=comm, needs_damping=case.is_loaded)  # see `opening_amplitude`
    factor = None
    if len(case.lamina) == 1 and not case.n_rigid:  # the lamina is the structure
        factor = factored(structure.operators.stiffness, structure.operators.mass)
    of_structure = structure_modes(structure, case, n, kind=delaminations, factor=factor)
    if not case.has_exact_laminae:
        return of_structure
    return replace(modes_of(structure, case, n, factor), structure=of_structure)


def modes_of(
    structure: Structure, case: Case, n: int, factor: Factor | None = None
) -> NaturalModes:
    """Return the lowest modes of each lamina of a structure that is already assembled.

    Args:
        structure: the discretised laminae.
        case: the case, with the exact properties of the laminae.
        n: number of modes per lamina.
        factor: factors of the stiffness of a single lamina; None: they are computed.

    Returns:
        Frequencies and shapes beside the exact ones, NaN where these are not known.

    Raises:
        CaseError: n is below 1 or above the number of dofs of a lamina.
    """
    layout, o = structure.layout, structure.operators
    sizes = np.array([layout.own_dofs(i).size for i in range(len(layout.parts))])
    n_shared = int(o.total(sizes).min())
    require(1 <= n <= n_shared, "number of modes", f"1 to {n_shared} (dofs of a lamina)", n)
    shapes = np.zeros((len(layout.parts), n, layout.x.size))
    frequencies = np.zeros((len(layout.parts), n))
    for i in range(len(layout.parts)):
        dofs = layout.own_dofs(i)
        K, M = (restricted(A, dofs) for A in (o.stiffness, o.mass))
        frequencies[i], vectors = lowest(K, M, n, factor=factor)
        full_shapes = np.zeros((n, o.n_own))
        full_shapes[:, dofs] = vectors.T
        deflections = nodal(layout, full_shapes, np.zeros(n))[0, i]
        shapes[i] = deflections / deflections[:, -1:]  # 1 at the last point
    exact = np.full((len(case.lamina), n), np.nan)
    for i, lamina in enumerate(case.lamina):
        if case.has_exact_modes(i):
            exact[i] = lamina.angular_frequencies(n) / (2.0 * np.pi)
    return NaturalModes(layout.names, frequencies, exact, layout.x, shapes)


def compute(case: Case, options: Options, _: RunContext) -> NaturalModes | StructureModes:
    """Compute the natural modes of a case with the options of a user."""
    return modes(case, options.number, delaminations=options.delaminations)
