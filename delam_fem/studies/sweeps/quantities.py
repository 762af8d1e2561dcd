"""Every variable of a sweep's dataset, once, and the choice of those that a sweep keeps.

Dimensions here are those beside the grid of the sweep. The coordinates of the axes have the names
that the file of the sweep gives them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from delam_fem.model.layout import Layout, SensorRows
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.scan import scan_positions
from delam_fem.results.schema import SENSOR, Variable
from delam_fem.simulation.recorder import LEDGER
from delam_fem.studies.detection.shapes import ORDERS
from delam_fem.studies.sweeps.file import Record, ScanRecord

ENERGIES = tuple(name for name in LEDGER if name != "residual")
"""Columns of the ledger that a sweep keeps."""
_STORED = ("kinetic", "strain", "spring")
_LAMINA = ("lamina",)
_LAST = "of the tip at the end of the last periods"

_SUMMARY = (
    Variable("tip_min", _LAMINA, "m", "smallest tip displacement"),
    Variable("tip_max", _LAMINA, "m", "largest tip displacement"),
    Variable("tip_amplitude", _LAMINA, "m", "half peak-to-peak tip displacement"),
    Variable("periodicity", (), "1", "periods of the excitation after which the motion repeats"),
    Variable("settled", (), "1", "1 settled, 0 not settled, -1 irregular; NaN without a period"),
    Variable("transient", (), "1", "what is left of the transient, in half peak-to-peak"),
    Variable("periods_computed", (), "1", "periods that the run of the point took"),
    Variable("strobe_scatter", (), "1", "scatter of strobes for that periodicity, relative"),
    Variable("is_decided", (), "1", "whether the periodicity has a margin to the threshold"),
    Variable("tip_contacts_per_period", (), "1", "contacts of the tips per period"),
    Variable("impacts_per_period", (), "1", "impulses on pairs per period"),
    Variable("distortion_factor", _LAMINA, "1", "distortion factor d of the tip"),
    Variable("thd", _LAMINA, "1", "total harmonic distortion of the tip"),
    Variable("minimum_tip_gap", (), "m", "smallest gap at the tip"),
    Variable("energy_residual", (), "1", "largest residual of the energy ledger, relative"),
)
_STROBES = (
    Variable("strobe_displacement", ("lamina", "strobe"), "m", f"displacement {_LAST}"),
    Variable("strobe_velocity", ("lamina", "strobe"), "m/s", f"velocity {_LAST}"),
)
_HARMONICS = (
    Variable(
        "harmonic_amplitude",
        ("lamina", "harmonic"),
        "m",
        "amplitude of the harmonics of the tip displacement",
    ),
    Variable(
        "harmonic_phase",
        ("lamina", "harmonic"),
        "rad",
        "phase φ of the harmonics A sin(k ω t + φ), where the base moves as sin ω t",
    ),
)
_NODES = (
    Variable("node_distortion_factor", ("lamina", "node"), "1", "distortion factor d at the nodes"),
    Variable("node_thd", ("lamina", "node"), "1", "total harmonic distortion at the nodes"),
)
_ENERGIES = tuple(
    Variable(
        f"energy_{name}",
        (),
        "J",
        f"{name.replace('_', ' ')} energy "
        f"{'at the end of periods' if name in _STORED else 'per period'}, mean over the window",
    )
    for name in ENERGIES
)
_SCAN = (
    Variable("scan_real", ("order", "scan_point"), "m/s", "velocity shape, real part"),
    Variable("scan_imag", ("order", "scan_point"), "m/s", "velocity shape, imaginary part"),
    Variable("scan_rms", (), "m/s", "root mean square of the velocity over times and points"),
    Variable("scan_between", ("scan_point",), "m/s", "mean velocity amplitude between harmonics"),
)
_LYAPUNOV = (
    Variable("lyapunov_exponent", (), "1/s", "largest Lyapunov exponent"),
    Variable("lyapunov_error", (), "1/s", "standard error of the largest Lyapunov exponent"),
)
_OF_POINTS = (
    Variable("outcome", (), "", "how the run of the point ended"),
    Variable("error", (), "", "why a point was not completed"),
)
_COORDINATES = (
    Variable("direction", ("direction",), "", "order of the points"),
    Variable("lamina", ("lamina",), "", "lamina"),
    Variable("strobe", ("strobe",), "1", "period, counted from the end"),
    Variable("harmonic", ("harmonic",), "1", "number of the harmonic"),
    Variable("x", ("node",), "m", "position along the laminae"),
    Variable("order", ("order",), "1", "multiple of the excitation's frequency"),
    Variable("scan_x", ("scan_point",), "m", "position of the points of a scan"),
)
VARIABLES: Mapping[str, Variable] = MappingProxyType(
    {
        row.name: row
        for group in (
            _SUMMARY, _STROBES, _HARMONICS, _NODES, _ENERGIES, _SCAN, _LYAPUNOV, _OF_POINTS,
            _COORDINATES,
        )
        for row in group
    }
)  # fmt: skip
"""All variables by name; words have no unit."""


def of_sensor(sensor: SensorRows, n_harmonics: int) -> list[Variable]:
    """Return what a sweep keeps of a sensor: extremes, rms, and harmonics if it keeps these."""
    name, unit = f"{SENSOR}{sensor.name}", sensor.unit
    rows = [
        Variable(f"{name}_min", (), unit, f"smallest {sensor.words}"),
        Variable(f"{name}_max", (), unit, f"largest {sensor.words}"),
        Variable(f"{name}_rms", (), unit, f"root mean square of the {sensor.words}"),
    ]
    if n_harmonics:
        words = f"amplitude of the harmonics of the {sensor.words}"
        rows.append(Variable(f"{name}_harmonics", ("harmonic",), unit, words))
    return rows


@dataclass(frozen=True)
class Quantity:
    """Numbers that a sweep keeps of each point.

    Attributes:
        variable: of the dataset.
        shape: sizes of its dimensions beside those of the grid.
        scan: the points of the scan, if the sweep records one.
    """

    variable: Variable
    shape: tuple[int, ...]
    scan: ScanRecord | None = None

    @property
    def name(self) -> str:
        """Name of the variable."""
        return self.variable.name

    @property
    def dims(self) -> tuple[str, ...]:
        """Dimensions of the variable beside those of the grid."""
        return self.variable.dims

    @property
    def size(self) -> int:
        """Number of values per point."""
        return math.prod(self.shape)


def scanned(scan: ScanRecord, layout: Layout) -> FloatArray:
    """Return the positions of the points of a scan, shape (n,) [m]."""
    return scan_positions(float(layout.x[-1]), scan.spacing, scan.first)


def quantities(record: Record, layout: Layout) -> tuple[Quantity, ...]:
    """Return the numbers that a sweep keeps of each point, in the order of its row.

    Args:
        record: the wishes in the file of the sweep.
        layout: of the structure.
    """
    sizes = {
        "lamina": len(layout.parts),
        "strobe": record.strobes,
        "harmonic": record.harmonics,
        "node": layout.x.size,
        "order": len(ORDERS),
        "scan_point": 0 if record.scan is None else scanned(record.scan, layout).size,
    }
    signals = [row for own in layout.sensors for row in of_sensor(own, record.harmonics)]
    groups: tuple[tuple[bool | int, Sequence[Variable]], ...] = (
        (record.summary, _SUMMARY),
        (record.strobes, _STROBES),
        (record.harmonics, _HARMONICS),
        (record.node_distortion, _NODES),
        (record.energies, _ENERGIES),
        (record.scan is not None, _SCAN),
        (record.lyapunov, _LYAPUNOV),
        (record.summary, signals),
    )
    return tuple(
        Quantity(row, tuple(sizes[dim] for dim in row.dims), record.scan)
        for is_wanted, rows in groups
        if is_wanted
        for row in rows
    )
