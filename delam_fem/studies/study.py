"""A study: its result, how that becomes files, and the one way to run it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

import numpy as np
from matplotlib.figure import Figure

from delam_fem.case.definition import Case
from delam_fem.case.files import CaseSource, find_case, save_case
from delam_fem.engines.cost import Cost
from delam_fem.engines.session import Solution
from delam_fem.results.figures.style import styled
from delam_fem.results.folder import RESULT, json_ready, write_dataset
from delam_fem.results.pages import html
from delam_fem.results.schema import provenance
from delam_fem.simulation.checkpoint import of_study
from delam_fem.studies.options import Options
from delam_fem.studies.sweeps.dataset import remove_results
from delam_fem.system.docstrings import summary
from delam_fem.system.errors import CaseError
from delam_fem.system.files import atomic, claimed, write_text

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Table:
    """A table of text.

    Attributes:
        title: title above the table.
        heading: headings of the columns.
        rows: rows with one entry per column.
    """

    title: str
    heading: Sequence[str]
    rows: Sequence[Sequence[str]]

    def markdown(self) -> str:
        """Return the table as Markdown, with its title in bold."""
        lines = [self.heading, ["---"] * len(self.heading), *self.rows]
        body = "\n".join(f"| {' | '.join(line)} |" for line in lines)
        return f"**{self.title}**\n\n{body}\n"


Picture: TypeAlias = "tuple[Callable[[], Figure], str]"
"""Function that draws a picture in the house style, and its caption on a page."""


@dataclass(frozen=True, kw_only=True)
class Report:
    """What a study says of its result, in files and on the terminal.

    Attributes:
        name: of the JSON file, without its suffix.
        numbers: content of the JSON file; what is not finite becomes null there. None: the study
            writes its numbers itself.
        files: names of files in the folder that the study has written itself.
        case: shown on the page and written as case.toml; None: neither.
        is_sweep: whether the folder is that of a sweep, whose own case.toml stays.
        title: of the page; empty: there is no page.
        tables: shown at the end.
        sentences: what the numbers mean.
        remarks: warnings.
        pictures: by the path of the file in the folder, without its suffix.
        left: what is not computed, because the study was interrupted; empty: it is complete.
    """

    name: str
    numbers: Mapping[str, Any] | None
    files: Sequence[str] = ()
    case: Case | None = None
    is_sweep: bool = False
    title: str = ""
    tables: Sequence[Table] = ()
    sentences: Sequence[str] = ()
    remarks: Sequence[str] = ()
    pictures: Mapping[str, Picture] = field(default_factory=dict)
    left: str = ""

    def save(self, directory: Path | str) -> list[Path]:
        """Write the case, the numbers, the pictures and the page; see `Finding.save`."""
        directory = Path(directory)
        directory.mkdir(parents=True, exist_ok=True)
        if self.case is not None and not self.is_sweep:
            save_case(self.case, directory)
        written = [path for name in self.files if (path := directory / name).exists()]
        drawn = []
        if self.numbers is not None:
            text = json.dumps(json_ready(self.numbers), indent=2, allow_nan=False)
            written.append(write_text(directory / f"{self.name}.json", text + "\n"))
        links = [html.Paragraph(html.Link(path.name, path.name)) for path in written]
        for name, (draw, caption) in self.pictures.items():
            path = directory / f"{name}.png"
            path.parent.mkdir(exist_ok=True)
            with styled(), atomic(path) as temporary:
                draw().savefig(temporary)
            written.append(path)
            drawn.append(html.Gallery([html.embedded(path)], caption, caption))
        if self.title:
            text = " ".join([*self.sentences, *self.remarks])
            case = [] if self.case is None else [html.Preformatted(self.case.to_toml())]
            sections = [
                html.Section("", [html.Paragraph(text, "verdict")]),
                html.Section("Figures", drawn),
                *(
                    html.Section(t.title[:1].upper() + t.title[1:], [html.Table(t.heading, t.rows)])
                    for t in self.tables
                ),
                html.Section("Files", links),
                html.Section("Case", case),
            ]
            page = html.page(self.title, [s for s in sections if s.blocks], contents=True)
            written.append(write_text(directory / "report.html", page))
        return written


class Finding:
    """What a study found."""

    @property
    def report(self) -> Report:
        """What it says in files and on the terminal."""
        raise NotImplementedError

    def save(self, directory: Path | str) -> list[Path]:
        """Write the numbers as JSON, the pictures and the page, and return their paths.

        Args:
            directory: made where it is missing.

        Raises:
            OSError: a file cannot be written.
        """
        return self.report.save(directory)


Chosen = TypeVar("Chosen", bound=Options)
Found = TypeVar("Found", bound=Finding)
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Place:
    """Where and how a study computes.

    Attributes:
        folder: of the results, which is there.
        kept: folder for checkpoints, which is removed when the study is complete.
        resume: whether to go on with what is in the folder.
        workers: number of processes; None: one per core.
        progress: called with the numbers of finished and of all runs; None: nobody is told.
    """

    folder: Path
    kept: Path
    resume: bool = False
    workers: int | None = None
    progress: Progress | None = None

    @property
    def sweeping(self) -> dict[str, Any]:
        """Options with which a sweep is computed here."""
        return {"resume": self.resume, "workers": self.workers, "progress": self.progress}


@dataclass(frozen=True)
class Study(Generic[Chosen, Found]):
    """A study of a case.

    Attributes:
        options: class of its options.
        compute: computes what it finds.
        cost: returns what it is called and needs with a number of workers; None: it is cheap.
        remove: removes the results in a folder, so that they are computed anew.
        takes_impactors: whether a case may have impactors.
    """

    options: type[Chosen]
    compute: Callable[[Case, Chosen, Place], Found]
    cost: Callable[[Case, Chosen, int | None], tuple[str, Cost]] | None = None
    remove: Callable[[Path], None] = remove_results
    takes_impactors: bool = False

    @property
    def __doc__(self) -> str:  # type: ignore[override]
        """First line of the docstring of the options."""
        return summary(self.options)

    def __call__(
        self,
        case: CaseSource,
        folder: str | Path | None = None,
        *,
        resume: bool = False,
        overwrite: bool = False,
        workers: int | None = None,
        progress: Progress | None = None,
        **options: Any,
    ) -> Found:
        """Compute the study of a case.

        Args:
            case: the case, its file, or the name of a preset.
            folder: the results are written there, as the command writes them, and what is
                interrupted can be resumed; None: nothing is kept.
            resume: whether to go on with what is in the folder.
            overwrite: whether to replace what is in the folder.
            workers: number of processes; None: one per core.
            progress: called with the numbers of finished and of all runs.
            options: those of `self.options`.

        Raises:
            CaseError: an option, the case or the folder does not allow it.
            KeyboardInterrupt: it was interrupted; `resume` goes on.
        """
        case, chosen = find_case(case), self.options(**options)
        if folder is None:
            self.require_no_blows(case)
            with TemporaryDirectory() as scratch:
                place = Place(Path(scratch), Path(scratch), False, workers, progress)
                return self.compute(case, chosen, place)
        return self.saved(case, chosen, Path(folder), resume, overwrite, workers, progress)[0]

    def saved(
        self,
        case: Case,
        options: Chosen,
        folder: Path,
        resume: bool = False,
        overwrite: bool = False,
        workers: int | None = None,
        progress: Progress | None = None,
    ) -> tuple[Found, list[Path]]:
        """Compute the study in a folder; return what it finds and the files; see `__call__`."""
        self.require_no_blows(case)
        may = resume or overwrite or not options.common
        inputs = [*case.files.values(), *options.inputs]
        with claimed(folder, inputs=inputs, may_hold_results=may) as directory:
            if overwrite:
                self.remove(directory)
            is_kept = "resume" in options.common  # checkpoints of others are not touched
            with of_study(directory, resume=resume) if is_kept else nullcontext(directory) as kept:
                found = self.compute(
                    case, options, Place(directory, kept, resume, workers, progress)
                )
                return found, found.save(directory)

    def require_no_blows(self, case: Case) -> None:
        """Refuse impactors that the study does not know."""
        if case.impactor and not self.takes_impactors:
            name = self.options.__name__.lower()
            raise CaseError(f"impactor: {name}: expected none, given {len(case.impactor)}")


def save(solution: Solution, directory: str | Path, title: str = "Own operators") -> list[Path]:
    """Write result.nc, summary.json, the histories of the probes, and report.html.

    Several ranks have the same solution: let one of them write.

    Args:
        solution: of `solve`, with probes.
        directory: made where it does not exist.
        title: of the page.

    Returns:
        The files written.

    Raises:
        OSError: a file cannot be written.
    """
    directory, data = Path(directory), solution.history.assign_attrs(provenance())
    directory.mkdir(parents=True, exist_ok=True)
    numbers = {
        "outcome": solution.outcome,
        "impacts": int(data.sizes["event"]),
        "energy_residual": float(data.attrs["energy_residual"]),
        "lowest_displacement": data["displacement"].min("time").values.tolist(),
        "highest_displacement": data["displacement"].max("time").values.tolist(),
        "probes": list(solution.names),
    }
    ledger = [
        (str(data[name].attrs["long_name"]), *(f"{v:.6g}" for v in (values[-1], sum(values))))
        for name in data
        if str(name).startswith("energy_") and len(values := data[name].values)
    ]
    report = Report(
        name="summary",
        numbers=numbers,
        files=[RESULT],
        title=title,
        sentences=[
            f"{solution.outcome.capitalize()}, {numbers['impacts']} impacts in the window. The "
            f"energy balance of a period is open by {numbers['energy_residual']:.2g} at most."
        ],
        tables=[Table("energy ledger [J]", ("", "last period", "all periods"), ledger)],
        pictures={"figures/probes": (partial(_histories, data), "Displacements of the probes")},
    )
    return [write_dataset(data, directory / RESULT), *report.save(directory)]


def _histories(data: xr.Dataset) -> Figure:
    """Draw the displacements of the probes over time, and the instants of impacts."""
    figure = Figure()
    axes = figure.subplots()
    for number in range(data.sizes["probe"]):
        row = data["displacement"].isel(probe=number)
        name = str(row["probe"].values) if "probe" in data.coords else f"probe {number + 1}"
        axes.plot(data["time"], 1e3 * row, label=name)
    low, _ = axes.get_ylim()
    axes.plot(data["event_time"], np.full(data.sizes["event"], low), "|", color="k")
    axes.set(xlabel="time [s]", ylabel="displacement [mm]")
    axes.legend()
    return figure
