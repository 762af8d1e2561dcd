"""The result of a run, and the folder it is written to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.case.files import save_case
from delam_fem.model.discretise import has_dolfinx
from delam_fem.results.netcdf import write_dataset
from delam_fem.results.reading import OF_SUMMARY, RESULT, SOLID, SUMMARY, SURFACE, load_numbers
from delam_fem.simulation.checkpoint import final_in
from delam_fem.simulation.loop import State
from delam_fem.system.errors import CaseError
from delam_fem.system.files import (
    digest_of_json,
    discard,
    rewritten,
    write_arrays,
    write_json,
)
from delam_fem.system.written import drop_made_of_result

if TYPE_CHECKING:
    from delam_fem.results.fields.sheets import SheetFrames
    from delam_fem.results.fields.solids import Frames
    from delam_fem.results.figures.run import Plots


@dataclass(frozen=True)
class Result:
    """The result of a run: its dataset, its summary, and the state at its end.

    Attributes:
        case: the case.
        history: all recorded quantities, each with units.
        summary: a few numbers; undefined ones are None.
        state: state at the end, from which another run may start; None if it was not kept.
        checkpoint: file that `save` removes when all results are on the disk; None: no such file.
        final: the arrays of the final state, which `save` keeps so that the run can be extended;
            None: the run cannot be.
        solid: the fields of a solid at the frames; None: laminae are beams, there are no frames, or
            another rank has them.
        plate: the surfaces of a reduced plate at the frames; None: it is none.
    """

    case: Case
    history: xr.Dataset
    summary: dict[str, Any]
    state: State | None
    checkpoint: Path | None = None
    final: Mapping[str, Any] | None = None
    solid: Frames | None = None
    plate: SheetFrames | None = None

    def __repr__(self) -> str:
        """Return what was computed in a line; `summary` and `history` have the numbers."""
        outcome, periods = (self.summary.get(key) for key in ("outcome", "periods"))
        return f"<{type(self).__name__} {self.case.title}: {outcome}, {periods} periods>"

    @property
    def _drawn(self) -> xr.Dataset:
        """The history with the names of variables that figures and pages read."""
        return self.history

    @property
    def plot(self) -> Plots:
        """The figures, as in `result.plot.spectra()`."""
        from delam_fem.results.figures.run import Plots

        return Plots(self._drawn, self.case)

    @cached_property
    def record(self) -> xr.Dataset:
        """The channels: whatever has a history, with quantity, unit and place; see `record`."""
        from delam_fem.results.record import of_run

        return of_run(self._drawn, self.case)

    @cached_property
    def scan(self) -> xr.Dataset:
        """The points of the scan of a plate as channels with x and z; see `record.of_scan`.

        Raises:
            CaseError: the case has no scan.
        """
        from delam_fem.results.record import of_scan

        return of_scan(self._drawn, self.case)

    @property
    def groups(self) -> dict[str, xr.Dataset]:
        """The history in groups, each of which can become a table; see `dataset.grouped`."""
        from delam_fem.results.dataset import grouped

        return grouped(self.history)

    def _repr_html_(self) -> str:
        """Return the result as HTML, which a notebook shows."""
        from delam_fem.results.pages.report import of_result

        return of_result(self._drawn, self.summary, self.case)

    def save(self, directory: str | Path, *, figures: bool = True) -> list[Path]:
        """Write numbers, figures, fields and report to a folder.

        The fields of a solid are numbers: no other file has them. Everything is written under a
        temporary name and renamed when complete. Until all files are there the folder says that it
        is unfinished. The checkpoint of the run is removed last.

        Args:
            directory: folder, which is made where it does not exist.
            figures: whether to write figures, fields and report too, not the numbers alone; those
                of an earlier result are removed then.

        Returns:
            The files and folders written.

        Raises:
            OSError: the folder cannot be written or the disk is full.
        """
        directory = Path(directory)
        with rewritten(directory):
            if not figures:
                remove_views(directory)
            written = self.save_numbers(directory)
            if self.solid is not None:
                from delam_fem.results.fields.solids import write_solid

                written.append(write_solid(self.solid, directory / "fields"))
            elif isinstance(self.case, Case) and not self.case.model.is_continuum:
                discard(directory / "fields" / SOLID)
            if self.plate is not None:
                from delam_fem.results.fields.sheets import write_sheets

                written.append(write_sheets(self.plate, directory / "fields"))
            elif isinstance(self.case, Case):
                discard(directory / "fields" / SURFACE)
            drop_made_of_result(directory)
            if figures:
                written += save_views(self._drawn, self.summary, self.case, directory)
        if self.checkpoint is not None:
            self.checkpoint.unlink(missing_ok=True)
        return written

    def export(self, to: str, path: str | Path) -> list[Path]:
        """Write the result in the format of another program.

        Args:
            to: "csv", "mat", "uff" or "vtkhdf".
            path: the file.

        Returns:
            The files; see `export.export`.

        Raises:
            CaseError: there is no such format, or nothing that it holds.
            OSError: a file cannot be written.
        """
        from delam_fem.results.export import export

        return export(self.history, self.case, to, path)

    def save_groups(self, path: str | Path) -> Path:
        """Write the groups to one NetCDF file: `xarray.open_dataset(path, group="events")`.

        Args:
            path: the file, which replaces an existing one.

        Raises:
            OSError: the file cannot be written or the disk is full.
        """
        return write_dataset(self.groups, Path(path))

    def save_numbers(self, directory: str | Path) -> list[Path]:
        """Write case.toml, result.nc, summary.json and the final state only."""
        directory = Path(directory)
        written = [save_case(self.case, directory)]
        written += self._write_histories(directory)
        if self.final is None:
            discard(final_in(directory))  # of another run
        else:
            written.append(write_arrays(final_in(directory), self.final))
        return written

    def _write_histories(self, directory: Path) -> list[Path]:
        """Write result.nc and summary.json; the former knows the latter by its digest."""
        history = self.history.assign_attrs({OF_SUMMARY: digest_of_json(self.summary)})
        return [
            write_dataset(history, directory / RESULT),
            write_json(directory / SUMMARY, self.summary),
        ]


AS_PROBES = {
    "lamina": "probe", "tip_displacement": "probe_displacement", "tip_velocity": "probe_velocity",
}  # fmt: skip
"""Names in the dataset of operators by the names that figures and numbers know from a case."""


@dataclass(frozen=True)
class ProblemView:
    """What figures and numbers read of a problem, in place of a case.

    Attributes:
        title: the problem in a few words.
        time_step: Δt [s].
        steps_per_period: N.
        n_periods: number of periods to compute.
        is_periodic: whether a period is one of the excitation.
    """

    title: str
    time_step: float
    steps_per_period: int
    n_periods: int
    is_periodic: bool

    @property
    def is_harmonic(self) -> bool:
        """Whether the excitation is one sine."""
        return self.is_periodic

    @property
    def period(self) -> float:
        """Length of a period [s]."""
        return self.time_step * self.steps_per_period


@dataclass(frozen=True, repr=False)
class OperatorsResult(Result):
    """The result of a run of operators, which has no case, and so no fields and no film.

    Each probe takes the place that a lamina has in the result of a case: figures, verdict and
    numbers read its motion. In `history` probes have their names along the dimension `probe`.

    Attributes:
        case: the `ProblemView`, which figures and numbers read in place of a case.
    """

    case: Any

    @property
    def _drawn(self) -> xr.Dataset:
        """The history with the names that its variables have in the result of a case."""
        return self.history.rename({name: old for old, name in AS_PROBES.items()})

    def save_numbers(self, directory: str | Path) -> list[Path]:
        """Write result.nc and summary.json only; several ranks have the same: let one write."""
        return self._write_histories(Path(directory))

    def export(self, to: str, path: str | Path) -> list[Path]:
        """Refuse to export: the formats of other programs are made for laminae."""
        raise CaseError(
            f"export: expected the result of a case, given one of operators; {RESULT} and "
            "history.to_dataframe() have its numbers"
        )


def save_views(
    history: xr.Dataset,
    summary: Mapping[str, Any],
    case: Case,
    directory: Path,
    channels: Sequence[str] = (),
) -> list[Path]:
    """Write figures, fields and report: all files that can be made from the numbers of a run.

    Args:
        history: dataset of a run.
        summary: its numbers.
        case: its case.
        directory: the folder.
        channels: channels of which further figures are drawn.

    Returns:
        The files and folders written.

    Raises:
        OSError: the folder cannot be written or the disk is full.
    """
    from delam_fem.results.fields import pictures
    from delam_fem.results.figures.run import save_figures
    from delam_fem.results.pages.report import write_report

    written = save_figures(history, case, directory / "figures", channels)
    if history.sizes.get("frame", 0) and "node" in history.sizes:
        written += pictures.write_fields(history, case, directory / "fields")
        drawn = [pictures.render(history, case, directory / "figures" / "laminae.png")]
        if has_dolfinx():
            from delam_fem.results.fields import vtx

            drawn.insert(0, vtx.write_lines(history, directory / "fields"))
        solid = directory / "fields" / SOLID
        target = directory / "figures" / "solid.png"
        if solid.is_file():
            from delam_fem.results.fields import animation
            from delam_fem.results.fields.vtkhdf import Series

            if has_dolfinx():
                drawn.append(vtx.write_bodies(Series.read(solid), solid.parent))
            drawn.append(animation.render_solid(solid, history, case, target))
        else:
            discard(target)
        written += [path for path in drawn if path is not None]
    else:
        pictures.remove_fields(directory / "fields")
    return [*written, write_report(history, summary, case, directory)]


def remove_views(directory: Path) -> None:
    """Remove page, figures and fields of a result, which would be taken for those of another."""
    discard(directory / "report.html")
    if (directory / "figures").is_dir():
        from delam_fem.results.figures.run import remove_figures

        remove_figures(directory / "figures")
    if (directory / "fields").is_dir():
        from delam_fem.results.fields.pictures import remove_fields

        remove_fields(directory / "fields")


def load_result(directory: str | Path, *, is_strict: bool = False) -> Result:
    """Read the result of a run from its folder; the state at the end is not kept there.

    Args:
        directory: the folder.
        is_strict: whether to refuse a folder whose case.toml is not the case of the result;
            otherwise that is a warning, also in the summary.

    Raises:
        CaseError: the folder has no result, or an unfinished or damaged one.
    """
    case, history, summary = load_numbers(directory, is_strict=is_strict)
    return Result(case, history, summary, None)
