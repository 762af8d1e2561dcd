"""Define the inputs that commands share: arguments, a case with overrides, a result folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from delam_fem.case.definition import Case

CaseArgument = Annotated[
    str, typer.Argument(metavar="CASE", help="A preset by name, or a case file (.toml).")
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Override a key of the case, e.g. excitation.frequency=3.65; repeatable. "
        "KEY= without a value removes an optional key.",
    ),
]
Folder = Annotated[
    Path | None,
    typer.Option(
        "-o", "--output", metavar="DIR",
        help="Folder of the results (default: runs/NAME, or runs/NAME-COMMAND).",
    ),
]  # fmt: skip
Workers = Annotated[
    int | None,
    typer.Option("-j", "--workers", min=1, metavar="N", help="Processes (default: one per core)."),
]
Resume = Annotated[bool, typer.Option("--resume", help="Continue what was interrupted.")]
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Replace other results in the folder.")
]
Yes = Annotated[
    bool, typer.Option("--yes", help="Compute also what needs many hours or much space.")
]
DryRun = Annotated[
    bool,
    typer.Option(
        "--dry-run", help="Check everything and tell what it needs; compute and write nothing."
    ),
]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Show no progress, no table.")]


def case_of(name: str, overrides: list[str] | None) -> Case:
    """Return the case of a preset or a case file, with the overrides of the command line."""
    from delam_fem.case.files import find_case
    from delam_fem.case.toml import parse_override
    from delam_fem.system.errors import CaseError

    keys = dict(parse_override(text) for text in overrides or [])
    case = find_case(name, keys)
    window, longest = keys.get("output.window_periods"), case.n_periods
    if case.is_periodic and isinstance(window, int) and window > longest:
        raise CaseError(
            f"override output.window_periods: expected at most the {longest} periods of the run, "
            f"given {window}"
        )
    return _told(case)


def _told(case: Case) -> Case:
    """Return a case after a warning for each number that looks like a mistake in a unit."""
    from delam_fem.case.plausible import tell

    tell(case)
    return case


def inputs_of(case: Case) -> list[Path]:
    """Return the files that a case names."""
    return list(case.files.values())


def require_one(**given: object) -> str | None:
    """Return which of some options is given; None if none is.

    Args:
        given: options by name, without `--`.

    Raises:
        CaseError: several are given.
    """
    from delam_fem.system.errors import CaseError

    names = [f"--{name}" for name, value in given.items() if value not in (None, False)]
    if len(names) > 1:
        raise CaseError(f"expected one of {' and '.join(names)}, given both")
    return names[0].removeprefix("--") if names else None
