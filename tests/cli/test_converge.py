"""The command `delam-fem converge`: what it writes, says and refuses."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from delam_fem.cli.app import app
from delam_fem.studies.convergence.analysis import NO_LIMIT
from delam_fem.studies.convergence.run import RESULT, load_results


def invoke(*arguments: str | Path) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, ["converge", *(str(argument) for argument in arguments)])
    return result.exit_code, result.stdout, result.output


SMALL = (
    "default",
    "--laws",
    "newton@moreau-jean",
    "-j",
    "1",
    "--periods",
    "2",
    "--limit-steps",
    "1000",
)


@pytest.mark.slow
def test_the_command(tmp_path: Path) -> None:
    sizes = ("--in", "both", "--elements", "5,10", "--steps", "250,500")
    status, out, _ = invoke(*SMALL, *sizes, "-o", tmp_path)
    assert status == 0
    assert "relative errors without contact, 10 elements" in " ".join(out.split())
    assert "y1 min [mm]" in out
    text = (tmp_path / "tables.md").read_text("utf-8")
    said = "No run is known to be within 1 % of the limit of the tip extremes: none that was"
    assert text.startswith(f"# Convergence of case default\n\n{said}")
    assert said in out and out.index(said) > out.index("contact work [mJ]")
    assert len(load_results(tmp_path / RESULT)[0]) == 2 * 2 * 2 + 2
    assert (tmp_path / "figures" / "error_over_cost.png").is_file()
    page = (tmp_path / "report.html").read_text("utf-8")
    assert "10 of 10 runs are there." in page and said in page
    assert page.count("<img") == len(list((tmp_path / "figures").iterdir()))
    assert ">Relative errors without contact, 10 elements</h2>" in page
    status, _, output = invoke(*SMALL, *sizes, "-o", tmp_path)
    assert status == 2
    assert "go on with --resume" in output
    status, _, _ = invoke(*SMALL, *sizes, "-o", tmp_path, "--resume", "-q")
    assert status == 0


def test_a_refinement_of_contact_points(tmp_path: Path) -> None:
    sizes = ("--in", "points", "--points", "1,2,3", "--set", "mesh.elements=5")
    status, _, output = invoke(*SMALL, *sizes, "--steps", "500", "-o", tmp_path)
    assert status == 0, output
    text = (tmp_path / "tables.md").read_text("utf-8")
    heading, _, *rows = text.split("**newton@moreau-jean, 500 steps per period**\n\n")[1].split(
        "\n"
    )
    assert heading.startswith("| points | y1 min")
    assert [row.split("|")[1].strip() for row in rows[:3]] == ["5", "10", "15"]
    assert len({row.split("|")[2] for row in rows[:3]}) == 3
    assert (tmp_path / "figures" / "limit_over_points.png").is_file()


def test_a_refinement_without_a_limit(tmp_path: Path) -> None:
    sizes = ("--steps", "250,500", "--elements", "5,10", "--set", "time.periods=4")
    settings = ("--laws", "newton", "--periods", "4", "--limit-steps", "0", "-j", "1")
    status, out, output = invoke("paper", *sizes, *settings, "-o", tmp_path)
    assert status == 0, output
    assert NO_LIMIT in output
    assert "against the rigid limit" not in out.replace(NO_LIMIT, "")
    text = (tmp_path / "tables.md").read_text("utf-8")
    assert f"\n\n{NO_LIMIT}\n\n**without contact" in text
    headings = [line for line in text.splitlines() if line.startswith("| steps | y1 min")]
    assert len(headings) == 2
    assert all(line.endswith("| P | µs/step | ms/period |") for line in headings)
    drawn = {path.name for path in (tmp_path / "figures").iterdir()}
    assert drawn == {"free_elements.png", "free_steps.png", "work_over_steps.png"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--laws", "coulomb"), "laws: "),
        (("--elements", "20,10", "--in", "elements"), "elements: "),
        (("--elements", "20", "--meshes", "a.msh"), "expected --elements or --meshes, given both"),
        (("--meshes", "a.msh"), "mesh.file: no such file"),
        (
            ("--steps", "ten"),
            "steps: ",
        ),
    ],
)
def test_bad_input_of_the_command(tmp_path: Path, arguments: tuple[str, ...], message: str) -> None:
    status, _, output = invoke("default", *arguments, "-o", tmp_path)
    assert status == 2
    assert message in output
