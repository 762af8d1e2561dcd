"""The meaning of the unknowns of a structure: parts, interfaces, contact pairs, probes, fields.

`Operators` contain only numbers. A layout says which dof belongs to which point of which part,
between which points the contact pairs are, and which points the probes record at every step.

From a layout follow the gap operator, the lengths that belong to pairs, and the rows of probes. A
pair is at two opposite points, or inside two opposite cells, where the gap is that of the cubic
Hermite interpolants of both parts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from delam_fem.model.operators import Operators
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.errors import CaseError

if TYPE_CHECKING:
    from delam_fem.model.solids.body import Body
    from delam_fem.system.mpi import MPI

BASE, FIXED = -1, -2
"""Values in `Part.dofs` in place of a free dof: the point moves with the base, or never moves."""
DISPLACEMENT, SLOPE = 0, 1
"""Columns of `Part.dofs`."""
_AT_PLACE = 1e-9
"""Distance within which two places are one [m]."""


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
        end_rigidity: EI at both ends of each cell where it changes within cells, shape
            (n_points - 1, 2) [N m2]; None: it does not.
    """

    name: str
    x: FloatArray
    dofs: IntArray
    flexural_rigidity: FloatArray
    mass_per_length: FloatArray
    end_rigidity: FloatArray | None = None

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
            shape = getattr(self, name).shape
            if shape != expected:
                raise ValueError(f"part {self.name}: {name} has shape {shape}, expected {expected}")

    @property
    def n_elements(self) -> int:
        """Number of elements."""
        return self.x.size - 1

    @property
    def n_points(self) -> int:
        """Number of points up to the end of the part; those beyond have neither dofs nor cells."""
        return int(np.flatnonzero(self.dofs[:, DISPLACEMENT] != FIXED)[-1]) + 1

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
    """Two parts that may touch at pairs of opposite places, at points or inside cells.

    Attributes:
        name: name of the interface.
        parts: numbers of the lower and the upper part, which share their points.
        places: places of the pairs along both parts as numbers of points, shape (n_pairs,); 2.25
            lies a quarter of the cell behind point 2.
        first_pair: row of the first of these pairs in the gap operator.
        at: x and z of each pair, where they are no points in the middle of the width, shape
            (n_pairs, 2) [m]; None: they are at `places`.
    """

    name: str
    parts: tuple[int, int]
    places: FloatArray
    first_pair: int = 0
    at: FloatArray | None = None

    @property
    def pairs(self) -> slice:
        """The rows of the gap operator that belong to this interface."""
        return slice(self.first_pair, self.first_pair + self.places.size)


@dataclass(frozen=True)
class StopPairs:
    """Pairs of a part with a stop or an impactor, on one of its sides.

    Attributes:
        number: number of the stop in the case, from 0; impactors count on behind all stops.
        part: number of the part.
        places: places of the pairs on the part as numbers of points, shape (n_pairs,).
        side: 1: the stop is above the part; -1: below.
        first_pair: row of the first of these pairs in the gap operator.
        on_base: whether the stop moves with the base.
        spot: of a plate the place that it strikes, beside the middle line; None: it is on it.
    """

    number: int
    part: int
    places: FloatArray
    side: int
    first_pair: int
    on_base: bool
    spot: Place | None = None

    @property
    def pairs(self) -> slice:
        """The rows of the gap operator that belong to this stop."""
        return slice(self.first_pair, self.first_pair + self.places.size)


class Place(NamedTuple):
    """A place of a plate beside the middle line of a lamina, or on a surface.

    Attributes:
        part: number of the lamina.
        x: position along it [m].
        z: position across, from the middle of the width [m].
        side: 1: its top, 0: its middle, -1: its bottom.
    """

    part: int
    x: float
    z: float
    side: int


@dataclass(frozen=True)
class Probe:
    """A point whose motion is recorded at every step; one row of `Operators.probes`.

    Attributes:
        name: name of the point, for example "tip".
        part: number of the part.
        point: number of the point within the part; of a place beside it the nearest.
        place: where it is, if it is a place beside the points of the part.
    """

    name: str
    part: int
    point: int
    place: Place | None = None


@dataclass(frozen=True)
class SensorRows:
    """What a sensor reads: the weights of recorded numbers in its signal.

    Attributes:
        name: name of the sensor.
        of_u: row of `Operators.sensors` whose value of u counts; None: none.
        of_v: row of `Operators.sensors` whose value of v counts; None: none.
        of_base: weights of q and q' of the base (or of the force), shape (2,).
        of_forces: weights of the forces of contact springs, and of impulses over the time step,
            positive where they part the laminae, shape (n_pairs,); None: they do not count.
        is_rate: whether the signal is the change of this sum with time, as an acceleration is that
            of a velocity.
        unit: unit of the signal.
        words: the sensor in words.
    """

    name: str
    of_u: int | None
    of_v: int | None
    of_base: tuple[float, float] = (0.0, 0.0)
    of_forces: FloatArray | None = None
    is_rate: bool = False
    unit: str = "1"
    words: str = ""


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


@dataclass(frozen=True)
class Sheets:
    """The middle surfaces of the laminae of a reduced plate, which show what its body does.

    Attributes:
        points: x, y and z of each point at half of the height of its lamina, shape (n, 3) [m].
        thickness: thickness of the lamina there, shape (n,) [m].
        part: number of the lamina, shape (n,).
        cells: points of each cell, counter-clockwise from above, shape (n_cells, 4).
        matrix: deflection of the points as functionals of the dofs, shape (n, n_dofs); of single
            precision in a file, 7 digits of what is shown.
        base: of the base, shape (n,).
    """

    points: FloatArray
    thickness: FloatArray
    part: IntArray
    cells: IntArray
    matrix: Any
    base: FloatArray

    def of(self, vectors: FloatArray, base: FloatArray) -> FloatArray:
        """Return the deflections of the points, shape (k, n) [m].

        Args:
            vectors: values of the dofs; those of impactors follow and are not read, (k, n_dofs).
            base: values of the base, shape (k,).
        """
        moved = vectors[:, : self.matrix.shape[1]] @ self.matrix.T
        return np.asarray(moved + base[:, None] * self.base)


@dataclass(frozen=True)
class Layout:
    """The meaning of the rows and columns of operators.

    Attributes:
        parts: the parts from bottom to top.
        interfaces: the interfaces between parts.
        probes: the probes, in the order of the rows of `Operators.probes`.
        stops: the pairs with stops and then with impactors, after those of the interfaces.
        sensors: the sensors.
        gap_row: row of `Operators.sensors` at which the rows of gaps begin; None: there are none.
        first_gap: the first pair whose gap has such a row; those of all later pairs follow.
        reading: what the points of the parts read from the dofs of a solid; None: `Part.dofs` are
            dofs.
        n_impactors: number of impactors, whose displacements are the last dofs and the first rows
            of `Operators.sensors`.
        places: places of a plate beside the points of the parts; their deflections are the last
            rows of `reading`.
        sheets: the surfaces of a reduced plate; None: of others.
    """

    parts: tuple[Part, ...]
    interfaces: tuple[Interface, ...]
    probes: tuple[Probe, ...] = ()
    sensors: tuple[SensorRows, ...] = ()
    gap_row: int | None = None
    first_gap: int = 0
    reading: Reading | None = None
    stops: tuple[StopPairs, ...] = ()
    n_impactors: int = 0
    places: tuple[Place, ...] = ()
    sheets: Sheets | None = None

    def number_of(self, place: Place) -> int:
        """Return the row of the reading that is the deflection at a place.

        Raises:
            CaseError: there is none, because the model was reduced without the place.
        """
        return int(self.numbers_of((place,))[0])

    def numbers_of(self, places: Sequence[Place]) -> IntArray:
        """Return the rows of the reading that are the deflections at places, shape (k,).

        Raises:
            CaseError: there is none of one, because the model was reduced without the place.
        """
        assert self.reading is not None
        first = self.reading.base.size - len(self.places)
        known = self._places_by_side
        return np.array([first + self._nearest(place, known) for place in places], dtype=np.int64)

    @cached_property
    def _places_by_side(self) -> dict[tuple[int, int], tuple[IntArray, FloatArray]]:
        """Numbers of the places of each part and side, and their x and z, shape (n, 2) [m]."""
        sides: dict[tuple[int, int], list[int]] = {}
        for number, place in enumerate(self.places):
            sides.setdefault((place.part, place.side), []).append(number)
        return {
            side: (np.array(chosen), np.array([self.places[k][1:3] for k in chosen]))
            for side, chosen in sides.items()
        }

    def _nearest(
        self, place: Place, known: dict[tuple[int, int], tuple[IntArray, FloatArray]]
    ) -> int:
        """Return the number of a place among those that have readings.

        Raises:
            CaseError: it is none of them.
        """
        if (place.part, place.side) in known:
            chosen, at = known[place.part, place.side]
            distance = np.abs(at - [place.x, place.z]).sum(axis=1)
            if distance.min() <= _AT_PLACE:
                return int(chosen[distance.argmin()])
        raise CaseError(
            f"position: expected one of the {len(self.places)} places that the case had when it "
            f"was reduced, given ({place.x:g}, {place.z:g}) m of {self.names[place.part]}; reduce "
            "the case again with this place"
        )

    def row_of(self, place: Place) -> sp.csr_matrix:
        """Return the row that reads the deflection at a place, shape (1, n_numbered + 1)."""
        number = self.number_of(place)
        n = self.n_numbered(0)
        return sp.csr_matrix(([1.0], ([0], [number])), shape=(1, n + 1))

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
        reduced_rows = sp.csr_matrix(rows[:, :n] @ self.reading.matrix)
        if rows.shape[1] == n:
            return reduced_rows
        base = rows[:, n].toarray().ravel() + rows[:, :n] @ self.reading.base
        return sp.hstack([reduced_rows, sp.csr_matrix(base[:, None])], format="csr")

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
    def names(self) -> tuple[str, ...]:
        """Names of the parts."""
        return tuple(part.name for part in self.parts)

    @property
    def touching(self) -> tuple[Interface | StopPairs, ...]:
        """What has pairs, in the order of their rows in the gap operator."""
        return (*self.interfaces, *self.stops)

    @cached_property
    def stations(self) -> FloatArray:
        """Places of all points and pairs along the lower parts, increasing, shape (n_stations,).

        Results are kept at the stations. If all pairs are at points, the stations are the points.
        """
        points = np.arange(self.x.size, dtype=np.float64)
        return np.asarray(
            np.unique(np.concatenate([points, *[pairs.places for pairs in self.touching]]))
        )

    def positions_of(self, interface: Interface) -> tuple[FloatArray, FloatArray]:
        """Return x and z of each pair of an interface, shape (n_pairs,) each [m]."""
        if interface.at is not None:
            return interface.at[:, 0], interface.at[:, 1]
        x = self.parts[interface.parts[0]].positions(interface.places)
        return x, np.zeros_like(x)

    def pairs_at_references(self) -> list[int | None]:
        """Return the pair of each interface at the reference probe of its lower part, or None."""
        pairs: list[int | None] = []
        for interface in self.interfaces:
            point = self.probes[interface.parts[0]].point
            matches = np.flatnonzero(interface.places == point)
            pairs.append(interface.first_pair + int(matches[0]) if matches.size else None)
        return pairs

    def stations_of(self, interface: Interface) -> IntArray:
        """Return the station of each pair of an interface, shape (n_pairs,)."""
        return np.searchsorted(self.stations, interface.places)

    def station_of_point(self, point: int) -> int:
        """Return the station at a point."""
        return int(np.searchsorted(self.stations, float(point)))

    def at_stations(
        self, interface: Interface, of_pairs: npt.NDArray[Any], *, are_gaps: bool = False
    ) -> npt.NDArray[Any]:
        """Arrange the values of an interface's pairs by stations.

        Pairs across the width of a solid share a station: of states (integers) it has the largest,
        of gaps the smallest, of other values the sum.

        Args:
            interface: one of `interfaces`.
            of_pairs: values of all pairs of the structure, shape (…, n_pairs).
            are_gaps: whether the values are gaps.

        Returns:
            Values at the stations, 0 where there is no pair, shape (…, n_stations).
        """
        result = np.zeros((*of_pairs.shape[:-1], self.stations.size), dtype=of_pairs.dtype)
        collect: np.ufunc = np.add
        if np.issubdtype(of_pairs.dtype, np.integer):
            collect = np.maximum
        if are_gaps:
            collect = np.minimum
            result[..., self.stations_of(interface)] = np.inf
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
        for what, count, expected in (
            ("pairs", sum(pairs.places.size for pairs in layout.touching), o.n_pairs),
            ("probes", len(layout.probes), o.n_probes),
        ):
            if count != expected:
                raise ValueError(f"layout: {count} {what}, the operators have {expected}")


CURVATURE = 2
"""The second derivative of the interpolant, beside DISPLACEMENT and SLOPE."""
_AT_POINT = 1e-9
"""Share of a cell within which a place is at its end."""


def reference_channels(name: str) -> tuple[str, str]:
    """Return the names of displacement and velocity of the reference probe of a lamina."""
    return f"tip_{name}", f"tip_{name}_velocity"


def opposite(parts: Sequence[Part], lower: int, upper: int, *, per_element: int = 1) -> Interface:
    """Pair the opposite points of two parts, except points where both are held or bonded.

    Args:
        parts: all parts of the structure.
        lower: number of the lower part.
        upper: number of the upper part, which has the same number of points.
        per_element: number of pairs per element, at the local coordinates 1/p, 2/p, …, 1; 1: only
            the points.
    """
    free = [part.dofs[:, DISPLACEMENT] >= 0 for part in (parts[lower], parts[upper])]
    is_bonded = parts[lower].dofs[:, DISPLACEMENT] == parts[upper].dofs[:, DISPLACEMENT]
    is_apart = (free[0] | free[1]) & ~is_bonded
    shorter = min(parts[lower].n_points, parts[upper].n_points)
    is_apart[shorter:] = False
    n = shorter - 1
    ends = np.repeat(np.arange(1, n + 1), per_element)
    local = np.tile(np.arange(1, per_element + 1) / per_element, n)
    within = is_apart[ends] | is_apart[ends - 1]  # of elements that are not bonded
    is_kept = np.where(local < 1.0, within, is_apart[ends])
    places = np.concatenate([np.flatnonzero(is_apart[:1]), (ends - 1.0 + local)[is_kept]])
    return Interface(f"{parts[lower].name}-{parts[upper].name}", (lower, upper), places)


def in_order(interfaces: Sequence[Interface]) -> tuple[Interface, ...]:
    """Return interfaces whose pairs follow one another in the gap operator."""
    firsts = accumulate((interface.places.size for interface in interfaces), initial=0)
    return tuple(
        replace(interface, first_pair=n) for interface, n in zip(interfaces, firsts, strict=False)
    )


def interpolation_rows(
    part: Part, places: FloatArray, n_dofs: int, component: int = DISPLACEMENT
) -> sp.csr_matrix:
    """Return rows that evaluate the cubic Hermite interpolant of a part, shape (k, n_dofs).

        u(X) = (1 - 3 X² + 2 X³) u₀ + (X - 2 X² + X³) h φ₀ + (3 X² - 2 X³) u₁ + (X³ - X²) h φ₁

    Points that are held add no entries: the rows give what the free dofs contribute.

    Args:
        part: the part.
        places: numbers of points; 2.25 lies a quarter of the cell behind point 2, shape (k,).
        n_dofs: number of dofs of the structure.
        component: DISPLACEMENT for u, SLOPE for u'.
    """
    return columns_of(part, places, n_dofs, component)[:, :n_dofs]


def interpolation(
    part: Part,
    places: FloatArray,
    component: int = DISPLACEMENT,
    cells: IntArray | None = None,
) -> tuple[IntArray, FloatArray]:
    """Return the cell of each place, and the interpolant's weights of its (u₀, φ₀, u₁, φ₁).

    Args:
        part: the part.
        places: numbers of points; 2.25 lies a quarter of the cell behind point 2, shape (k,).
        component: DISPLACEMENT for u, SLOPE for u', CURVATURE for u''.
        cells: the cells, for places between two; None: those that end there, shape (k,).

    Returns:
        Cells, shape (k,), and weights, shape (k, 4).
    """
    if cells is None:
        cells = np.clip(np.ceil(places).astype(np.int64) - 1, 0, part.n_elements - 1)
    X = places - cells
    h = np.diff(part.x)[cells]
    if np.all(part.dofs[:, SLOPE] == FIXED):  # bars and points: straight between their nodes
        linear = {DISPLACEMENT: (1.0 - X, X), SLOPE: (-1.0 / h, 1.0 / h)}
        ends = linear.get(component, (0.0 * X, 0.0 * X))
        return cells, np.stack([ends[0], 0.0 * X, ends[1], 0.0 * X], axis=1)
    if component == DISPLACEMENT:
        terms = (
            1.0 - 3.0 * X**2 + 2.0 * X**3,
            (X - 2.0 * X**2 + X**3) * h,
            3.0 * X**2 - 2.0 * X**3,
            (X**3 - X**2) * h,
        )
    elif component == CURVATURE:
        bend = (12.0 * X - 6.0) / h**2
        terms = (bend, (6.0 * X - 4.0) / h, -bend, (6.0 * X - 2.0) / h)
    else:
        bend = 6.0 * (X**2 - X) / h
        terms = (bend, 1.0 - 4.0 * X + 3.0 * X**2, -bend, 3.0 * X**2 - 2.0 * X)
    return cells, np.stack(terms, axis=1)


def place_of(part: Part, x: float) -> float:
    """Return a position [m] as a number of points; 2.25 lies a quarter of the cell behind 2."""
    return float(places_of(part, np.array([x]))[0])


def places_of(part: Part, x: FloatArray) -> FloatArray:
    """Return positions [m] as numbers of points; see `place_of`."""
    places = np.interp(x, part.x, np.arange(part.x.size, dtype=np.float64))
    return np.where(np.abs(places - np.round(places)) < _AT_POINT, np.round(places), places)


def point_load(layout: Layout, part: Part, position: float, n_dofs: int) -> FloatArray:
    """Return the loads of a unit force at a point of a part, shape (n_dofs,) [N/N].

    They are the values of the cubic Hermite functions at the point, so that the work of the force
    is the force times the displacement of the point.

    Args:
        layout: of the structure.
        part: the part.
        position: x of the point [m].
        n_dofs: number of free dofs.
    """
    places = places_of(part, np.array([position]))
    row = interpolation_rows(part, places, layout.n_numbered(n_dofs))
    return np.asarray(layout.of_dofs(row).toarray()[0])


def cells_at(part: Part, place: float) -> tuple[int, ...]:
    """Return the cells that contain a place, ends included: one, or two at an inner point."""
    first = max(int(np.ceil(place)) - 1, 0)
    is_between = place == round(place) and 0 < place < part.n_elements
    return (first, first + 1) if is_between else (first,)


def columns_of(
    part: Part,
    places: FloatArray | float,
    n_dofs: int,
    component: int = DISPLACEMENT,
    cell: int | None = None,
) -> sp.csr_matrix:
    """Return rows that evaluate the interpolant of a part from free dofs and base, (k, n + 1).

    Args:
        part: the part.
        places: numbers of points; see `interpolation_rows`, shape (k,), or one.
        n_dofs: n, number of dofs of the structure; column n is the base.
        component: DISPLACEMENT, SLOPE or CURVATURE.
        cell: the cell, for a place between two; None: the one that ends there.
    """
    asked_cells = None if cell is None else np.array([cell])
    at = np.atleast_1d(places)
    cells, weights = interpolation(part, at, component, asked_cells)
    dofs = np.concatenate([part.dofs[cells], part.dofs[cells + 1]], axis=1)  # (k, 4)
    columns = np.where(dofs == BASE, n_dofs, dofs)
    rows = np.repeat(np.arange(at.size)[:, None], 4, axis=1)
    there = (columns >= 0) & (weights != 0.0)
    return sp.csr_matrix(
        (weights[there], (rows[there], columns[there])), shape=(at.size, n_dofs + 1)
    )


def gap_matrix(
    parts: Sequence[Part], interfaces: Sequence[Interface], n_dofs: int
) -> sp.csr_matrix:
    """Return H of all pairs: gap rate = u̇ of the upper point − u̇ of the lower, (n_pairs, n_dofs).

    A point that is held adds no entry to its row: both parts move with the base there.
    """
    blocks = [
        interpolation_rows(parts[interface.parts[1]], interface.places, n_dofs)
        - interpolation_rows(parts[interface.parts[0]], interface.places, n_dofs)
        for interface in sorted(interfaces, key=lambda interface: interface.first_pair)
    ]
    return sp.vstack(blocks, format="csr") if blocks else sp.csr_matrix((0, n_dofs))


def tributary_lengths(parts: Sequence[Part], interface: Interface) -> FloatArray:
    """Return the length of the lower part that belongs to each pair, shape (n_pairs,) [m].

    A length is half of the distances to the next points or pairs on both sides. With these weights,
    springs per length do not depend on the mesh.
    """
    lower = parts[interface.parts[0]]
    pair_places = interface.places
    places = np.unique(np.concatenate([np.arange(lower.x.size, dtype=np.float64), pair_places]))
    return half_ways(lower.positions(places))[np.searchsorted(places, pair_places)]


def half_ways(places: FloatArray) -> FloatArray:
    """Return half of the distances to the neighbours on both sides of increasing places, (n,)."""
    steps = np.pad(np.diff(places), 1)
    return np.asarray(0.5 * steps[:-1] + 0.5 * steps[1:])


def probe_rows(layout: Layout, n_dofs: int) -> sp.csr_matrix:
    """Return the rows that read the displacements of the probes, shape (n_probes, n_dofs)."""
    dofs = [
        layout.parts[p.part].dofs[p.point, DISPLACEMENT]
        if p.place is None
        else layout.number_of(p.place)
        for p in layout.probes
    ]
    return layout.of_dofs(selection(dofs, layout.n_numbered(n_dofs)))


def selection(dofs: Sequence[int] | IntArray, n_dofs: int) -> sp.csr_matrix:
    """Return probe rows that each pick one dof, shape (n_probes, n_dofs)."""
    n = len(dofs)
    return sp.csr_matrix((np.ones(n), np.asarray(dofs), np.arange(n + 1)), shape=(n, n_dofs))


def nodal(layout: Layout, vectors: FloatArray, base: FloatArray) -> FloatArray:
    """Arrange free dofs by part and point, and add the points that are held.

    Args:
        layout: layout of a structure whose parts share their points.
        vectors: values of the free dofs, shape (k, n).
        base: values of the base, shape (k,); the slope of the base is zero.

    Returns:
        Values and slopes at the points, shape (2 components, n_parts, k, n_points). Beyond its end
        a part has the values of its end. Of a solid: those of the middle lines of its parts.
    """
    vectors = layout.read(vectors, base)
    result = np.zeros((2, len(layout.parts), vectors.shape[0], layout.x.size))
    for number, part in enumerate(layout.parts):
        for component, dofs in enumerate(part.dofs.T):
            free = dofs >= 0
            result[component, number][:, free] = vectors[:, dofs[free]]
            result[component, number][:, dofs == BASE] = base[:, None]
        n = part.n_points
        result[:, number, :, n:] = result[:, number, :, n - 1, None]
    return result


def at_stations(layout: Layout, u: FloatArray, phi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return displacements and slopes at the stations: those of the Hermite interpolants.

    Args:
        layout: layout whose parts share their points.
        u: displacements at the points, shape (n_parts, k, n_points) [m].
        phi: slopes at the points, shape (n_parts, k, n_points) [-].

    Returns:
        Displacements and slopes, each of shape (n_parts, k, n_stations).
    """
    part = layout.parts[0]
    places = layout.stations
    if places.size == part.x.size:
        return u, phi
    values = []
    for component in (DISPLACEMENT, SLOPE):
        cells, weights = interpolation(part, places, component)
        ends = np.stack([u[..., cells], phi[..., cells], u[..., cells + 1], phi[..., cells + 1]])
        values.append(np.asarray(np.einsum("e...s,se->...s", ends, weights)))
    return values[0], values[1]


def bending_moment(layout: Layout, u: FloatArray, phi: FloatArray) -> FloatArray:
    """Return the bending moment E I u'' at the stations.

    Within a cell it is linear, or follows E I from end to end. At a point between two cells it is
    the mean of both cells; an end has one cell only.

    Args:
        layout: layout with the points and E I of the cells.
        u: displacements, shape (n_parts, k, n_points) [m].
        phi: slopes, shape (n_parts, k, n_points) [-].

    Returns:
        Moments, shape (n_parts, k, n_stations) [N m].
    """
    part = layout.parts[0]
    places = layout.stations
    EI = np.stack([lamina.flexural_rigidity for lamina in layout.parts])[:, None, :]
    at_ends = np.stack(
        [
            np.repeat(lamina.flexural_rigidity[:, None], 2, axis=1)
            if lamina.end_rigidity is None
            else lamina.end_rigidity
            for lamina in layout.parts
        ]
    )
    is_varying = any(lamina.end_rigidity is not None for lamina in layout.parts)

    def of(cells: IntArray) -> FloatArray:
        # the curvature depends on the difference of both displacements alone
        weights = interpolation(part, places, CURVATURE, cells)[1][:, 1:]
        ends = np.stack([phi[..., cells], np.diff(u)[..., cells], phi[..., cells + 1]])
        curvature = np.einsum("e...s,se->...s", ends, weights)
        if not is_varying:
            return np.asarray(EI[..., cells] * curvature)
        share = places - cells
        local = (1.0 - share) * at_ends[:, cells, 0] + share * at_ends[:, cells, 1]
        return np.asarray(local[:, None, :] * curvature)

    before = np.ceil(places).astype(np.int64) - 1
    behind = np.floor(places).astype(np.int64)
    return 0.5 * (of(np.maximum(before, 0)) + of(np.minimum(behind, part.n_elements - 1)))
