"""The meaning of the unknowns of a structure: parts, interfaces, probes and supports.

`Operators` contain only numbers. A layout says which dof belongs to which point of which part,
between which points the contact pairs are, and which points the probes record at every step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from delam_fem.model.operators import Operators
from delam_fem.numerics.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from delam_fem.model.solids.body import Body
    from delam_fem.mpi import MPI

BASE, FIXED = -1, -2
"""Values in `Part.dofs` in place of a free dof: the point moves with the base, or never moves."""
DISPLACEMENT, SLOPE = 0, 1
"""Columns of `Part.dofs`."""


@dataclass(frozen=True)
class Part:
    """One body of the structure: a lamina.

    Attributes:
        name: name of the part.
        x: positions of its points along the structure, increasing, shape (n_points,) [m].
        dofs: the free dofs of displacement and slope at each point, or BASE, or FIXED, shape
            (n_points, 2). With a `Reading` they are its rows.
        flexural_rigidity: EI of each cell between two points, shape (n_points - 1,) [N m2].
        mass_per_length: ρA of each cell, shape (n_points - 1,) [kg/m].
    """

    name: str
    x: FloatArray
    dofs: IntArray
    flexural_rigidity: FloatArray
    mass_per_length: FloatArray

    def __post_init__(self) -> None:
        """Check the shapes.

        Raises:
            ValueError: an array does not fit the points, or the points do not increase.
        """
        if self.x.ndim != 1 or self.x.size < 2 or not np.all(np.diff(self.x) > 0.0):
            raise ValueError(
                f"part {self.name}: x must increase over at least two points, given {self.x}"
            )
        n = self.x.size
        shapes = {"dofs": (n, 2), "flexural_rigidity": (n - 1,), "mass_per_length": (n - 1,)}
        for name, expected in shapes.items():
            given = getattr(self, name).shape
            if given != expected:
                raise ValueError(f"part {self.name}: {name} has shape {given}, expected {expected}")

    @property
    def n_elements(self) -> int:
        """Number of elements."""
        return self.x.size - 1

    def positions(self, places: FloatArray) -> FloatArray:
        """Return x at places along the part, shape (k,) [m].

        Args:
            places: numbers of points; 2.25 lies a quarter of the cell behind point 2, shape (k,).
        """
        return np.asarray(np.interp(places, np.arange(self.x.size), self.x))

    @property
    def own_dofs(self) -> IntArray:
        """The free dofs of the part, increasing, shape (n,)."""
        return np.asarray(np.unique(self.dofs[self.dofs >= 0]))


@dataclass(frozen=True)
class Interface:
    """Two parts that may touch at pairs of opposite points, which may lie inside the cells.

    Attributes:
        name: name of the interface.
        parts: numbers of the lower and the upper part.
        points: points of the lower and the upper part that form each pair, shape (n_pairs, 2). Of
            a pair inside cells: the points at which its cells end.
        first_pair: row of the first of these pairs in the gap operator.
        local: local coordinates of the pairs within the cells that end at `points`, above 0, 1: at
            these points, shape (n_pairs, 2) [-]; None: all pairs are at points.
    """

    name: str
    parts: tuple[int, int]
    points: IntArray
    first_pair: int = 0
    local: FloatArray | None = None

    def __post_init__(self) -> None:
        """Check the local coordinates.

        Raises:
            ValueError: they do not fit the points, or one is not within its cell.
        """
        if self.local is None:
            return
        inside = self.local < 1.0
        if self.local.shape != self.points.shape or np.any(inside & (self.points < 1)):
            raise ValueError(
                f"interface {self.name}: expected a local coordinate for each of the points "
                f"{self.points.shape}, and no pair before the first point"
            )
        if np.any(self.local <= 0.0) or np.any(self.local > 1.0):
            raise ValueError(
                f"interface {self.name}: expected local coordinates above 0, up to 1, given "
                f"{self.local.min()} to {self.local.max()}"
            )

    @property
    def pairs(self) -> slice:
        """The rows of the gap operator that belong to this interface."""
        return slice(self.first_pair, self.first_pair + len(self.points))

    @property
    def is_at_points(self) -> bool:
        """Whether all pairs are at points of the parts, none inside a cell."""
        return self.local is None or bool(np.all(self.local == 1.0))

    def places(self, side: int) -> FloatArray:
        """Return the pairs' places on a part as numbers of points, shape (n_pairs,).

        A whole number is that point; 2.25 lies a quarter of the cell behind point 2.

        Args:
            side: 0 for the lower part, 1 for the upper part.
        """
        points = self.points[:, side].astype(np.float64)
        return points if self.local is None else points - 1.0 + self.local[:, side]


@dataclass(frozen=True)
class Probe:
    """A point whose motion is recorded at every step; one row of `Operators.probes`.

    Attributes:
        name: name of the point, for example "tip".
        part: number of the part.
        point: number of the point within the part.
    """

    name: str
    part: int
    point: int


@dataclass(frozen=True)
class SensorRows:
    """What a sensor reads: the weights of recorded numbers in its signal.

    Attributes:
        name: name of the sensor.
        of_u: row of `Operators.sensors` whose value of u counts; None: none.
        of_v: row of `Operators.sensors` whose value of v counts; None: none.
        of_base: weights of q, q', q'' of the base (or of the force), shape (3,).
        of_forces: weights of the forces of contact springs, positive where they part the laminae,
            shape (n_pairs,); None: they do not count.
        of_impulses: weights of impulses over the time step that act through M, shape (n_pairs,).
        of_lumped_impulses: the same for impulses that act through the lumped mass.
        unit: unit of the signal.
        words: the sensor in words.
    """

    name: str
    of_u: int | None
    of_v: int | None
    of_base: tuple[float, float, float] = (0.0, 0.0, 0.0)
    of_forces: FloatArray | None = None
    of_impulses: FloatArray | None = None
    of_lumped_impulses: FloatArray | None = None
    unit: str = "1"
    words: str = ""


@dataclass(frozen=True)
class Support:
    """A point of a part that is held.

    Attributes:
        part: number of the part.
        point: number of the point within the part.
        kind: "clamped" to the base.
    """

    part: int
    point: int
    kind: str = "clamped"


@dataclass(frozen=True)
class Reading:
    """Deflection and slope of the parts of a solid, as functionals of its dofs.

    The middle line of each part stands for the part, as a beam does. Row r reads

        matrix[r] u + base[r] q,   u of the free dofs, q of the base.

    On several ranks each one holds the columns of its own dofs, and what it reads is the sum over
    all ranks.

    Attributes:
        matrix: CSR (n_readings, n_own), n_own = number of free dofs of this rank.
        base: shape (n_readings,).
        part: number of the part to which each free dof of this rank belongs; -1 where bonded parts
            share it, shape (n_own,).
        comm: the communicator whose ranks share the dofs; None: this process has them all.
    """

    matrix: sp.csr_matrix
    base: FloatArray
    part: IntArray
    comm: MPI.Intracomm | None = None

    def of(self, vectors: FloatArray, base: FloatArray) -> FloatArray:
        """Return what states read (collective), shape (k, n_readings).

        Args:
            vectors: values of the free dofs of this rank, shape (k, n_own).
            base: values of the base, shape (k,).
        """
        read = np.ascontiguousarray((self.matrix @ vectors.T).T)
        if self.comm is not None:
            read = np.sum(self.comm.allgather(read), axis=0)
        return np.asarray(read + base[:, None] * self.base)

    def rows(self, of_readings: sp.spmatrix) -> sp.csr_matrix:
        """Return functionals of readings as functionals of dofs, shape (k, n_own)."""
        return sp.csr_matrix(of_readings @ self.matrix)


@dataclass(frozen=True)
class Layout:
    """The meaning of the rows and columns of operators.

    Attributes:
        parts: the parts from bottom to top.
        interfaces: the interfaces between parts.
        probes: the probes, in the order of the rows of `Operators.probes`.
        supports: the points where parts are held.
        sensors: the sensors.
        gap_row: row of `Operators.sensors` at which the rows of all gaps begin; None: there are
            none, because no sensor reads contact forces.
        reading: what the points of the parts read from the dofs of a solid; None: `Part.dofs` are
            dofs.
    """

    parts: tuple[Part, ...]
    interfaces: tuple[Interface, ...]
    probes: tuple[Probe, ...] = ()
    supports: tuple[Support, ...] = ()
    sensors: tuple[SensorRows, ...] = ()
    gap_row: int | None = None
    reading: Reading | None = None

    def n_numbered(self, n_dofs: int) -> int:
        """Return how many numbers `Part.dofs` may have: of readings, or of free dofs."""
        return n_dofs if self.reading is None else self.reading.base.size

    def read(self, vectors: FloatArray, base: FloatArray) -> FloatArray:
        """Return the values that `Part.dofs` number (collective), shape (k, n_numbered).

        Args:
            vectors: values of the free dofs, shape (k, n).
            base: values of the base, shape (k,).
        """
        return vectors if self.reading is None else self.reading.of(vectors, base)

    def of_dofs(self, rows: sp.spmatrix) -> sp.csr_matrix:
        """Return functionals of what `Part.dofs` number as functionals of free dofs.

        Args:
            rows: shape (k, n_numbered), or (k, n_numbered + 1) with a column of the base.

        Returns:
            Shape (k, n), or (k, n + 1).
        """
        rows = sp.csr_matrix(rows)
        if self.reading is None:
            return rows
        n = self.reading.base.size
        own = self.reading.rows(rows[:, :n])
        if rows.shape[1] == n:
            return own
        base = rows[:, n].toarray().ravel() + rows[:, :n] @ self.reading.base
        return sp.hstack([own, sp.csr_matrix(base[:, None])], format="csr")

    def own_dofs(self, number: int) -> IntArray:
        """Return the free dofs of a part, increasing, shape (n,)."""
        if self.reading is None:
            return self.parts[number].own_dofs
        return np.asarray(np.flatnonzero(self.reading.part == number))

    @property
    def x(self) -> FloatArray:
        """Positions of the points, which all parts share, shape (n_points,) [m].

        Raises:
            ValueError: the parts do not share their points.
        """
        first, *others = self.parts
        if any(not np.array_equal(part.x, first.x) for part in others):
            raise ValueError(
                "layout: expected the same points x on all parts; use the points of each part"
            )
        return first.x

    @property
    def n_elements(self) -> int:
        """Number of elements per part, if all parts share their points."""
        return self.x.size - 1

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parts."""
        return tuple(part.name for part in self.parts)

    @cached_property
    def stations(self) -> FloatArray:
        """Places of all points and pairs along the lower parts, increasing, shape (n_stations,).

        Results are kept at the stations. If all pairs are at points, the stations are the points.
        """
        points = np.arange(self.x.size, dtype=np.float64)
        inside = [i.places(0) for i in self.interfaces if not i.is_at_points]
        return np.asarray(np.unique(np.concatenate([points, *inside])))

    def stations_of(self, interface: Interface) -> IntArray:
        """Return the station of each pair of an interface, shape (n_pairs,)."""
        return np.searchsorted(self.stations, interface.places(0))

    def station_of_point(self, point: int) -> int:
        """Return the station at a point."""
        return int(np.searchsorted(self.stations, float(point)))

    def at_stations(self, interface: Interface, of_pairs: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Arrange the values of an interface's pairs by stations.

        Pairs across the width of a solid share a station: of states (integers) it has the largest,
        of other values the sum.

        Args:
            interface: one of `interfaces`.
            of_pairs: values of all pairs of the structure, shape (…, n_pairs).

        Returns:
            Values at the stations, 0 where there is no pair, shape (…, n_stations).
        """
        result = np.zeros((*of_pairs.shape[:-1], self.stations.size), dtype=of_pairs.dtype)
        collect = np.maximum if np.issubdtype(of_pairs.dtype, np.integer) else np.add
        collect.at(result.T, self.stations_of(interface), of_pairs[..., interface.pairs].T)
        return result


@dataclass(frozen=True)
class Structure:
    """A discretised structure.

    Attributes:
        operators: M, C, K, base coupling, gap operator, gaps at rest, probes.
        layout: the meaning of their rows and columns.
        body: of a solid structure, for the output of its fields; None: beams, or no output.
    """

    operators: Operators
    layout: Layout
    body: Body | None = None

    def __post_init__(self) -> None:
        """Check that both describe the same problem.

        Raises:
            ValueError: dofs, pairs or probes of the layout are not those of the operators.
        """
        o, layout = self.operators, self.layout
        dofs = np.concatenate([part.dofs.ravel() for part in layout.parts])
        n = layout.n_numbered(o.n_dofs)
        if dofs.max() >= n:
            what = "free dofs" if layout.reading is None else "readings"
            raise ValueError(f"layout: dof {dofs.max()}, expected below {n}, the number of {what}")
        n_pairs = sum(len(interface.points) for interface in layout.interfaces)
        for what, given, expected in (
            ("pairs", n_pairs, o.n_pairs),
            ("probes", len(layout.probes), o.n_probes),
        ):
            if given != expected:
                raise ValueError(f"layout: {given} {what}, the operators have {expected}")
