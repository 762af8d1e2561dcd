"""Define the command `delam-fem`: read the case, call the package, report, set the exit status.

`GROUPS` has all commands. Each command imports heavy modules (dolfinx, matplotlib) itself, so that
the others start fast.
"""

from __future__ import annotations

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

HELP = ["-h", "--help"]


def main(
    version: Annotated[bool, typer.Option("--version", help="Show the version and exit.")] = False,
) -> None:
    """Simulate delaminated layers that clap under base motion or forces, by finite elements."""
    if version:
        from delam_fem import __version__

        typer.echo(__version__)
        raise typer.Exit()


GROUPS: dict[str, dict[str, Callable[..., None]]] = {
    "Case": {"new": new_command, "check": check_command},
    "Compute": {
        "run": run_command,
        "modes": study_command("modes"),
        "sweep": sweep_command,
        "orbit find": study_command("orbit find"),
        "orbit follow": study_command("orbit follow"),
        "reduce": reduce_command,
    },
    "Judge": {
        "converge": study_command("converge"),
        "compare": study_command("compare"),
        "paper": paper_command,
    },
    "Data": {
        "measure read": read_command,
        "measure response": response_command,
        "measure overlay": overlay_command,
        "identify resonance": study_command("identify resonance"),
        "identify keys": study_command("identify keys"),
        "identify natural": study_command("identify natural"),
        "detect scan": study_command("detect scan"),
        "detect excite": study_command("detect excite"),
        "detect pod": study_command("detect pod"),
        "detect infer": study_command("detect infer"),
        "detect modulate": study_command("detect modulate"),
        "detect tap": study_command("detect tap"),
    },
    "Output": {
        "show page": page_command,
        "show film": film_command,
        "show diagram": diagram_command,
        "show export": export_command,
        "show operators": operators_command,
    },
}
"""Commands by their words, in the groups of the help."""
FAMILIES = {
    "orbit": "find, follow: periodic orbits, their stability, and branches over a key.",
    "measure": "read, response, overlay: measured data in SI; beside a run.",
    "identify": "resonance, keys, natural: parameters from measured or simulated motions.",
    "detect": "scan, excite, pod, infer, modulate, tap: where a delamination is, and how surely.",
    "show": "page, film, diagram, export, operators: what was computed, for eyes and programs.",
}
"""What the commands of two words with the same first word do."""


def _app() -> typer.Typer:
    """Return the application with all commands."""
    settings: dict[str, Any] = {
        "no_args_is_help": True,
        "context_settings": {"help_option_names": HELP},
    }
    made = typer.Typer(invoke_without_command=True, pretty_exceptions_enable=False, **settings)
    made.callback()(main)
    families: dict[str, typer.Typer] = {}
    for group, commands in GROUPS.items():
        for name, function in commands.items():
            first, _, second = name.partition(" ")
            if second and first not in families:
                families[first] = typer.Typer(help=FAMILIES[first], **settings)
                made.add_typer(families[first], name=first, rich_help_panel=group)
            place, panel = (families[first], None) if second else (made, group)
            place.command(second or first, rich_help_panel=panel)(with_messages(function))
    return made


app = _app()

if __name__ == "__main__":
    app()
