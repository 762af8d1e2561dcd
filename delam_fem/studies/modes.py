"""Natural frequencies and mode shapes of all laminae beside those of the exact cantilever.

`structure_modes.py` has the modes of a whole structure.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from matplotlib.figure import Figure

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.model import discretise, fields
from delam_fem.model.layout import Structure
from delam_fem.model.vibration import lowest
from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.cantilever import cantilever_mode
from delam_fem.studies.findings import save_findings
from delam_fem.studies.structure_modes import Kind, StructureModes, structure_modes


@dataclass(frozen=True)
class Modes:
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
        """(computed - exact) / exact, shape (n_laminae, n) [-]."""
        return self.frequencies / self.exact - 1.0

    def rows(self) -> list[tuple[str, str, str, str, str]]:
        """Return table rows: lamina, mode, computed [Hz], exact [Hz], relative difference."""
        n = self.frequencies.shape[1]
        return [
            (
                self.names[i],
                str(k + 1),
                f"{self.frequencies[i, k]:.6g}",
                f"{self.exact[i, k]:.6g}",
                f"{self.relative_differences[i, k]:+.1e}",
            )
            for i in range(len(self.names))
            for k in range(n)
        ]

    def save(self, directory: Path | str) -> list[Path]:
        """Write modes.json and modes.png.

        Args:
            directory: made where it is missing.

        Returns:
            The two paths.

        Raises:
            OSError: the directory cannot be written.
        """
        numbers: dict[str, object] = {
            "lamina": list(self.names),
            "frequency_hz": self.frequencies.tolist(),
            "exact_hz": self.exact.tolist(),
            "relative_difference": self.relative_differences.tolist(),
        }
        if self.structure is not None:
            numbers |= self.structure.numbers()
        return save_findings(directory, "modes", numbers, self.figure)

    def figure(self) -> Figure:
        """Draw the computed shapes as dots on the exact lines, lowest mode at the bottom."""
        figure = Figure(figsize=(9.0, 6.0), layout="constrained")
        fine = np.linspace(0.0, 1.0, 400)
        all_axes = figure.subplots(1, len(self.names), sharey=True, squeeze=False)[0]
        for i, axes in enumerate(all_axes):
            for k, shape in enumerate(self.shapes[i]):
                level = 2.5 * k
                axes.axhline(level, color="0.85", linewidth=0.8)
                axes.plot(fine * self.x[-1], level + cantilever_mode(k + 1, fine), "k-")
                axes.plot(self.x, level + shape, "o", color=f"C{i}", markersize=4)
                label = f"{self.frequencies[i, k]:.4g} Hz ({self.relative_differences[i, k]:+.0e})"
                axes.annotate(label, (1.03 * self.x[-1], level + 1.0), fontsize=8, va="center")
            axes.set_xlim(0.0, 1.45 * self.x[-1])
            axes.set(title=self.names[i], xlabel="x [m]")
        all_axes[0].set(ylabel="mode shapes (tip = 1), one above the other", yticks=[])
        figure.suptitle("Mode shapes: finite elements (dots), exact cantilever (lines)")
        return figure


def modes(case: Case, n: int = 6, *, delaminations: Kind = "free") -> Modes | StructureModes:
    """Return the lowest modes from the weak forms in dolfinx.

    Args:
        case: the case; springs and contact do not matter here.
        n: number of modes of each lamina, and of the structure.
        delaminations: of the structure: "free" or "closed".

    Returns:
        For laminae that are apart over their whole length, the modes of each beside the exact
        cantilever, and those of the structure. For a bonded stack, and with point masses, those of
        the structure alone.

    Raises:
        CaseError: n is below 1 or above the number of dofs.
    """
    structure = discretise.assemble(case)
    if not case.is_apart or case.point_mass:
        return structure_modes(structure, case, n, kind=delaminations)
    whole = structure_modes(structure, case, n, kind=delaminations)
    return replace(modes_of(structure, case, n), structure=whole)


def modes_of(structure: Structure, case: Case, n: int = 6) -> Modes:
    """Return the lowest modes of each lamina of a structure that is already assembled.

    Args:
        structure: the discretised laminae.
        case: their exact properties.
        n: number of modes per lamina.

    Returns:
        Frequencies and shapes beside the exact ones.

    Raises:
        CaseError: n is below 1 or above the number of dofs of a lamina.
    """
    layout = structure.layout
    most = min(layout.own_dofs(i).size for i in range(len(layout.parts)))
    if not 1 <= n <= most:
        raise CaseError(f"number of modes: expected 1 to {most} (dofs of a lamina), given {n}")
    shapes = np.zeros((len(layout.parts), n, layout.x.size))
    frequencies = np.zeros((len(layout.parts), n))
    for i in range(len(layout.parts)):
        frequencies[i], vectors = lowest(*_own_block(structure, i), n)
        shapes[i] = _deflections(structure, i, vectors)
    exact = [np.asarray(lamina.angular_frequencies(n)) / (2.0 * np.pi) for lamina in case.lamina]
    return Modes(layout.names, frequencies, np.stack(exact), layout.x, shapes)


def _own_block(structure: Structure, number: int) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Return (K, M) of one part alone."""
    o, own = structure.operators, structure.layout.own_dofs(number)
    return o.stiffness[own][:, own], o.mass[own][:, own]


def _deflections(structure: Structure, number: int, vectors: FloatArray) -> FloatArray:
    """Return the deflections of a part at its points, 1 at the last one, shape (n, n_points)."""
    layout, n = structure.layout, vectors.shape[1]
    whole = np.zeros((n, structure.operators.n_dofs))
    whole[:, layout.own_dofs(number)] = vectors.T
    shapes = fields.nodal(layout, whole, np.zeros(n))[0, number]
    return np.asarray(shapes / shapes[:, -1:])
