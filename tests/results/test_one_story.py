"""A folder tells one story: the case of a result is its own, and what is half replaced says so."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

import delam_fem as df
from delam_fem.api import load_numbers, write_dataset
from delam_fem.cli.app import app
from delam_fem.results import folder as folders
from delam_fem.results.netcdf import read_dataset
from delam_fem.system.files import UNFINISHED

SHORT = {
    "mesh.elements": 3, "time.steps_per_period": 40, "time.periods": 4, "excitation.frequency": 3.3,
    "output.window_periods": 2, "output.fields_per_period": 4, "contact.impulse": "consistent",
}  # fmt: skip
TABLE = "x [m],gap [m]\n0,0\n0.3,0.004\n0.685,0.012\n"


@pytest.fixture(scope="module")
def computed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a run whose gap is a table."""
    root = tmp_path_factory.mktemp("story")
    (root / "gap.csv").write_text(TABLE)
    case = df.preset("paper", {**SHORT, "gap.file": str(root / "gap.csv")})
    df.run(case, directory=root / "run").save(root / "run", figures=False)
    return root


@pytest.fixture
def run(computed: Path, tmp_path: Path) -> Path:
    """Return a copy of the folder of the run."""
    return Path(shutil.copytree(computed / "run", tmp_path / "run"))


def edit(path: Path, old: str, new: str) -> None:
    """Replace a text in a file."""
    text = path.read_text("utf-8")
    assert old in text
    path.write_text(text.replace(old, new), "utf-8")


def invoke(*words: object) -> tuple[int, str]:
    """Call the command; return its status and what it said."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    return result.exit_code, " ".join(result.output.split())


def test_the_case_of_a_result_is_its_own(run: Path) -> None:
    before = df.load_result(run)
    assert before.case.files == {"gap.file": run / "gap.csv"}
    edit(run / "case.toml", "frequency = 3.3", "frequency = 4.75")
    loaded = df.load_result(run)
    assert loaded.case == before.case
    told, *others = loaded.summary["warnings"]
    assert others == before.summary["warnings"]
    assert "excitation.frequency" in told and "3.3 there, 4.75 here" in told


@pytest.mark.slow
def test_a_page_has_a_line_on_it_and_exports_and_overlays_are_refused(
    run: Path, tmp_path: Path
) -> None:
    edit(run / "case.toml", "frequency = 3.3", "frequency = 4.75")
    status, said = invoke("show", "page", run)
    assert status == 0 and "excitation.frequency: 3.3 there, 4.75 here" in said
    page = (run / "report.html").read_text("utf-8")
    assert "excitation.frequency: 3.3 there, 4.75 here" in page
    assert "<title>paper: 3.3 Hz" in page and "4.75 Hz" not in page
    (tmp_path / "measured.csv").write_text(
        "time [s],tip thick [mm]\n" + "".join(f"{0.01 * k},{k % 7}\n" for k in range(200))
    )
    for words in (
        ("show", "export", run, "--to", "csv"),
        ("measure", "overlay", tmp_path / "measured.csv", run),
    ):
        status, said = invoke(*words)
        assert status == 2 and "excitation.frequency: 3.3 there, 4.75 here" in said
    assert not (run / "export").exists() and not (run / "overlay").exists()


def test_a_table_that_was_edited_is_not_taken_for_that_of_the_result(
    computed: Path, run: Path
) -> None:
    edit(run / "gap.csv", "0.012", "0.002")
    case, _, summary = load_numbers(run)
    assert case.files == {"gap.file": computed / "gap.csv"}  # where it was computed from
    assert "gap.file: the file has another content" in summary["warnings"][0]
    original = (computed / "gap.csv").read_text()
    (computed / "gap.csv").unlink()
    try:
        with pytest.raises(df.CaseError, match=r"gap\.file: .*put it back"):
            load_numbers(run)
    finally:
        (computed / "gap.csv").write_text(original)


def test_a_summary_that_was_changed_or_is_of_another_result_is_refused(
    computed: Path, run: Path
) -> None:
    summary = run / "summary.json"
    original = summary.read_text("utf-8")
    edit(summary, '"outcome": "completed"', '"outcome": "diverged"')
    with pytest.raises(df.CaseError, match=r"was changed .* or is of another result"):
        load_numbers(run)
    other = df.run(df.load_case(run / "case.toml", {"excitation.frequency": 4.75}))
    other.save(computed / "other", figures=False)
    shutil.copy(computed / "other" / "summary.json", summary)
    status, said = invoke("show", "page", run)
    assert status == 2 and "is of another result than result.nc beside it" in said
    summary.unlink()
    assert load_numbers(run)[2] == {}
    summary.write_text(original, "utf-8")
    _, history, numbers = load_numbers(run)
    assert numbers["outcome"] == "completed"
    assert "summary_digest" not in history.attrs


@pytest.mark.parametrize(
    "identity", ["", "[]", "3", "{}", '{"case": 3}', '{"case": "a = 1"}', "[" * 5000]
)
@pytest.mark.parametrize("is_beside", [pytest.param(True, marks=pytest.mark.slow), False])
def test_a_result_that_does_not_say_of_what_it_is_is_refused(
    run: Path, identity: str, is_beside: bool
) -> None:
    data = read_dataset(run / "result.nc")
    write_dataset(data.assign_attrs(identity=identity), run / "result.nc")
    if not is_beside:
        (run / "case.toml").unlink()
    with pytest.raises(df.CaseError, match=r"result\.nc: damaged, or .*of what case it is"):
        load_numbers(run)


@pytest.mark.slow
@pytest.mark.parametrize("fails", ["write_dataset", "write_json", "save_views"])
def test_a_folder_that_is_half_replaced_says_that_it_is_unfinished(
    fails: str, run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = df.run(df.load_case(run / "case.toml", {"excitation.frequency": 4.75}))

    def killed(*arguments: object, **options: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(folders, fails, killed)
        other.save(run)
    assert (run / UNFINISHED).exists()
    for words in (
        ("show", "page", run), ("show", "export", run, "--to", "csv"), ("show", "film", run),
    ):  # fmt: skip
        status, said = invoke(*words)
        assert status == 2 and "not finished" in said
    other.save(run)
    assert not (run / UNFINISHED).exists()
    assert df.load_result(run).case.excitation.top_frequency == 4.75


def test_an_extension_changes_nothing_before_it_ends(run: Path) -> None:
    """Only its checkpoint is new, which says that the folder is not finished."""
    case = df.load_case(run / "case.toml")
    before = {path.name: path.read_bytes() for path in run.iterdir()}

    def killed(done: int, total: int) -> None:
        raise MemoryError

    with pytest.raises(MemoryError):
        df.run(case, directory=run, extend=20, progress=killed)
    after = {path.name: path.read_bytes() for path in run.iterdir()}
    assert after.pop("checkpoint.npz") and after == before
    status, said = invoke("run", run / "case.toml", "-o", run, "--resume", "--no-figures")
    assert status == 2 and "time.periods: 24 there, 4 here" in said
    status, said = invoke(
        "run", run / "case.toml", "-o", run, "--resume", "--no-figures", "--set", "time.periods=24"
    )
    assert status == 0, said
    extended = df.load_result(run)
    complete_run = df.run(case.with_overrides({"time.periods": 24}))
    assert extended.history.drop_attrs().equals(complete_run.history.drop_attrs())
    assert df.load_case(run / "case.toml").time.periods == 24


def test_numbers_alone_leave_no_page_and_no_figure_of_another_run(run: Path) -> None:
    status, said = invoke("show", "page", run)
    assert status == 0, said
    assert (run / "report.html").is_file() and list((run / "figures").iterdir())
    mine = run / "figures" / "mine.png"
    mine.touch()
    other = df.run(df.load_case(run / "case.toml", {"excitation.frequency": 4.75}))
    other.save(run, figures=False)
    assert not (run / "report.html").exists()
    assert list((run / "figures").iterdir()) == [mine]
    assert not list((run / "fields").iterdir())
