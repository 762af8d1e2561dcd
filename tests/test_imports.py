"""The rules of the code's structure, read from its sources.

Imports run one way, from folder to folder; one file knows dolfinx; the judge shares nothing with
what it judges.
"""

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from project import ROOT

PACKAGE = ROOT / "delam_fem"
SOURCES = {
    ".".join(path.relative_to(PACKAGE).with_suffix("").parts): path
    for path in sorted(PACKAGE.rglob("*.py"))
}

# Each folder (or module of the top level) with the folders whose modules its own may import.
PURE = {"caches", "mpi", "numerics", "case", "contact", "model", "simulation"}
BELOW_STUDIES = PURE | {"engines", "results", "pipeline"}
ALLOWED: dict[str, set[str]] = {
    "caches": set(),
    "mpi": set(),
    "numerics": set(),
    "case": {"numerics", "contact"},
    "contact": {"caches", "numerics"},
    "model": {"mpi", "caches", "numerics", "case", "contact"},
    "simulation": PURE,
    "engines": PURE,
    "results": PURE,
    "pipeline": PURE | {"engines", "results"},
    "studies": BELOW_STUDIES,
    "reference": BELOW_STUDIES | {"studies"},
    "paper": BELOW_STUDIES | {"studies"},
    "cli": BELOW_STUDIES | {"studies", "reference", "paper"},
    "__init__": BELOW_STUDIES | {"studies", "reference"},
    "__main__": {"cli"},
}

# Modules that must not reach the others, even through what they import at once. The table of laws
# imports the laws when they are set up, so cases may read it.
JUDGE = {
    "reference.contact", "reference.loop", "reference.matrices", "reference.split_beam",
    "reference.stack",
}  # fmt: skip
ASSEMBLERS = {"model.beams", "model.layout", "model.vibration"}
DECIDING = {"contact.impulses", "contact.complementarity", "contact.newton", "contact.moreau"}
STRANGERS = [
    (JUDGE, {*DECIDING, "engines", "simulation", "case.gap", *ASSEMBLERS}),
    ({"engines.compiled"}, {"engines.petsc"}),
    ({"engines.petsc"}, {"engines.compiled"}),
    ({"simulation.loop", "simulation.recorder"}, {"case"}),
]
INPUTS = {
    "case.definition", "case.motion.excitation", "case.sections", "case.toml", "model.operators",
    "numerics.arrays",
}  # fmt: skip
"""What the judge shares with what it judges. Case sections import the exact cantilever."""
COMPUTED_BY_THE_CASE = {
    "angular_frequencies", "axial_rigidity", "flexural_rigidity", "linear_amplitude",
    "mass_per_length",
}  # fmt: skip
"""Numbers derived by the case, besides `rayleigh`; the judge derives them by itself."""
ABOVE_DOLFINX = {
    "model._dolfinx", "model.beams.hermite", "model.beams.bending", "model.beams.stack",
    "model.solids", "results.fields.vtx", "pipeline",
}  # fmt: skip
ABOVE_PETSC = {"engines.petsc", "mpi", *ABOVE_DOLFINX}
FROM_THE_DISTRIBUTION = {"basix", "dolfinx", "ffcx", "mpi4py", "petsc4py", "slepc4py", "ufl"}
MOST_MODULES, MOST_LINES = 16, 45
"""Modules of a folder, lines of code of a function."""
PART_OF = {  # modules that another distribution pins and brings
    "llvmlite": "numba",
    "pydantic_core": "pydantic",
    "sdypy": "sdypy-FRF",
}
PUBLISHING = {"case.atomic", "caches.forms"}
"""Modules that rename: the writer of results; libraries in private folders of their own."""
RENAMING = {"rename", "renames", "write_text", "write_bytes"}
WRITING = {"savefig", "to_netcdf", "savez", "screenshot", "copyfile", "write_vtx"}
"""Methods that only case/atomic.py may call; functions that write to its temporaries."""
NAMELESS = {"utils", "util", "helpers", "helper", "common", "misc"}
MACHINE_PATH = re.compile(r"(?<![\w./-])/(?:work|root|home|Users|mnt)/")
TEXT_FILES = {".py", ".sh", ".md", ".toml", ".txt", ".cfg", ".yml", ".yaml", ".html", ".csv", ""}
NOT_OURS = re.compile(r"\.(?!ci$).*|runs|build|dist|__pycache__|.*\.egg-info")


def tree(module: str) -> ast.Module:
    """Return the syntax tree of a module of the package."""
    return ast.parse(SOURCES[module].read_text(encoding="utf-8"))


def imported(nodes: ast.AST) -> Iterator[str]:
    """Yield the full names that a piece of code imports, each `from a import b` as `a.b`."""
    for node in ast.walk(nodes):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            prefix = ".".join(filter(None, [node.level * "delam_fem", node.module]))
            yield from (f"{prefix}.{alias.name}" for alias in node.names)


def own(code: ast.AST) -> set[str]:
    """Return the modules of the package that a piece of code imports."""
    found = set()
    for name in imported(code):
        first, _, rest = name.partition(".")
        if first == "delam_fem":
            module = rest if rest in SOURCES else rest.rpartition(".")[0]
            found.add(module if module in SOURCES else "__init__")
    return found


def at_the_top(module: str) -> ast.Module:
    """Return the statements of a module that import something at once."""
    statements = [s for s in tree(module).body if isinstance(s, ast.Import | ast.ImportFrom)]
    return ast.Module(statements, [])


def folder(module: str) -> str:
    """Return the folder of a module at the top level, the module itself where it has none."""
    return module.split(".")[0]


def within(modules: set[str]) -> set[str]:
    """Return modules, and those of the folders among their names."""
    return {m for m in SOURCES if any(m == name or m.startswith(f"{name}.") for name in modules)}


def reach(module: str, imports: dict[str, set[str]]) -> set[str]:
    """Return the modules that `module` imports, directly or through others, and itself."""
    found: set[str] = set()
    waiting = {module}
    while waiting:
        found |= waiting
        waiting = {name for m in waiting for name in imports[m]} - found
    return found


def test_every_folder_has_its_row() -> None:
    assert set(ALLOWED) == {folder(module) for module in SOURCES}


@pytest.mark.parametrize("module", SOURCES)
def test_imports_run_one_way(module: str) -> None:
    home = folder(module)
    others = {folder(name) for name in own(tree(module)) if name != "__init__"}
    assert others <= ALLOWED[home] | {home}


@pytest.mark.parametrize(("some", "others"), STRANGERS)
def test_strangers_do_not_reach_each_other(some: set[str], others: set[str]) -> None:
    near, far = within(some), within(others)
    imports = {m: own(tree(m) if m in near else at_the_top(m)) - {"__init__"} for m in SOURCES}
    assert {(a, b) for a in near for b in reach(a, imports) & far} == set()


@pytest.mark.parametrize("module", sorted(JUDGE))
def test_the_judge_takes_the_case_and_the_operators_alone(module: str) -> None:
    code = tree(module)
    assert own(code) <= JUDGE | INPUTS
    attributes = {node.attr for node in ast.walk(code) if isinstance(node, ast.Attribute)}
    assert not attributes & COMPUTED_BY_THE_CASE
    calls = {ast.unparse(node.func) for node in ast.walk(code) if isinstance(node, ast.Call)}
    assert not {name for name in calls if name.endswith(".rayleigh")}


@pytest.mark.parametrize(
    ("libraries", "users"),
    [({"dolfinx", "ufl", "basix"}, ABOVE_DOLFINX), ({"petsc4py", "mpi4py"}, ABOVE_PETSC)],
)
def test_pure_part_needs_no_dolfinx_and_no_petsc(libraries: set[str], users: set[str]) -> None:
    tops = {module: at_the_top(module) for module in SOURCES}
    imports = {module: own(tops[module]) - {"__init__"} for module in SOURCES}
    direct = {m for m in SOURCES if libraries & {n.split(".")[0] for n in imported(tops[m])}}
    assert {m for m in SOURCES if reach(m, imports) & direct} <= within(users)


@pytest.mark.parametrize("module", SOURCES)
def test_names_do_not_repeat_their_folder(module: str) -> None:
    *folders, name = module.split(".")
    assert not any(name.startswith(part) for part in folders)


@pytest.mark.parametrize("place", sorted({path.parent for path in SOURCES.values()}))
def test_folders_are_neither_crowded_nor_deep(place: Path) -> None:
    modules = [path for path in place.glob("*.py") if path.stem != "__init__"]
    assert len(modules) <= MOST_MODULES
    assert len(place.relative_to(PACKAGE).parts) <= 2


@pytest.mark.parametrize("module", SOURCES)
def test_functions_are_short(module: str) -> None:
    code = tree(module)
    found = [node for node in ast.walk(code) if isinstance(node, ast.FunctionDef)]
    assert [node.name for node in found if lines_of_code(node, module) > MOST_LINES] == []


def lines_of_code(function: ast.FunctionDef, module: str) -> int:
    """Return the number of lines of a function without docstrings, comments and blank lines."""
    source = SOURCES[module].read_text(encoding="utf-8").splitlines()
    texts = [
        node.body[0]
        for node in ast.walk(function)
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and ast.get_docstring(node) is not None
    ]
    taken = {k for text in texts for k in range(text.lineno, (text.end_lineno or 0) + 1)}
    return sum(
        1
        for k in range(function.lineno, (function.end_lineno or 0) + 1)
        if k not in taken and source[k - 1].strip() and not source[k - 1].lstrip().startswith("#")
    )


def test_only_one_file_imports_dolfinx() -> None:
    users = {
        module
        for module in SOURCES
        if {"dolfinx", "basix"} & {name.split(".")[0] for name in imported(tree(module))}
    }
    assert users == {"model._dolfinx"}


def test_mpi_has_one_door() -> None:
    """The door sets what must be set before MPI starts, and PETSc would start it."""
    users = {module for module in SOURCES if "mpi4py.MPI" in imported(tree(module))}
    assert users == {"mpi"}
    early = {module for module in SOURCES if "petsc4py.PETSc" in imported(at_the_top(module))}
    assert early <= within({"engines.petsc"})
    assert "mpi" in own(tree("engines.petsc.__init__"))


@pytest.mark.parametrize("module", sorted(set(SOURCES) - {"model._dolfinx"}))
def test_only_one_file_asks_for_the_version_of_dolfinx(module: str) -> None:
    code = tree(module)
    assert not {
        name for name in imported(code) if name.split(".")[0] in {"packaging", "pkg_resources"}
    }
    for node in ast.walk(code):
        if isinstance(node, ast.Compare):
            words = {getattr(part, "attr", getattr(part, "id", "")) for part in ast.walk(node)}
            assert not words & {"version", "__version__"}, f"line {node.lineno} compares versions"
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("version"):
            assert ast.unparse(node.args[0]) == "'delam_fem'", f"line {node.lineno}"


@pytest.mark.parametrize("module", sorted(set(SOURCES) - {"model._dolfinx"}))
def test_no_private_name_of_dolfinx_is_used(module: str) -> None:
    attributes = {
        ast.unparse(node) for node in ast.walk(tree(module)) if isinstance(node, ast.Attribute)
    }
    names = attributes | set(imported(tree(module)))
    assert not {name for name in names if re.search(r"(?<!_)dolfinx\.(_(?!_)|cpp\b)", name)}


@pytest.mark.parametrize("module", SOURCES)
def test_nothing_is_printed(module: str) -> None:
    calls = [node for node in ast.walk(tree(module)) if isinstance(node, ast.Call)]
    assert [call.lineno for call in calls if ast.unparse(call.func) == "print"] == []


@pytest.mark.parametrize("module", sorted(set(SOURCES) - PUBLISHING))
def test_files_are_written_under_temporary_names(module: str) -> None:
    calls = [node for node in ast.walk(tree(module)) if isinstance(node, ast.Call)]
    for call in calls:
        function = ast.unparse(call.func)
        *owner, name = function.rsplit(".", 1)
        is_renaming = function == "os.replace" or (owner and name in RENAMING)
        assert not is_renaming, f"line {call.lineno}"
        if name in WRITING:
            assert "temporary" in ast.unparse(call), f"line {call.lineno}"


def test_no_file_is_named_after_nothing() -> None:
    names = {
        path.stem for folder in ("delam_fem", "scripts") for path in ROOT.glob(f"{folder}/**/*.py")
    }
    assert not names & NAMELESS


def test_third_party_imports_are_declared() -> None:
    with (ROOT / "pyproject.toml").open("rb") as file:
        dependencies = tomllib.load(file)["project"]["dependencies"]
    declared = {re.split(r"[\[<>=!~ ]", entry)[0] for entry in dependencies}
    used = {name.split(".")[0] for module in SOURCES for name in imported(tree(module))}
    used -= {"delam_fem", *sys.stdlib_module_names, *FROM_THE_DISTRIBUTION}
    assert {PART_OF.get(name, name) for name in used} <= declared


def text_files(folder: Path) -> Iterator[Path]:
    """Yield the project's own text files below a folder."""
    for path in sorted(folder.iterdir()):
        if NOT_OURS.fullmatch(path.name):
            continue
        if path.is_dir():
            yield from text_files(path)
        elif path.is_file() and path.suffix in TEXT_FILES:
            yield path


def test_no_text_names_a_path_of_one_machine() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in text_files(ROOT)
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if MACHINE_PATH.search(line)
    ]
    assert found == []


def test_machine_paths_are_recognised() -> None:
    assert MACHINE_PATH.search("see " + "/work" + "/main/x.py")
    assert MACHINE_PATH.search("'/root" + "/x'")
    assert not MACHINE_PATH.search("docs/root/x.md")
