"""Define the command `delam-fem modulate`: two excitations at once."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from delam_fem.cli.console.terminal import reported, say_files
from delam_fem.cli.detection.inspection import Folder, Noise
from delam_fem.cli.inputs import (
    CaseArgument,
    Overrides,
    Overwrite,
    Quiet,
    Resume,
    case_of,
    inputs_of,
)

if TYPE_CHECKING:
    from delam_fem.studies.detection.measurement import Scan
    from delam_fem.studies.detection.modulation import Tones


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("modulate")(modulate_command)


def modulate_command(
    case_name: CaseArgument,
    output: Folder = None,
    overrides: Overrides = None,
    *,
    pump_frequency: Annotated[
        float, typer.Option(metavar="HZ", help="Low frequency beside the excitation's [Hz].")
    ],
    pump_amplitude: Annotated[
        float, typer.Option(metavar="A", min=0.0, help="In the case's own unit: m, m/s2 or N.")
    ],
    spacing: Annotated[float, typer.Option(metavar="M", help="Distance of points in m.")] = 0.01,
    periods: Annotated[int, typer.Option(min=1, help="Common periods of the record.")] = 4,
    noise_db: Noise = 40.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise.")] = 1,
    resume: Resume = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Excite a case at two frequencies, and show the sidebands that its delaminations make."""
    with reported(quiet):
        from delam_fem.case.claim import claimed
        from delam_fem.simulation.checkpoint import of_study
        from delam_fem.studies.detection.measurement import Scan
        from delam_fem.studies.detection.modulation import Tones

        case = case_of(case_name, overrides)
        tones = Tones.of(case, pump_frequency, pump_amplitude)
        scan = Scan(spacing=spacing, periods=periods, noise_db=noise_db, seed=seed)
        where = output or Path("runs") / f"{case.name}-modulate"
        claim = claimed(where, inputs=inputs_of(case), may_hold_results=resume or overwrite)
        with claim as folder, of_study(folder, resume=resume) as kept:
            _modulate(tones, scan, folder, kept=kept, quiet=quiet)


def _modulate(tones: Tones, scan: Scan, directory: Path, *, kept: Path, quiet: bool) -> None:
    """Measure, write the results and show them."""
    from delam_fem.studies.detection.figures import modulation_figure
    from delam_fem.studies.detection.modulation import modulation
    from delam_fem.studies.detection.saving import save_drawings, save_page

    found = modulation(tones, scan, kept=kept)
    figures = save_drawings({"modulation": modulation_figure(found)}, directory / "figures")
    captions = {figures[0]: "Sideband ratio of each point, and what noise alone exceeds."}
    title = f"Modulation of {found.case.name}"
    page = save_page(title, found.verdict, captions, found.case, directory)
    written = [found.save(directory), *figures, page]
    if not quiet:
        typer.echo(found.verdict)
        say_files(written)
