"""What all tests share: no display, one thread, the same random inputs, labelled axes, time.

Nothing that loads NumPy is imported at the top: its BLAS reads the number of threads once.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import hypothesis
import pytest
from mpi_pool import Crew

if TYPE_CHECKING:
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
    from matplotlib.figure import Figure

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
def stored(request: pytest.FixtureRequest) -> Callable[[str], None]:
    """Return a function that compares a text with the one stored for this test."""
    import golden  # here: MPI and threads are set up before anything of the package is imported

    module = request.path.relative_to(golden.TESTS).as_posix()
    path = golden.place(f"{module}::{request.node.name}")
    store = bool(request.config.getoption("store"))
    return lambda text: golden.check(path, text, store=store)


@pytest.fixture
def pictures(monkeypatch: pytest.MonkeyPatch, stored: Callable[[str], None]) -> Iterator[None]:
    """Compare the words of the figures that a test saves; of films those of the first frame."""
    import golden
    from matplotlib.figure import Figure

    save, descriptions, films = Figure.savefig, list[str](), set[int]()

    def described(figure: Figure, *given: object, **options: object) -> None:
        is_later_frame = options.get("format") == "rgba" and id(figure) in films
        if not is_later_frame:
            descriptions.append(golden.describe(figure))
        films.add(id(figure))
        save(figure, *given, **options)

    monkeypatch.setattr(Figure, "savefig", described)
    yield
    assert descriptions, "nothing was saved"
    stored("\n\n".join(descriptions))


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
