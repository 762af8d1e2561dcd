"""A study: what a command computes, and what Python calls under the same name."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Generic, TypeVar

from delam_fem.case.definition import Case
from delam_fem.case.files import CaseSource, find_case
from delam_fem.engines.cost import Cost
from delam_fem.simulation.checkpoint import of_study
from delam_fem.studies.findings import Finding
from delam_fem.studies.options import Options
from delam_fem.studies.sweeps.dataset import remove_results
from delam_fem.system.docstrings import summary
from delam_fem.system.errors import CaseError
from delam_fem.system.files import claimed

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
            self._require_no_blows(case)
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
        self._require_no_blows(case)
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

    def _require_no_blows(self, case: Case) -> None:
        """Refuse impactors that the study does not know."""
        if case.impactor and not self.takes_impactors:
            name = self.options.__name__.lower()
            raise CaseError(f"impactor: {name}: expected none, given {len(case.impactor)}")
