"""Define the command `delam-fem`: read the case, call the package, report, set the exit status.

Commands are built in or those of studies, ours and others'. Each imports heavy modules (dolfinx,
matplotlib) itself, so that the others start fast.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Annotated, Any

import typer

from delam_fem.cli.cases import (
    check_command,
    new_command,
    operators_command,
    reduce_command,
)
from delam_fem.cli.console import (
    with_messages,
)
from delam_fem.cli.ranks import Use
from delam_fem.cli.run import film_command, page_command, run_command
from delam_fem.cli.studies import (
    export_command,
    overlay_command,
    paper_command,
    read_command,
    response_command,
    study_command,
)
from delam_fem.cli.sweep import diagram_command, sweep_command
from delam_fem.plugins.discovery import studies
from delam_fem.system.footprint import USUAL, VARIABLE

HELP = ["-h", "--help"]


def main(
    version: Annotated[bool, typer.Option("--version", help="Show the version and exit.")] = False,
    memory: Annotated[
        float | None,
        typer.Option(
            metavar="GB",
            min=1e-3,
            help="Memory that the content of a file may take, whatever its size (default: "
            f"{USUAL:g}).",
        ),
    ] = None,
) -> None:
    """Simulate delaminated layers that clap under base motion or forces, by finite elements."""
    if version:
        from delam_fem import __version__

        typer.echo(__version__)
        raise typer.Exit()
    if memory is not None:
        os.environ[VARIABLE] = str(memory)  # workers inherit it


BUILT_IN: dict[str, dict[str, Callable[..., None]]] = {
    "Case": {"new": new_command, "check": check_command},
    "Compute": {"run": run_command, "sweep": sweep_command, "reduce": reduce_command},
    "Judge": {"paper": paper_command},
    "Data": {
        "measure read": read_command,
        "measure response": response_command,
        "measure overlay": overlay_command,
    },
    "Output": {
        "show page": page_command,
        "show film": film_command,
        "show diagram": diagram_command,
        "show export": export_command,
        "show operators": operators_command,
    },
}
"""Commands that are no studies, by their words, in the groups of the help."""
USES: dict[str, Use] = {
    "run": "steps",
    "reduce": "factors",
    "show operators": "factors",
    "sweep": "cases",
    "paper": "cases",
}
"""What processes of MPI share of built-in commands, of which others share nothing."""
MEANINGS = {
    "orbit": "periodic orbits, their stability, and branches over a key",
    "measure": "measured data in SI; beside a run",
    "identify": "parameters from measured or simulated motions",
    "detect": "where a delamination is, and how surely",
    "show": "what was computed, for eyes and programs",
}
"""What commands of two words with the same first word are about; of others nothing is said."""


def commands() -> dict[str, dict[str, Callable[..., None]]]:
    """Return all commands by their words, in the groups of the help: ours, and the studies."""
    groups = {group: dict(functions) for group, functions in BUILT_IN.items()}
    for words, study in studies().items():
        groups[study.group].setdefault(words, study_command(study))
    return groups


def use_of(words: str) -> Use:
    """Return what several processes of MPI share of the work of a command."""
    study = studies().get(words)
    if study is not None and study.shares_factors:
        return "factors"
    if study is not None and "workers" in study.options.common:
        return "cases"
    return USES.get(words, "nothing")


def _app() -> typer.Typer:
    """Return the application with all commands."""
    settings: dict[str, Any] = {
        "no_args_is_help": True,
        "context_settings": {"help_option_names": HELP},
    }
    made = typer.Typer(invoke_without_command=True, pretty_exceptions_enable=False, **settings)
    made.callback()(main)
    families: dict[str, typer.Typer] = {}
    for group, functions in commands().items():
        seconds: dict[str, list[str]] = {}
        for name in functions:
            first, _, second = name.partition(" ")
            seconds.setdefault(first, []).append(second)
        for name, function in functions.items():
            first, _, second = name.partition(" ")
            if second and first not in families:
                about = f": {MEANINGS[first]}" if first in MEANINGS else ""
                families[first] = typer.Typer(
                    help=f"{', '.join(seconds[first])}{about}.", **settings
                )
                made.add_typer(families[first], name=first, rich_help_panel=group)
            place, panel = (families[first], None) if second else (made, group)
            command = with_messages(function, name, use_of(name))
            place.command(second or first, rich_help_panel=panel)(command)
    return made


app = _app()

if __name__ == "__main__":
    app()
