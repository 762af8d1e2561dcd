"""Define `delam-fem resonance` and `delam-fem identify`: what a measurement says of the rig."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from delam_fem.cli.console.messages import tell
from delam_fem.cli.console.terminal import reported, say_files, table
from delam_fem.cli.inputs import (
    CaseArgument,
    Overrides,
    Overwrite,
    Quiet,
    Resume,
    Uncertain,
    Workers,
    case_of,
    inputs_of,
)

if TYPE_CHECKING:
    from delam_fem.studies.identification.contact import Experiment
    from delam_fem.studies.identification.study import Identification

Folder = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="DIR", help="Folder of the results."),
]
Noise = Annotated[
    float,
    typer.Option(metavar="M", min=0.0, help="Standard deviation of a sample in m."),
]
Unknowns = Annotated[
    list[str], typer.Option(metavar="KEY=LOW:HIGH", help="A key that is sought; repeatable.")
]
Frequencies = Annotated[
    list[float], typer.Option(metavar="HZ", help="Frequency of a motion; repeatable.")
]
Files = Annotated[
    list[Path] | None,
    typer.Option(
        metavar="FILE",
        help="Tips of a motion, one file per frequency; default: the case simulates them.",
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="Seed of the noise and of the prior.")]


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    app.command("resonance")(resonance_command)
    app.command("identify")(identify_command)


def resonance_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    measured: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Tips in a swept sine; default: the case simulates it."),
    ] = None,
    noise: Noise = 0.0,
    seed: Seed = 1,
    resume: Resume = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Identify frequency, damping and EI of each lamina from the swept sine of a case."""
    with reported(quiet):
        from delam_fem.case.claim import claimed
        from delam_fem.simulation.checkpoint import of_study
        from delam_fem.studies.identification.swept_sine import HEADING, identified

        case = case_of(case_name, overrides)
        folder = output or Path("runs") / f"{case.name}-resonance"
        inputs = [*inputs_of(case), *filter(None, [measured])]
        claim = claimed(folder, inputs=inputs, may_hold_results=resume or overwrite)
        with claim as directory, of_study(directory, resume=resume) as kept:
            found = identified(case, measured, noise=noise, seed=seed, kept=kept)
            written = found.save(directory)
        if not quiet:
            table(f"resonances of case {case.name}", HEADING, found.rows())
            for text in found.remarks():
                tell(text)
            say_files(written)


def identify_command(
    case_name: CaseArgument,
    unknown: Unknowns,
    frequency: Frequencies,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    measured: Files = None,
    noise: Noise = 1e-4,
    uncertain: Uncertain = None,
    simulations: Annotated[int, typer.Option(min=100, help="Number of simulations.")] = 2000,
    calibrate: Annotated[
        int, typer.Option(min=0, help="Number of simulations that check the intervals.")
    ] = 100,
    seed: Seed = 1,
    workers: Workers = None,
    resume: Resume = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Identify keys of a case from clapping motions, as a joint posterior."""
    with reported(quiet):
        from delam_fem.case.claim import claimed
        from delam_fem.studies.identification.contact import Experiment
        from delam_fem.studies.identification.study import HEADING
        from delam_fem.studies.unknown import Unknown

        case, unknowns = case_of(case_name, overrides), map(Unknown.parse, unknown)
        doubts = None if uncertain is None else tuple(map(Unknown.parse, uncertain))
        experiment = Experiment(case, tuple(frequency), tuple(unknowns), noise, uncertain=doubts)
        folder = output or Path("runs") / f"{case.name}-identification"
        inputs = [*inputs_of(case), *(measured or [])]
        claim = claimed(folder, inputs=inputs, may_hold_results=resume or overwrite)
        with claim as directory:
            found = _identified(
                experiment, measured, directory, (simulations, calibrate, seed), workers, quiet
            )
            written = found.save(directory)
        if not quiet:
            table(f"identification of case {case.name}", HEADING, found.rows())
            typer.echo(found.sentence())
            say_files(written)


def _identified(
    experiment: Experiment,
    measured: list[Path] | None,
    directory: Path,
    numbers: tuple[int, int, int],
    workers: int | None,
    quiet: bool,
) -> Identification:
    """Identify, with a bar of progress; `numbers` are simulations, checks and the seed."""
    from rich.console import Console

    from delam_fem.cli.console.progress import progress
    from delam_fem.studies.identification.study import identify

    simulations, checks, seed = numbers
    with progress(Console(stderr=True, quiet=quiet)) as report:
        return identify(
            experiment,
            directory,
            measured=measured,
            simulations=simulations,
            checks=checks,
            seed=seed,
            workers=workers,
            progress=report,
        )
