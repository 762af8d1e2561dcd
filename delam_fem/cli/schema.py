"""Define the command `delam-fem schema`: the JSON schema of a case file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from delam_fem.cli.console.terminal import reported


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("schema")(schema_command)


def schema_command(
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="Write it here instead."),
    ] = None,
) -> None:
    """Print the JSON schema of a case file, with which editors check and complete it."""
    with reported():
        from delam_fem.case.atomic import write_text
        from delam_fem.case.keys.schema import case_schema

        text = json.dumps(case_schema(), indent=1, ensure_ascii=False) + "\n"
        if output is None:
            typer.echo(text, nl=False)
        else:
            typer.echo(write_text(output, text))
