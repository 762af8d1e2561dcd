"""Compare the package's main path (dolfinx, PETSc) with the reference: matrices and motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from matplotlib.figure import Figure

from delam_fem.case.definition import Case
from delam_fem.case.files import CaseSource, find_case
from delam_fem.model.discretise import (
    INSTALL,
    assemble,
    has_dolfinx,
    require_kind,
    require_mass,
    require_plain,
)
from delam_fem.model.layout import Structure
from delam_fem.model.operators import Operators
from delam_fem.numerics.types import FloatArray
from delam_fem.plugins.report import Finding, Report, Table
from delam_fem.plugins.study import RunContext
from delam_fem.reference import matrices
from delam_fem.reference.loop import ReferenceRun, refused_motion, simulate_reference
from delam_fem.reference.matrices import lowest_frequencies
from delam_fem.reference.study import Compare
from delam_fem.results.channels import of_references
from delam_fem.results.figures.style import label_x, stacked
from delam_fem.results.folder import Result
from delam_fem.studies.models import ModelComparison, compare_models
from delam_fem.studies.modes.frequencies import modes_of, structure_modes
from delam_fem.system.errors import CaseError, require


@dataclass(frozen=True)
class Motions:
    """Channels of a run with dolfinx and PETSc, and of the reference.

    Attributes:
        names: names of the channels.
        times: ends of the steps, shape (n,) [s].
        values: the channels of the dolfinx/PETSc run, shape (n_channels, n) [m].
        reference: those of the reference, shape (n_channels, n) [m].
        impacts: number of impacts of the dolfinx/PETSc run and of the reference.
        impact_limit: the number of the last impact that `until_impact` covers.
        impact_time: its time in the reference, the end if there was no impact [s].
    """

    names: tuple[str, ...]
    times: FloatArray
    values: FloatArray
    reference: FloatArray
    impacts: tuple[int, int]
    impact_limit: int
    impact_time: float

    @property
    def differences(self) -> FloatArray:
        """Largest difference of all channels at each step, shape (n,) [m]."""
        return np.asarray(np.abs(self.values - self.reference).max(axis=0))

    @property
    def until_impact(self) -> float:
        """Largest difference of the histories up to impact `impact_limit` [m]."""
        return float(self.differences[self.times <= self.impact_time].max())

    @property
    def overall(self) -> float:
        """Largest difference of the histories over the whole run [m]."""
        return float(self.differences.max())

    def rows(self) -> list[tuple[str, str]]:
        """Return the rows of a table: the largest differences, and how many impacts there were."""
        until = (f"histories up to impact {self.impact_limit}", f"{self.until_impact:.1e} m")
        return [
            *([until] if self.impact_limit else []),
            (f"histories up to {self.times[-1]:.4g} s", f"{self.overall:.1e} m"),
            ("impacts, dolfinx and reference", f"{self.impacts[0]} and {self.impacts[1]}"),
        ]

    def numbers(self) -> dict[str, object]:
        """Return the differences for a JSON file."""
        return {
            "impact_limit": self.impact_limit,
            "impact_time_s": self.impact_time,
            "tips_until_impact_m": self.until_impact,
            "tips_overall_m": self.overall,
            "end_time_s": float(self.times[-1]),
            "impacts": {"dolfinx": self.impacts[0], "reference": self.impacts[1]},
        }

    def figure(self) -> Figure:
        """Draw the channels of both runs, and their difference on a logarithmic axis."""
        figure, (top, bottom) = stacked(2, 6.0, sharex=True)
        for i, name in enumerate(self.names):
            top.plot(self.times, 1e3 * self.values[i], color=f"C{i}", label=f"{name}, dolfinx")
            top.plot(self.times, 1e3 * self.reference[i], "k:", label=f"{name}, reference")
        top.set(ylabel="displacement [mm]")
        top.legend(ncols=2, fontsize=8)
        differences = np.maximum(self.differences, np.finfo(np.float64).tiny)
        bottom.semilogy(self.times, differences, color="C3", linewidth=0.8)
        if self.impact_limit:
            bottom.axvline(self.impact_time, color="0.5", linestyle="--")
            label = f" impact {self.impact_limit}"
            bottom.annotate(label, (self.impact_time, differences.max()), fontsize=8, va="top")
        floor = max(
            float(differences[differences > np.finfo(np.float64).tiny].min(initial=1e-18)), 1e-20
        )
        label_x((top, bottom), "time [s]")
        bottom.set(ylabel="largest difference [m]", ylim=(floor, None))
        figure.suptitle("dolfinx and PETSc beside the independent reference")
        return figure


COMPARED_MODES = 6
"""Number of compared natural frequencies per lamina; fewer if the mesh has fewer."""


@dataclass(frozen=True)
class Comparison(Finding):
    """Differences between dolfinx with PETSc and the reference for one case.

    Attributes:
        matrices: largest relative difference of each operator [-].
        frequencies: largest relative difference of the first natural frequencies [-].
        motion: both motions; None: the reference cannot compute the motion of the case.
        refusal: why the reference cannot compute it; empty if it can.
    """

    matrices: dict[str, float]
    frequencies: float
    motion: Motions | None = None
    refusal: str = ""

    def rows(self) -> list[tuple[str, str]]:
        """Return the rows of a table: the compared numbers and their largest differences."""
        return [
            *((f"{name}, relative", f"{value:.1e}") for name, value in self.matrices.items()),
            ("natural frequencies, relative", f"{self.frequencies:.1e}"),
            *(self.motion.rows() if self.motion else [("motion", "not compared")]),
        ]

    @property
    def report(self) -> Report:
        """The comparison as files and the terminal show it."""
        entries: dict[str, object] = {
            "matrices_relative": self.matrices,
            "frequencies_relative": self.frequencies,
        }
        tables = [Table("largest differences", ("what", "difference"), self.rows())]
        if self.motion is None:
            remarks = [f"the motion is not compared: {self.refusal}"]
            numbers = {**entries, "no_motion": self.refusal}
            return Report(name="compare", numbers=numbers, tables=tables, remarks=remarks)
        return Report(
            name="compare",
            numbers=entries | self.motion.numbers(),
            tables=tables,
            pictures={"compare": (self.motion.figure, "")},
        )


def compare(case: CaseSource, *, impacts: int = 20, periods: int = 3) -> Comparison:
    """Compare the matrices and frequencies of a case with the reference, and its motion from rest.

    The reference computes the motion of some laws with Newmark and a harmonic excitation. Each
    impact amplifies round-off, so any two runs differ after many impacts. The difference up to the
    first impacts is the number to judge by.

    Args:
        case: a case of beams with mass at their nodes.
        impacts: number of impacts up to which the histories are compared.
        periods: number of periods of both runs.

    Returns:
        The differences of matrices and frequencies, and of the motion if the reference has it.

    Raises:
        CaseError: a number is below 1, dolfinx is not installed, or the reference has no matrices
            for this kind of case.
    """
    case = find_case(case)
    for name, number in (("impacts", impacts), ("periods", periods)):
        require(number >= 1, name, "at least 1", number)
    require_kind(
        case, "compare", ("beam",), "the reference is one of beams; --models compares models"
    )
    require_mass(case, "compare", "its masses are at nodes; converge refines the case")
    require_plain(case, "compare")
    require(
        case.excitation.acts_on == "base",
        "excitation: compare",
        "a motion of the base, which the reference has",
        case.excitation.kind,
    )
    from delam_fem import pipeline  # dolfinx too; its HDF5 must come after that of the pipeline

    if not has_dolfinx():
        raise CaseError(f"compare: dolfinx or petsc4py is not installed: {INSTALL}")
    structure = assemble(case)
    x = structure.layout.x
    observed = structure.layout.probes[0].point
    independent = matrices.assemble(case, x, observed)
    motion = None
    refusal = refused_motion(case)
    if not refusal:
        span = {"time.periods": periods, "output.window_periods": periods}
        short = case.with_overrides({**span, "output.fields_per_period": 0})
        expected = simulate_reference(independent, short, periods=periods)
        motion = _motions(pipeline.run(short, structure=structure), expected, impacts)
    return Comparison(
        matrices=operator_differences(structure.operators, independent),
        frequencies=_frequency_difference(structure, independent, case),
        motion=motion,
        refusal=refusal,
    )


def _motions(given: Result, expected: ReferenceRun, impacts: int) -> Motions:
    """Return the motions of the package and of the reference side by side."""
    history = given.history
    names = tuple(of_references(history["lamina"].to_numpy().tolist()))
    values = np.array([given.record[name].to_numpy() for name in names])
    if values.shape != expected.displacement.shape:
        raise RuntimeError(
            f"the run recorded histories of shape {values.shape}, expected "
            f"{expected.displacement.shape}: the run was interrupted or diverged; run it "
            "again, or compare fewer periods"
        )
    n_impacts = (int(history.sizes["event"]), len(expected.events))
    limit = min(impacts, *n_impacts)
    return Motions(
        names=names,
        times=expected.times,
        values=values,
        reference=expected.displacement,
        impacts=n_impacts,
        impact_limit=limit,
        impact_time=float(expected.events[limit - 1].time if limit else expected.times[-1]),
    )


def operator_differences(given: Operators, expected: Operators) -> dict[str, float]:
    """Return the largest relative difference of each operator.

    Differences of matrix entries are relative to the diagonal, |a_ij - b_ij| / sqrt(b_ii b_jj), so
    that displacements and slopes have the same weight. Differences of the gap are relative to its
    largest value.

    Args:
        given: operators to check.
        expected: operators of the reference.

    Returns:
        Relative difference by name of the operator [-].
    """
    blocks: dict[str, float] = {}
    columns: dict[str, float] = {}
    for k, (letter, name) in enumerate((("M", "mass"), ("C", "damping"), ("K", "stiffness"))):
        relative = _scaled_difference(_bordered(given, name, k), _bordered(expected, name, k))
        blocks[letter] = float(relative[1:, 1:].max())
        columns[f"{letter}, column of the base"] = float(relative[:, 0].max())
    lumped = np.abs(given.require_lumped_mass() / expected.require_lumped_mass() - 1.0)
    H = np.abs((given.gap_matrix - expected.gap_matrix).toarray())
    largest = np.abs(expected.gap0).max(initial=0.0) or 1.0  # 0: all closed at rest
    vectors = {"lumped mass": lumped, "H": H, "gap0": np.abs(given.gap0 - expected.gap0) / largest}
    if expected.load is not None and given.load is not None:
        size = np.abs(expected.load).max()
        vectors["loads"] = np.abs(given.load - expected.load) / size
    return blocks | columns | {name: float(each.max(initial=0.0)) for name, each in vectors.items()}


def _bordered(operators: Operators, name: str, k: int) -> sp.csr_matrix:
    """Return M, C or K (k = 0, 1, 2) with the base as an additional first dof."""
    corner = sp.csr_matrix([[operators.base.corner[k]]])
    column = sp.csr_matrix(getattr(operators.base, name)).T
    return sp.bmat([[corner, column.T], [column, getattr(operators, name)]], format="csr")


def _scaled_difference(a: sp.csr_matrix, b: sp.csr_matrix) -> sp.csr_matrix:
    """Return |a_ij - b_ij| / sqrt(b_ii b_jj); 0 if a_ij = b_ij."""
    difference = abs(a - b).tocoo()
    difference.eliminate_zeros()
    diagonal = b.diagonal()
    scale = np.sqrt(diagonal[difference.row] * diagonal[difference.col])
    entries = np.divide(difference.data, scale, out=np.full_like(scale, np.inf), where=scale > 0.0)
    return sp.csr_matrix((entries, (difference.row, difference.col)), shape=a.shape)


def _frequency_difference(given: Structure, expected: Operators, case: Case) -> float:
    """Return the largest relative difference of frequencies: of each lamina, or of the stack."""
    if not case.is_apart:
        n = min(COMPARED_MODES, given.operators.n_dofs)
        frequencies = structure_modes(given, case, n).frequencies
        other = lowest_frequencies(expected, n)
        elastic = other > 1e-6 * other[-1]  # a floating stack has rigid modes too
        return float(np.abs(frequencies[elastic] / other[elastic] - 1.0).max())
    n = min(
        COMPARED_MODES, *(given.layout.own_dofs(i).size for i in range(len(given.layout.parts)))
    )
    ratio = modes_of(given, case, n).frequencies / matrices.natural_frequencies(expected, n)
    return float(np.abs(ratio - 1.0).max())


def compute(case: Case, options: Compare, _: RunContext) -> Comparison | ModelComparison:
    """Compare a case with the reference, or with the models that the options name."""
    if options.models is None:
        return compare(case, impacts=options.impacts, periods=options.periods or 3)
    return compare_models(
        case,
        options.models,
        frequencies=options.at,
        periods=options.periods or 20,
        modes=options.modes,
        channels=options.channel,
    )
