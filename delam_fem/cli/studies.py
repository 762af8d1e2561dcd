"""Make a command of each study: its options, its folder, its progress, what it says."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable
from dataclasses import MISSING
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

from delam_fem.cli.console import INTERRUPTED, error_console, fail, reported, say_files, table, tell
from delam_fem.cli.inputs import (
    CaseArgument,
    DryRun,
    Folder,
    Overrides,
    Overwrite,
    Quiet,
    Resume,
    Workers,
    Yes,
    case_of,
)
from delam_fem.studies import options as studies
from delam_fem.studies.options import Flag, Options, flags_of
from delam_fem.system.docstrings import meanings, summary


class Entry(NamedTuple):
    """A command that computes a study.

    Attributes:
        options: class of its options.
        home: module that has the study as `STUDY`.
        suffix: of the default folder; empty: the last word of the command.
    """

    options: type[Options]
    home: str
    suffix: str = ""


STUDIES = {
    "modes": Entry(studies.Modes, "studies.modes"),
    "compare": Entry(studies.Compare, "reference.compare"),
    "orbit find": Entry(studies.Orbit, "studies.orbits.run", "orbit"),
    "orbit follow": Entry(studies.Continue, "studies.branches.follow", "branch"),
    "converge": Entry(studies.Converge, "studies.convergence.run"),
    "detect scan": Entry(studies.Detect, "studies.detection.detect", "detect"),
    "detect excite": Entry(studies.Excite, "studies.detection.excitation"),
    "detect pod": Entry(studies.Pod, "studies.detection.pod"),
    "detect infer": Entry(studies.Infer, "studies.detection.infer"),
    "identify resonance": Entry(studies.Resonance, "studies.identification.resonance"),
    "identify keys": Entry(studies.Identify, "studies.identification.identify", "identification"),
    "detect modulate": Entry(studies.Modulate, "studies.detection.modulation"),
}
"""Commands by their words."""
_UNIT = re.compile(r"\[([^\]]+)\]")
COMMON: dict[str, tuple[Any, Any]] = {
    "workers": (Workers, None),
    "resume": (Resume, False),
    "overwrite": (Overwrite, False),
    "dry_run": (DryRun, False),
    "yes": (Yes, False),
}
"""Options of several commands: type and default."""


def study_command(name: str) -> Callable[..., None]:
    """Return the command of a study, whose parameters are the options of the study."""
    kind, home, suffix = STUDIES[name]
    helps = meanings(kind)

    def called(
        case_name: str, output: Path | None, overrides: list[str] | None, *, quiet: bool,
        **given: Any,
    ) -> None:  # fmt: skip
        with reported(quiet):
            from delam_fem.cli.progress import progress
            from delam_fem.engines.cost import require_affordable
            from delam_fem.model.beams.network import never_opens

            case = case_of(case_name, overrides)
            study = import_module(f"delam_fem.{home}").STUDY
            common = {key: given.pop(key) for key in kind.common}
            own = kind(**{key: value for key, value in given.items() if value is not None})
            folder = output or Path("runs") / f"{case.name}-{suffix or name.split()[-1]}"
            is_dry, is_confirmed = common.pop("dry_run", False), common.pop("yes", False)
            if study.cost is not None:
                what, cost = study.cost(case, own, common["workers"])
                require_affordable(cost, what, is_confirmed=is_confirmed, folder=folder)
                if is_dry:
                    table(f"{what}, case {case.name}", ("", ""), [("needs", str(cost))])
                    return
            with progress(error_console(quiet or "workers" not in common)) as report:
                found, written = study.saved(case, own, folder, **common, progress=report)
            said = found.report
            for text in filter(None, [never_opens(case), *said.remarks]):
                tell(f"warning: {text}")
            if not quiet:
                for each in said.tables:
                    table(each.title, each.heading, each.rows)
                for text in said.sentences:
                    typer.echo(text)
                say_files(written)
            if said.left:
                fail(f"interrupted {said.left}; --resume goes on", INTERRUPTED)

    parameters = {
        "case_name": (CaseArgument, inspect.Parameter.empty),
        "output": (Folder, None),
        "overrides": (Overrides, None),
        **{key: _parameter(kind, key, flag, helps[key]) for key, flag in flags_of(kind).items()},
        **{key: COMMON[key] for key in kind.common},
        "quiet": (Quiet, False),
    }
    called.__doc__ = summary(kind)
    called.__annotations__ = {key: hint for key, (hint, _) in parameters.items()}
    called.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [
            inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hint)
            for key, (hint, default) in parameters.items()
        ]
    )
    return called


def _parameter(kind: type[Options], name: str, flag: Flag, text: str) -> tuple[Any, Any]:
    """Return type and default of an option as typer takes them."""
    hint, default = flag.kind, kind.__dataclass_fields__[name].default
    if flag.is_several:
        hint = str if flag.is_joined else list[flag.kind]  # type: ignore[name-defined]
    if isinstance(default, tuple):
        words = [f"{own:g}" if flag.kind is float else str(own) for own in default]
        default = ",".join(words) if flag.is_joined else words
    unit = _UNIT.search(text)
    text = f"{text[0].upper()}{text[1:]}".replace("[", r"\[")  # units are no markup
    empty = inspect.Parameter.empty
    default = empty if default is MISSING else default
    if flag.is_argument:
        return Annotated[hint, typer.Argument(metavar=flag.metavar, help=text)], default
    own = typer.Option(
        *(flag.names or [f"--{name.replace('_', '-')}"]),
        metavar=flag.metavar or (unit and unit[1].upper() + ",…" * flag.is_joined),
        min=flag.least if math.isfinite(flag.least) else None,
        max=flag.most if math.isfinite(flag.most) else None,
        help=text,
    )
    return Annotated[hint | None, own], default
