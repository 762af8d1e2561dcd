"""What all tests share: no display, one thread, the same random inputs, labelled axes, time."""

import os
import re
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import hypothesis
import pytest
from crew import Crew
from matplotlib.axes import Axes
from matplotlib.figure import Figure

for name, value in {
    "MPLBACKEND": "Agg",
    "OMP_NUM_THREADS": "1",  # small matrices: more threads only wait for each other
    "PYVISTA_OFF_SCREEN": "true",
    "OMPI_MCA_hwloc_base_binding_policy": "none",  # tests side by side would share the first cores
    "OMPI_MCA_mpi_yield_when_idle": "true",
}.items():
    os.environ.setdefault(name, value)

hypothesis.settings.register_profile("fixed", derandomize=True, deadline=None)
hypothesis.settings.load_profile("fixed")

END = pytest.StashKey[float]()
"""Time after which no test begins [s]."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the time box, and what writes stored texts anew."""
    parser.addoption(
        "--minutes", type=float, default=float("inf"), help="skip tests that would begin later"
    )
    parser.addoption("--store", action="store_true", help="write tests/golden/ anew: golden.py")


def pytest_configure(config: pytest.Config) -> None:
    """Begin the time box; give a worker of xdist a folder for temporary files of its own."""
    config.stash[END] = time.monotonic() + 60.0 * config.getoption("minutes")
    if worker := os.environ.get("PYTEST_XDIST_WORKER"):
        folder = tempfile.TemporaryDirectory(prefix=f"delam_fem-{worker}-")
        config.add_cleanup(folder.cleanup)
        os.environ["TMPDIR"] = tempfile.tempdir = folder.name


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test for which there is no time."""
    if time.monotonic() > item.config.stash[END]:
        pytest.skip("the minutes given are over")


@pytest.fixture(scope="session")
def crew() -> Iterator[Crew]:
    """Yield the processes of MPI that run programs of tests."""
    result = Crew()
    yield result
    result.close()


@pytest.fixture(autouse=True)
def every_saved_figure_has_labels(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Let a test fail that saves a figure with an axis that has no label."""
    save, bare = Figure.savefig, []

    def checked(figure: Figure, *given: object, **options: object) -> None:
        bare.extend(axes.get_title("left") or "untitled" for axes in unlabelled(figure))
        save(figure, *given, **options)

    monkeypatch.setattr(Figure, "savefig", checked)
    yield
    assert not bare, f"panels without a label or numbers at the x axis: {bare}"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Stored descriptions are those of one release: others draw with another matplotlib."""
    for item in items:
        if "stored" in getattr(item, "fixturenames", ()):
            item.add_marker("stored")


@pytest.fixture
def stored(request: pytest.FixtureRequest) -> Callable[..., None]:
    """Return a function that compares a text with the one stored for this test and a suffix."""
    import golden  # here: MPI and threads are set up before anything of the package is imported

    folder = request.path.relative_to(Path(__file__).parent).with_suffix("")
    name = re.sub(r"[^\w.-]+", "-", request.node.name.removeprefix("test_")).strip("-")
    store = bool(request.config.getoption("store"))
    place = f"{folder.as_posix()}/{name}"
    return lambda text, suffix="": golden.check(place + suffix, text, store=store)


@pytest.fixture
def pictures(monkeypatch: pytest.MonkeyPatch, stored: Callable[..., None]) -> Iterator[None]:
    """Compare the figures and reports that a test saves with what is stored; of films the first."""
    import golden

    from delam_fem.studies.study import Report

    save, told, films = Figure.savefig, [], set[int]()
    save_report = Report.save

    def kept(figure: Figure, *given: object, **options: object) -> None:
        if not (options.get("format") == "rgba" and id(figure) in films):
            told.append(golden.describe(figure))
        films.add(id(figure))
        save(figure, *given, **options)

    def reported(report: Report, directory: Path | str) -> list[Path]:
        told.append(golden.of_report(report))
        return save_report(report, directory)

    monkeypatch.setattr(Figure, "savefig", kept)
    monkeypatch.setattr(Report, "save", reported)
    yield
    assert told, "nothing was saved"
    stored("\n\n".join(told))


def unlabelled(figure: Figure) -> list[Axes]:
    """Return the panels without a label or numbers below their x axis.

    Colour bars, tables, drawings without axes and second y axes need none.
    """
    panels = (
        axes
        for axes in figure.axes
        if axes.axison and axes.xaxis.get_visible() and axes.get_label() != "<colorbar>"
    )
    return [
        axes
        for axes in panels
        if not axes.get_xlabel() or not axes.xaxis.get_tick_params()["labelbottom"]
    ]


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in an empty folder."""
    monkeypatch.chdir(tmp_path)
