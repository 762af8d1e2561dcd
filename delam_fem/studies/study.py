"""Define what a study is: its options, its result as files and page, and how it is run."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from inspect import signature
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Generic, TypeAlias, TypeVar

from matplotlib.figure import Figure

from delam_fem.api import (
    Case,
    CaseError,
    CaseSource,
    Cost,
    claimed,
    find_case,
    html,
    identity,
    of_study,
    rewritten,
    save_case,
    style,
    summary,
    write_json,
    write_text,
)
from delam_fem.studies.options import Options
from delam_fem.studies.sweeps.dataset import remove_results


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


def number(value: float, form: str = ".4g") -> str:
    """Return a number of a table as text; a dash if it is not finite."""
    return format(value, form) if math.isfinite(value) else "–"


Picture: TypeAlias = "tuple[Callable[[], Figure], str]"
"""Function that draws a picture in the house style, and its caption on a page."""


@dataclass(frozen=True, kw_only=True)
class Report:
    """What a study says of its result, in files and on the terminal.

    Attributes:
        name: name of the JSON file, without its suffix.
        numbers: content of the JSON file; what is not finite becomes null there. None: the study
            writes its numbers itself.
        files: names of files in the folder that the study has written itself.
        case: case that the page shows and case.toml holds; None: neither.
        is_sweep: whether the folder is that of a sweep, whose own case.toml stays.
        title: title of the page; empty: there is no page.
        tables: tables at the end of the page.
        sentences: sentences on what the numbers mean.
        remarks: warnings.
        pictures: pictures by the path of the file in the folder, without its suffix.
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
        if self.case is not None and not self.is_sweep:
            save_case(self.case, directory)
        written = [path for name in self.files if (path := directory / name).exists()]
        drawn = []
        if self.numbers is not None:
            written.append(write_json(directory / f"{self.name}.json", self.numbers))
        links = [html.Paragraph(html.Link(path.name, path.name)) for path in written]
        for name, (draw, caption) in self.pictures.items():
            path = directory / f"{name}.png"
            written.append(style.save_figure(draw, path))
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
    """Result of a study, from which its report is made."""

    @property
    def report(self) -> Report:
        """Report of the finding in files and on the terminal."""
        raise NotImplementedError

    def save(self, directory: Path | str) -> list[Path]:
        """Write the numbers as JSON, the pictures and the page, and return their paths.

        Args:
            directory: folder of the files; it is made where it is missing.

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
        folder: folder of the results, which exists.
        kept: folder for checkpoints, which is removed when the study is complete; without
            checkpoints `folder`.
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
        """Arguments `resume`, `workers` and `progress` of `run_sweep` and `run_ladder`."""
        return {"resume": self.resume, "workers": self.workers, "progress": self.progress}


@dataclass(frozen=True)
class Study(Generic[Chosen, Found]):
    """A study of a case.

    Attributes:
        options: class of its options.
        compute: function that computes the finding.
        cost: function that returns the name and the cost of the computation with a number of
            workers; None: it is cheap.
        remove: function that removes the results in a folder, so that they are computed anew.
        takes_impactors: whether a case may have impactors.
        has_checkpoints: whether runs of the study keep checkpoints in `Place.kept`.
    """

    options: type[Chosen]
    compute: Callable[[Case, Chosen, Place], Found]
    cost: Callable[[Case, Chosen, int | None], tuple[str, Cost]] | None = None
    remove: Callable[[Path], None] = remove_results
    takes_impactors: bool = False
    has_checkpoints: bool = False

    @property
    def __doc__(self) -> str:  # type: ignore[override]
        """First line of the docstring of the options."""
        return summary(self.options)

    @property
    def name(self) -> str:
        """Name of the study in messages."""
        return self.options.__name__.lower()

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
            CaseError: an option, the case or the folder does not fit the study.
            KeyboardInterrupt: the computation was interrupted; `resume` goes on.
        """
        case, known = find_case(case), signature(self.options)
        try:
            known.bind_partial(**options)  # what is unknown is told before what is missing
            known.bind(**options)
        except TypeError as error:
            text = f"{self.name}: {error}; the options are {', '.join(known.parameters)}"
            raise CaseError(text) from None
        chosen = self.options(**options)
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
        """Compute the study in a folder; return the finding and the files; see `__call__`."""
        self.require_no_blows(case)
        may = resume or overwrite or not options.common
        inputs = [*case.files.values(), *options.inputs]
        with claimed(folder, inputs=inputs, may_hold_results=may) as directory:
            if overwrite:
                self.remove(directory)
            checkpoints: AbstractContextManager[Path] = nullcontext(directory)
            if self.has_checkpoints:
                study = identity(case, study=self.name, options=options)
                checkpoints = of_study(directory, study, resume=resume)
            with checkpoints as kept:
                found = self.compute(
                    case, options, Place(directory, kept, resume, workers, progress)
                )
                with rewritten(directory):
                    written = found.save(directory)
                return found, written

    def require_no_blows(self, case: Case) -> None:
        """Raise a CaseError if the case has impactors, and the study takes none."""
        if case.impactor and not self.takes_impactors:
            raise CaseError(f"impactor: {self.name}: expected none, given {len(case.impactor)}")
