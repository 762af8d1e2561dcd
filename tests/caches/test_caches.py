"""Compiled code survives damage, kills, folders that cannot be written and no home at all."""

import json
import logging
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numba
import pytest
from numba.core.codegen import JITCodeLibrary
from project import ROOT

from delam_fem.system import caches
from delam_fem.system.caches import kept, njit, opened, sealed

KERNEL = """
import logging, sys
from delam_fem.system.caches import kept

logging.basicConfig(level=logging.DEBUG if "-v" in sys.argv else logging.WARNING)
logging.getLogger("numba").setLevel(logging.WARNING)


@kept
def double(x):
    return 2.0 * x


assert double(21.0) == 42.0
print(sum(double.stats.cache_hits.values()))
"""
RAISING = """
import numpy as np
from delam_fem.system.caches import kept, njit

@njit
def inverse(x):
    if x > 3.0:
        raise ValueError("large")
    return 1.0 / x

@kept
def function(x, n):
    a = np.full(n, x)
    if x < 0.0:
        raise IndexError("low", n)
    return inverse(x) + a.sum() + np.linalg.solve(np.eye(2) * x, np.ones(2))[0]

for x in (2.0, 0.0, 4.0, -1.0):
    try:
        print(function(x, 3))
    except Exception as error:
        print(type(error).__name__, error)
print(sum(function.stats.cache_hits.values()))
"""
FORMS = """
import logging, sys
logging.basicConfig(level=logging.DEBUG if "-v" in sys.argv else logging.WARNING)
for name in ("numba", "FFCx", "UFL", "ffcx"):
    logging.getLogger(name).setLevel(logging.WARNING)
import numpy as np
from mpi4py import MPI
from delam_fem.model import _dolfinx

x, cells = np.linspace(0.0, 1.0, 3), np.array([[0, 1], [1, 2]])
mesh = _dolfinx.create_mesh(MPI.COMM_SELF, "interval", x, cells)
import ufl
space = _dolfinx.space(mesh, "Lagrange", 1)
u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
matrix = _dolfinx.assemble_matrix(u * v * ufl.dx)
assert abs(sum(matrix.getValuesCSR()[2]) - 1.0) < 1e-14
matrix.destroy()
"""
STRUCTURES = """
import delam_fem as df
from delam_fem.model import discretise

discretise.assemble(df.preset("default"))
discretise.assemble(df.preset("default", {"model.kind": "plane-stress", "mesh.elements": 4}))
"""
BACKWARDS = """
import delam_fem as df
from delam_fem.model import discretise
import dolfinx, ufl
from mpi4py import MPI

mesh = dolfinx.mesh.create_unit_square(MPI.COMM_SELF, 2, 2, dolfinx.mesh.CellType.quadrilateral)
make = getattr(dolfinx.fem, "VectorFunctionSpace", None)
space = make(mesh, ("Lagrange", 2)) if make else dolfinx.fem.functionspace(mesh, ("CG", 2, (2,)))
u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
df.Operators.from_forms(ufl.inner(u, v) * ufl.dx, ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx,
                        gap=df.Gap([[1.0, 1.0]], (0.0, 1.0), 0.1))
discretise.assemble(df.preset("default", {"model.kind": "plane-stress", "mesh.elements": 4}))
discretise.assemble(df.preset("default"))
"""
OWN_FORM = """
import dolfinx
dolfinx.fem.form(u * v * ufl.dx(metadata={"quadrature_degree": 7}))
"""
DAMAGES = {
    "empty": lambda text: b"",
    "truncated": lambda text: text[: len(text) // 2],
    "changed": lambda text: text[:-9] + bytes([text[-9] ^ 1]) + text[-8:],
    "other": lambda text: b"<html>quota exceeded</html>",
}


def python(
    program: Path, *arguments: str, cwd: Path, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run a program in a process of its own, with a cache below `cwd`."""
    return subprocess.run(
        [sys.executable, str(program), *arguments],
        cwd=cwd,
        env=in_cache(cwd) | environment,
        capture_output=True,
        text=True,
        timeout=600,
    )


def in_cache(folder: Path) -> dict[str, str]:
    """Return the environment of a process whose cache is below a folder."""
    return {**os.environ, "PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(folder / "cache")}


@pytest.fixture
def kernel(tmp_path: Path) -> Path:
    program = tmp_path / "kernel.py"
    program.write_text(KERNEL)
    return program


@pytest.fixture(scope="module")
def compiled_forms(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a program and the libraries that it has compiled."""
    folder = tmp_path_factory.mktemp("forms")
    (folder / "forms.py").write_text(FORMS)
    done = python(folder / "forms.py", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder


def libraries(folder: Path) -> list[Path]:
    return sorted((folder / "cache" / "fenics" / "delam_fem").glob("*/*.so"))


def test_a_seal_shows_every_change() -> None:
    assert opened(sealed(b"content")) == b"content"
    for damage in DAMAGES.values():
        with pytest.raises(ValueError, match="the checksum does not fit"):
            opened(damage(sealed(b"some longer content")))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("suffix", "damage"),
    [
        pytest.param("nbi", "empty", marks=pytest.mark.nightly),
        pytest.param("nbc", "truncated", marks=pytest.mark.nightly),
        ("nbc", "changed"),
    ],
)
def test_damaged_machine_code_is_compiled_anew(kernel: Path, suffix: str, damage: str) -> None:
    assert python(kernel, cwd=kernel.parent).stdout == "0\n"
    (path,) = (kernel.parent / "__pycache__").glob(f"*.{suffix}")
    path.write_bytes(DAMAGES[damage](path.read_bytes()))
    again = python(kernel, "-v", cwd=kernel.parent)
    assert (again.returncode, again.stdout) == (0, "0\n"), again.stderr
    assert "DEBUG" in again.stderr and "compiled anew" in again.stderr
    assert DAMAGES[damage](path.read_bytes()) != path.read_bytes() != b""
    opened(path.read_bytes())  # mended
    assert python(kernel, cwd=kernel.parent).stdout == "1\n"


@pytest.mark.slow
def test_without_any_folder_machine_code_goes_to_a_temporary_one(kernel: Path) -> None:
    folder = kernel.parent
    (folder / "cache").write_text("no folder")
    (folder / "__pycache__").write_text("no folder")
    (folder / "tmp").mkdir()
    processes = [python(kernel, cwd=folder, TMPDIR=str(folder / "tmp")) for _ in range(2)]
    assert [done.stdout for done in processes] == ["0\n", "1\n"]
    assert processes[0].stderr.count("no folder for compiled code can be written") == 1
    assert len(processes[0].stderr.splitlines()) == 1


@pytest.mark.slow
def test_stored_machine_code_raises_and_allocates_as_new_code_does(tmp_path: Path) -> None:
    (tmp_path / "raising.py").write_text(RAISING)
    first, second = (python(tmp_path / "raising.py", cwd=tmp_path) for _ in range(2))
    expected = "7.0\nZeroDivisionError division by zero\nValueError large\nIndexError ('low', 3)\n"
    assert (first.stdout, second.stdout) == (f"{expected}0\n", f"{expected}1\n"), second.stderr


@pytest.mark.slow
@pytest.mark.parametrize("damage", ["empty", pytest.param("truncated", marks=pytest.mark.nightly)])
def test_damaged_forms_are_compiled_anew(compiled_forms: Path, tmp_path: Path, damage: str) -> None:
    shutil.copytree(compiled_forms, tmp_path, dirs_exist_ok=True)
    for library in libraries(tmp_path):
        library.write_bytes(DAMAGES[damage](library.read_bytes()))
    again = python(tmp_path / "forms.py", "-v", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    n_libraries = len(libraries(tmp_path))
    assert again.stderr.count(": damaged (") == n_libraries > 0
    third = python(tmp_path / "forms.py", "-v", cwd=tmp_path)
    assert third.returncode == 0 and ": damaged (" not in third.stderr


def test_the_library_of_a_faster_process_stays(compiled_forms: Path, tmp_path: Path) -> None:
    """A third process may be about to load it."""
    shutil.copytree(compiled_forms, tmp_path, dirs_exist_ok=True)
    final = libraries(tmp_path)[0].parent
    before = final.stat().st_ino
    private = shutil.copytree(final, final.with_name("part-slower"))
    caches._publish(private, final)
    assert final.stat().st_ino == before and private.is_dir()
    (final / "sha256").write_text("another")
    caches._publish(private, final)
    assert not private.exists() and caches._is_intact(final)


@pytest.mark.slow
def test_a_kill_while_forms_are_compiled_spoils_nothing(tmp_path: Path) -> None:
    (tmp_path / "forms.py").write_text(FORMS)
    cache = tmp_path / "cache" / "fenics" / "delam_fem"
    process = subprocess.Popen(
        [sys.executable, "forms.py"],
        cwd=tmp_path,
        env=in_cache(tmp_path),
        start_new_session=True,
        stderr=subprocess.DEVNULL,
    )
    end = time.monotonic() + 600.0
    while not list(cache.glob("part-*/*.c")) and time.monotonic() < end:
        time.sleep(0.002)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    (left,) = cache.glob("part-*")
    again = python(tmp_path / "forms.py", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    os.utime(left, (0.0, 0.0))  # long ago
    shutil.rmtree(libraries(tmp_path)[0].parent)
    assert python(tmp_path / "forms.py", cwd=tmp_path).returncode == 0
    assert not list(cache.glob("part-*"))


def test_without_home_forms_are_compiled_in_a_temporary_folder(tmp_path: Path) -> None:
    (tmp_path / "forms.py").write_text(FORMS)
    (tmp_path / "cache").write_text("no folder")
    (tmp_path / "tmp").mkdir()
    environment = {"TMPDIR": str(tmp_path / "tmp"), "HOME": "/proc/nowhere"}
    done = python(tmp_path / "forms.py", cwd=tmp_path, **environment)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("no folder for compiled code can be written") == 1
    (temporary,) = (tmp_path / "tmp").glob("delam_fem-*")
    assert temporary.stat().st_mode & 0o077 == 0
    assert list(temporary.glob("delam_fem/*/libffcx_*.so"))


def test_a_second_process_compiles_no_form(tmp_path: Path) -> None:
    """Neither does a third one that has forms of the user first, and then ours backwards."""
    program = tmp_path / "forms.py"
    listings = []
    for text in (STRUCTURES, STRUCTURES, BACKWARDS):
        program.write_text(text)
        done = python(program, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        listings.append(libraries(tmp_path))
        if text is STRUCTURES:
            assert not list((tmp_path / "cache" / "fenics").glob("*.c"))
    assert len(listings[0]) >= 2 and listings[1] == listings[0]  # 8 with elements, 6 without
    assert listings[2] == listings[0]
    assert len(list((tmp_path / "cache" / "fenics").glob("libffcx_forms_*.c.cached"))) == 2


def test_a_form_of_the_user_stays_where_dolfinx_puts_it(
    compiled_forms: Path, tmp_path: Path
) -> None:
    shutil.copytree(compiled_forms, tmp_path, dirs_exist_ok=True)
    (tmp_path / "own.py").write_text(FORMS + OWN_FORM)
    before = libraries(tmp_path)
    done = python(tmp_path / "own.py", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert libraries(tmp_path) == before
    assert list((tmp_path / "cache" / "fenics").glob("libffcx_forms_*.c.cached"))


def test_options_in_the_working_folder_do_not_count(tmp_path: Path) -> None:
    (tmp_path / "forms.py").write_text(FORMS)
    (tmp_path / "bad.h").write_text("#error from the working folder\n")
    options = {"cffi_extra_compile_args": ["-include", str(tmp_path / "bad.h")]}
    for name in ("parameters", "options"):
        (tmp_path / f"dolfinx_jit_{name}.json").write_text(json.dumps(options))
        (tmp_path / f"ffcx_{name}.json").write_text('{"tabulate_tensor_void": true}')
    done = python(tmp_path / "forms.py", cwd=tmp_path)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("of_others", ["link", "open"])
def test_a_temporary_folder_of_others_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, of_others: str
) -> None:
    taken = tmp_path / f"delam_fem-{os.getuid()}"
    if of_others == "link":
        (tmp_path / "elsewhere").mkdir(mode=0o700)
        taken.symlink_to(tmp_path / "elsewhere")
    else:
        taken.mkdir()
        taken.chmod(0o777)
    monkeypatch.setattr(caches.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(caches.tempfile, "tempdir", str(tmp_path))
    caches.temporary_folder.cache_clear()
    try:
        logging.getLogger("delam_fem").setLevel(logging.ERROR)
        folder = caches.temporary_folder()
    finally:
        caches.temporary_folder.cache_clear()
        logging.getLogger("delam_fem").setLevel(logging.NOTSET)
    assert folder != taken and folder.parent == tmp_path
    assert folder.stat().st_mode & 0o077 == 0


def test_only_the_outermost_function_becomes_machine_code(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Of three functions that call one another Numba alone would compile all three."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    compiled: list[str] = []
    finalize = JITCodeLibrary._finalize_specific

    def note(library: JITCodeLibrary) -> None:
        compiled.append(library.name.rpartition(".")[2])
        finalize(library)

    monkeypatch.setattr(JITCodeLibrary, "_finalize_specific", note)

    @njit
    def tripled(x):  # type: ignore[no-untyped-def]
        return 3.0 * x

    @njit
    def lowered(x):  # type: ignore[no-untyped-def]
        return tripled(x) - 1.0

    @kept
    def outermost(x):  # type: ignore[no-untyped-def]
        return lowered(x) + tripled(x)

    assert outermost(2.0) == 11.0
    assert [name for name in compiled if name != "nrt"] == ["kept"]  # nrt: Numba's own
    for _ in range(2):
        with pytest.raises(TypeError, match="lowered is for compiled code alone"):
            lowered(2.0)  # Python's own code would run, a hundred times as long


NAMESAKES = """
import sys
from delam_fem.system.caches import kept, njit


def times(factor):
    @njit
    def repeated(n):  # recursive, so that no caller contains it
        return 0.0 if n == 0 else factor + repeated(n - 1)

    return repeated


one, two = times(1.0), times(2.0)


@kept
def first(n):
    return one(n)


@kept
def second(n):
    return two(n)


print(*(globals()[name](3) for name in sys.argv[1:]))
"""


@pytest.mark.slow
def test_functions_of_one_name_in_two_files_stay_apart(tmp_path: Path) -> None:
    """Two processes count their functions alike; a third one loads the code of both."""
    program = tmp_path / "namesakes.py"
    program.write_text(NAMESAKES)
    alone = [python(program, name, cwd=tmp_path).stdout for name in ("first", "second")]
    assert alone == ["3.0\n", "6.0\n"]
    assert python(program, "first", "second", cwd=tmp_path).stdout == "3.0 6.0\n"
