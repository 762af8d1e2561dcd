"""Define the command `delam-fem paper`: reproduce every figure, number and claim of the paper."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from delam_fem.cli.console import FAILED, fail, reported, say_files, table
from delam_fem.cli.inputs import Quiet, Workers

Figures = Annotated[
    list[str] | None,
    typer.Argument(metavar="[FIG]…", help="Figures: 1, 2a, 2b, 3, … 15, gamma (default: all)."),
]
Folder = Annotated[
    Path, typer.Option("-o", "--output", metavar="DIR", help="Folder of the results.")
]


def paper_command(
    figures: Figures = None,
    output: Folder = Path("runs/paper"),
    *,
    fast: Annotated[
        bool,
        typer.Option("--fast", help="Coarser planes and responses; histories stay the same."),
    ] = False,
    workers: Workers = None,
    engine: Annotated[
        Literal["petsc", "compiled"], typer.Option(help="Engine that computes the steps.")
    ] = "compiled",
    quiet: Quiet = False,
) -> None:
    """Reproduce the paper: figures, numbers, and its claims beside the computed results."""
    with reported(quiet):
        from delam_fem.paper.lab import FAST, FULL, laboratory
        from delam_fem.paper.reproduce import (
            FIGURES,
            chosen,
            claims_of,
            entries,
            file_stem,
            reproduce,
            tally,
            write_page,
        )
        from delam_fem.system.files import claimed

        names = chosen(figures or [])
        try:
            with (
                claimed(output, may_hold_results=True),
                laboratory(FAST if fast else FULL, workers=workers, engine=engine) as lab,
            ):
                paths = reproduce(lab, output, names)
        except (RuntimeError, ArithmeticError) as error:
            fail(str(error), FAILED)
        found = entries(output, [file_stem(name) for name in FIGURES])
        paths.append(write_page(output, found))
        if not quiet:
            claims = claims_of(figure for figure in found if figure["name"] in names)
            rows = [(c.figure, c.text, c.measured, c.verdict) for c in claims]
            table(tally(claims), ("figure", "the paper says", "what came out", "verdict"), rows)
            say_files(paths)
