"""Define what a study is: options, words of its command, what it takes, how it is computed.

A study is light: it names the function that computes it, which is imported when it is called, so
that `delam-fem --help` knows all studies without their modules.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from inspect import signature
from pathlib import Path
from pkgutil import resolve_name
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Generic, Literal, NamedTuple, TypeVar

from delam_fem.plugins.options import Options
from delam_fem.system.docstrings import summary
from delam_fem.system.errors import CaseError

if TYPE_CHECKING:
    from delam_fem.case.definition import Case
    from delam_fem.case.files import CaseSource
    from delam_fem.case.sections import ModelKind
    from delam_fem.engines.cost import Cost
    from delam_fem.plugins.report import Finding

Chosen = TypeVar("Chosen", bound=Options)
Found = TypeVar("Found", bound="Finding")
Progress = Callable[[int, int], None]
Group = Literal["Case", "Compute", "Judge", "Data", "Output"]
"""Groups of commands in the help."""


class Kinds(NamedTuple):
    """Kinds of model that a study takes, and why no others."""

    names: tuple[ModelKind, ...]
    reason: str


@dataclass(frozen=True)
class RunContext:
    """Where and how a study computes.

    Attributes:
        folder: folder of the results, which exists.
        checkpoints: folder for checkpoints, which is removed when the study is complete; without
            checkpoints `folder`.
        resume: whether to go on with what is in the folder.
        workers: number of processes; None: one per core.
        progress: called with the numbers of finished and of all runs; None: nobody is told.
    """

    folder: Path
    checkpoints: Path
    resume: bool = False
    workers: int | None = None
    progress: Progress | None = None

    @property
    def sweeping(self) -> dict[str, Any]:
        """Arguments `resume`, `workers` and `progress` of `run_sweep` and `run_refinement`."""
        return {"resume": self.resume, "workers": self.workers, "progress": self.progress}


@dataclass(frozen=True)
class Study(Generic[Chosen, Found]):
    """A study of a case.

    Functions are named as "module:function", and imported when they are called.

    Attributes:
        options: class of its options, whose docstring is the help of the command.
        compute: function of the case, the options and a `RunContext` that returns the finding.
        group: group of the command in the help.
        words: words of the command, such as "detect scan".
        folder: end of the name of the default folder; empty: the last word of the command.
        cost: function of the case, the options and a number of workers that returns the name and
            the cost of the computation; empty: it is cheap.
        remove: function of a folder that removes what a computation would go on with; empty: there
            is nothing.
        takes: kinds of model that it takes; None: all.
        needs: section that a case must have, such as "delamination"; empty: none.
        takes_impactors: whether a case may have impactors.
        takes_plates: whether a case may be a plate.
        has_checkpoints: whether runs of the study keep checkpoints in `RunContext.checkpoints`.
        shares_factors: whether its command takes processes of MPI, which share the factors of a
            solid.
    """

    options: type[Chosen]
    compute: str
    group: Group
    words: str
    folder: str = ""
    cost: str = ""
    remove: str = ""
    takes: Kinds | None = None
    needs: str = ""
    takes_impactors: bool = False
    takes_plates: bool = True
    has_checkpoints: bool = False
    shares_factors: bool = False

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
        from delam_fem.case.files import find_case

        case = find_case(case)
        known = signature(self.options)
        try:
            known.bind_partial(**options)  # what is unknown is told before what is missing
            known.bind(**options)
        except TypeError as error:
            text = f"{self.name}: {error}; the options are {', '.join(known.parameters)}"
            raise CaseError(text) from None
        chosen = self.options(**options)
        if folder is None:
            self.require_fit(case)
            with TemporaryDirectory() as scratch:
                context = RunContext(Path(scratch), Path(scratch), False, workers, progress)
                return self.computed(case, chosen, context)
        return self.saved(case, chosen, Path(folder), resume, overwrite, workers, progress)[0]

    def computed(self, case: Case, options: Chosen, context: RunContext) -> Found:
        """Return the finding, whatever the case is."""
        finding: Found = resolve_name(self.compute)(case, options, context)
        return finding

    def cost_of(self, case: Case, options: Chosen, workers: int | None) -> tuple[str, Cost] | None:
        """Return the name and the cost of the computation; None: it is cheap."""
        if not self.cost:
            return None
        named: tuple[str, Cost] = resolve_name(self.cost)(case, options, workers)
        return named

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
        from delam_fem.case.identity import identity
        from delam_fem.simulation.checkpoint import of_study
        from delam_fem.system.files import claimed, rewritten

        self.require_fit(case)
        may = resume or overwrite or not options.common
        inputs = [*case.files.values(), *options.inputs]
        with claimed(
            folder, inputs=inputs, may_hold_results=may, is_replacing=overwrite
        ) as directory:
            if overwrite and self.remove:
                resolve_name(self.remove)(directory)
            checkpoints: AbstractContextManager[Path] = nullcontext(directory)
            if self.has_checkpoints:
                question = identity(case, study=self.name, options=options)
                checkpoints = of_study(directory, question, resume=resume)
            with checkpoints as checkpoint_folder:
                context = RunContext(directory, checkpoint_folder, resume, workers, progress)
                finding = self.computed(case, options, context)
                with rewritten(directory):
                    written = finding.save(directory)
                return finding, written

    def require_fit(self, case: Case) -> None:
        """Refuse a case that the study does not take.

        Raises:
            CaseError: the case has another kind of model, impactors, or lacks a section.
        """
        from delam_fem.model.discretise import require_kind

        if case.impactor and not self.takes_impactors:
            raise CaseError(
                f"impactor: {self.name}: expected none, as their blows need not repeat, given "
                f"{len(case.impactor)}"
            )
        if case.is_plate and not self.takes_plates:
            raise CaseError(
                f"mesh.across: {self.name}: expected delaminations over the whole width, which it "
                "looks for along a line, given a plate"
            )
        if self.needs and not getattr(case, self.needs):
            raise CaseError(f"{self.name}: expected a case with [[{self.needs}]], given none")
        if self.takes is not None:
            require_kind(case, self.name, *self.takes)
