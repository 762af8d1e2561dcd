"""The rules of the code's structure, read from its sources.

Imports run one way, from folder to folder; one file knows dolfinx; the judge shares nothing with
what it judges. Each source is parsed once, and a test lists all offenders.
"""

import ast
import re
import sys
import tomllib
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest
from project import ROOT

from delam_fem import api

PACKAGE = ROOT / "delam_fem"
SOURCES = {
    ".".join(path.relative_to(PACKAGE).with_suffix("").parts): path
    for path in sorted(PACKAGE.rglob("*.py"))
}

# Each folder (or module of the top level) with the folders whose modules its own may import.
PURE = {"system", "numerics", "case", "contact", "model", "simulation"}
BELOW_STUDIES = PURE | {"engines", "results", "pipeline"}
ALLOWED: dict[str, set[str]] = {
    "plugins": BELOW_STUDIES,
    "api": BELOW_STUDIES | {"plugins"},
    "system": set(),
    "numerics": {"system"},
    "case": {"system", "numerics", "contact"},
    "contact": {"system", "numerics"},
    "model": {"system", "numerics", "case", "contact"},
    "simulation": PURE,
    "engines": PURE,
    "results": PURE,
    "pipeline": PURE | {"engines", "results"},
    "studies": {"api"},
    "reference": BELOW_STUDIES | {"plugins", "studies"},
    "paper": {"api", "studies"},
    "cli": BELOW_STUDIES | {"plugins", "studies", "reference", "paper"},
    "__init__": BELOW_STUDIES | {"plugins", "studies", "reference"},
    "__main__": {"cli"},
}

# What stands above the seam takes the simulator from it.
ABOVE_THE_SEAM = ("studies", "paper")
OF_SCRIPTS = {
    "contact.complementarity", "engines.compiled.engine", "engines.compiled.matrices",
    "engines.compiled.state", "engines.petsc.linear_algebra", "engines.petsc.newmark",
    "engines.petsc.theta", "model.operators", "model.sharing", "reference.loop", "system.caches",
}  # fmt: skip
"""What scripts besides look into: benchmarks of operations, trials on bare matrices and in C."""

# Modules that must not reach the others, even through what they import at once. The table of laws
# imports the laws when they are set up, so cases may read it.
JUDGE = {"reference.loop", "reference.matrices"}
ASSEMBLERS = {"model.beams", "model.layout", "model.linear"}
ASSEMBLING = {"model.beams.closed_form", "model.beams.forms", "model.solids.assembly"}
"""Modules whose structures come through `model.discretise.assemble` alone."""
DECIDING = {"contact.rules", "contact.complementarity"}
STRANGERS = [
    (JUDGE, {*DECIDING, "engines", "simulation", "case.gap", *ASSEMBLERS}),
    ({"engines.compiled"}, {"engines.petsc"}),
    ({"engines.petsc"}, {"engines.compiled"}),
    ({"simulation.loop", "simulation.recorder"}, {"case"}),
]
INPUTS = {
    "case.definition", "case.excitation", "case.sections", "model.operators", "numerics.types",
    "system.errors",
}  # fmt: skip
"""What the judge shares with what it judges. Case sections import the exact cantilever."""
COMPUTED_BY_THE_CASE = {
    "angular_frequencies", "axial_rigidity", "flexural_rigidity", "linear_amplitude",
    "mass_per_length",
}  # fmt: skip
"""Numbers derived by the case, besides `rayleigh`; the judge derives them by itself."""
ABOVE_DOLFINX = {
    "model._dolfinx", "model.beams.forms", "model.solids", "results.fields.vtx",
}  # fmt: skip
ABOVE_PETSC = {"engines.petsc", "system.mpi", *ABOVE_DOLFINX}
FROM_THE_DISTRIBUTION = {"basix", "dolfinx", "ffcx", "mpi4py", "petsc4py", "slepc4py", "ufl"}
PART_OF = {  # modules that another distribution pins and brings
    "PIL": "matplotlib",
    "llvmlite": "numba",
    "pydantic_core": "pydantic",
    "sdypy": "sdypy-FRF",
}
PUBLISHING = {"system.files", "system.caches", "system.written"}
"""Modules that rename: the writer of results; libraries in private folders of their own; the list
of an output folder."""
RENAMING = {"rename", "renames", "write_text", "write_bytes"}
WRITING = {"savefig", "to_netcdf", "savez", "screenshot", "copyfile", "write_vtx"}
"""Methods that only system/files.py may call; functions that write to its temporaries."""
BESIDE_DOLFINX = sorted(set(SOURCES) - {"model._dolfinx"})
NAMELESS = {"utils", "util", "helpers", "helper", "common", "misc"}
MACHINE_PATH = re.compile(r"(?<![\w./-])/(?:work|root|home|Users|mnt)/")
TEXT_FILES = {".py", ".sh", ".md", ".toml", ".txt", ".cfg", ".yml", ".yaml", ".html", ".csv", ""}
NOT_OURS = re.compile(r"\.(?!ci$).*|runs|build|dist|__pycache__|.*\.egg-info")


@cache
def tree(module: str) -> ast.Module:
    """Return the syntax tree of a module of the package."""
    return ast.parse(SOURCES[module].read_text(encoding="utf-8"))


@cache
def nodes(module: str) -> list[ast.AST]:
    """Return all nodes of a module."""
    return list(ast.walk(tree(module)))


def calls(module: str) -> Iterator[tuple[ast.Call, str]]:
    """Yield the calls of a module, each with the function that it calls."""
    for node in nodes(module):
        if isinstance(node, ast.Call):
            yield node, ast.unparse(node.func)


def at(module: str, node: ast.expr) -> str:
    """Return the place of a piece of code."""
    return f"{SOURCES[module].relative_to(ROOT)}:{node.lineno}"


def imported(code: Iterable[ast.AST]) -> Iterator[str]:
    """Yield the full names that nodes import, each `from a import b` as `a.b`."""
    for node in code:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            prefix = ".".join(filter(None, [node.level * "delam_fem", node.module]))
            yield from (f"{prefix}.{alias.name}" for alias in node.names)


def own(code: Iterable[ast.AST]) -> set[str]:
    """Return the modules of the package that nodes import."""
    names = set()
    for name in imported(code):
        first, _, tail = name.partition(".")
        if first == "delam_fem":
            module = tail if tail in SOURCES else tail.rpartition(".")[0]
            names.add(module if module in SOURCES else "__init__")
    return names


def at_the_top(module: str) -> list[ast.stmt]:
    """Return the statements of a module that import something at once."""
    return [s for s in tree(module).body if isinstance(s, ast.Import | ast.ImportFrom)]


def folder(module: str) -> str:
    """Return the folder of a module at the top level, the module itself where it has none."""
    return module.split(".")[0]


def within(modules: set[str]) -> set[str]:
    """Return modules, and those of the folders among their names."""
    return {m for m in SOURCES if any(m == name or m.startswith(f"{name}.") for name in modules)}


def reach(module: str, imports: dict[str, set[str]]) -> set[str]:
    """Return the modules that `module` imports, directly or through others, and itself."""
    reached: set[str] = set()
    waiting = {module}
    while waiting:
        reached |= waiting
        waiting = {name for m in waiting for name in imports[m]} - reached
    return reached


def at_run_time(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of code that runs, imports for types alone excepted."""
    yield node
    children = ast.iter_child_nodes(node)
    if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
        children = iter(node.orelse)
    for child in children:
        yield from at_run_time(child)


def circles(imports: dict[str, set[str]]) -> set[tuple[str, ...]]:
    """Return the groups of modules in which each reaches all others."""
    reached = {module: reach(module, imports) for module in imports}
    groups = {
        tuple(sorted(other for other in reached[module] if module in reached[other]))
        for module in imports
    }
    return {group for group in groups if len(group) > 1}


def test_no_modules_import_one_another_even_inside_functions() -> None:
    imports = {m: own(at_run_time(tree(m))) - {m, "__init__"} for m in SOURCES}
    assert circles(imports) == set()


def test_circles_are_found() -> None:
    imports = {"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": set[str]()}
    assert circles(imports) == {("a", "b", "c")}
    hidden = ast.parse("if TYPE_CHECKING:\n    import delam_fem.api\nelse:\n    import math")
    assert list(imported(at_run_time(hidden))) == ["math"]


def test_every_folder_has_its_row() -> None:
    assert set(ALLOWED) == {folder(module) for module in SOURCES}


def test_imports_run_one_way() -> None:
    upwards = {
        module: others
        for module in SOURCES
        if (
            others := {folder(name) for name in own(nodes(module)) - {"__init__"}}
            - ALLOWED[folder(module)]
            - {folder(module)}
        )
    }
    assert upwards == {}


def test_studies_take_the_simulator_from_the_seam() -> None:
    above = [module for module in SOURCES if folder(module) in ABOVE_THE_SEAM]
    around = {
        module: others
        for module in above
        if (others := own(nodes(module)) - {"api"} - within({*ABOVE_THE_SEAM}))
    }
    assert around == {}


def test_scripts_take_the_simulator_from_the_seam() -> None:
    taken = {
        module
        for path in (ROOT / "scripts").rglob("*.py")
        for module in own(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    }
    above = within({"cli", "reference.compare", *ABOVE_THE_SEAM})
    assert taken - above - {"__init__", "api"} == OF_SCRIPTS


def test_every_name_of_the_seam_is_there_and_taken() -> None:
    """A name that nobody takes is not one of the seam."""
    code = [*map(tree, SOURCES)]
    code += [
        ast.parse(path.read_text(encoding="utf-8"))
        for path in [*ROOT.glob("scripts/**/*.py"), *ROOT.glob("docs/examples/**/*.py")]
    ]
    taken = {
        name.rpartition(".")[2]
        for source in code
        for name in imported(ast.walk(source))
        if name.startswith("delam_fem.api.")
    }
    assert {"home_of", *taken} == {"home_of", *dir(api)}
    declared = {name.rpartition(".")[2] for name in imported(nodes("api"))}
    assert declared - {"annotations", "import_module", "TYPE_CHECKING"} == set(dir(api))
    assert [name for name in dir(api) if getattr(api, name) is None] == []


@pytest.mark.parametrize(("some", "others"), STRANGERS)
def test_strangers_do_not_reach_each_other(some: set[str], others: set[str]) -> None:
    near, far = within(some), within(others)
    imports = {m: own(nodes(m) if m in near else at_the_top(m)) - {"__init__"} for m in SOURCES}
    assert {(a, b) for a in near for b in reach(a, imports) & far} == set()


def test_structures_come_through_one_door() -> None:
    outside = {m for m in SOURCES if folder(m) != "model"}
    passing = {m: taken for m in outside if (taken := own(nodes(m)) & ASSEMBLING)}
    assert passing == {"api": {"model.beams.closed_form"}}
    assert {n for n in imported(nodes("api")) if "closed_form" in n} == {
        "delam_fem.model.beams.closed_form.beam"  # matrices of a strip that is no case
    }


@pytest.mark.parametrize("module", sorted(JUDGE))
def test_the_judge_takes_the_case_and_the_operators_alone(module: str) -> None:
    assert own(nodes(module)) <= JUDGE | INPUTS
    attributes = {node.attr for node in nodes(module) if isinstance(node, ast.Attribute)}
    assert not attributes & COMPUTED_BY_THE_CASE
    assert not {name for _, name in calls(module) if name.endswith(".rayleigh")}


@pytest.mark.parametrize(
    ("libraries", "users"),
    [({"dolfinx", "ufl", "basix"}, ABOVE_DOLFINX), ({"petsc4py", "mpi4py"}, ABOVE_PETSC)],
)
def test_pure_part_needs_no_dolfinx_and_no_petsc(libraries: set[str], users: set[str]) -> None:
    tops = {module: at_the_top(module) for module in SOURCES}
    imports = {module: own(tops[module]) - {"__init__"} for module in SOURCES}
    direct = {m for m in SOURCES if libraries & {n.split(".")[0] for n in imported(tops[m])}}
    assert {m for m in SOURCES if reach(m, imports) & direct} <= within(users)


def test_names_do_not_repeat_their_folder() -> None:
    repeating = [
        module
        for module in SOURCES
        for part in module.split(".")[:-1]
        if module.rpartition(".")[2].startswith(part)
    ]
    assert repeating == []


def test_only_one_file_imports_dolfinx() -> None:
    users = {
        module
        for module in SOURCES
        if {"dolfinx", "basix"} & {name.split(".")[0] for name in imported(nodes(module))}
    }
    assert users == {"model._dolfinx"}


def test_mpi_has_one_door() -> None:
    """The door sets what must be set before MPI starts, and PETSc would start it."""
    users = {module for module in SOURCES if "mpi4py.MPI" in imported(nodes(module))}
    assert users == {"system.mpi"}
    early = {module for module in SOURCES if "petsc4py.PETSc" in imported(at_the_top(module))}
    assert early <= within({"engines.petsc"})
    assert "system.mpi" in own(nodes("engines.petsc.__init__"))


def test_only_one_file_asks_for_the_version_of_dolfinx() -> None:
    assert [place for m in BESIDE_DOLFINX for place in asking_for_versions(m)] == []


def asking_for_versions(module: str) -> Iterator[str]:
    """Yield what a module imports, compares or calls to know the version of a library."""
    for name in imported(nodes(module)):
        if name.split(".")[0] in {"packaging", "pkg_resources"}:
            yield f"{module} imports {name}"
    for node in nodes(module):
        if isinstance(node, ast.Compare):
            words = {getattr(part, "attr", getattr(part, "id", "")) for part in ast.walk(node)}
            if words & {"version", "__version__"}:
                yield at(module, node)
    for call, function in calls(module):
        if function.endswith("version") and ast.unparse(call.args[0]) != "'delam_fem'":
            yield at(module, call)


def test_no_private_name_of_dolfinx_is_used() -> None:
    names = {
        (module, name)
        for module in BESIDE_DOLFINX
        for name in [
            *(ast.unparse(node) for node in nodes(module) if isinstance(node, ast.Attribute)),
            *imported(nodes(module)),
        ]
    }
    assert {pair for pair in names if re.search(r"(?<!_)dolfinx\.(_(?!_)|cpp\b)", pair[1])} == set()


def builds_dynamic_stiffness(node: ast.AST) -> bool:
    """Say whether code is a sum of terms, one with iω and one with -ω²."""
    if not (isinstance(node, ast.BinOp) and isinstance(node.op, ast.Sub)):
        return False
    parts = [list(ast.walk(part)) for part in (node.left, node.right)]
    is_damped = any(isinstance(n, ast.Constant) and isinstance(n.value, complex) for n in parts[0])
    return is_damped and any(
        isinstance(n, ast.BinOp) and isinstance(n.op, ast.Pow) for n in parts[1]
    )


def test_one_module_builds_the_dynamic_stiffness() -> None:
    builders = {m for m in SOURCES if any(map(builds_dynamic_stiffness, nodes(m)))}
    assert builders == {"model.linear"}


def test_nothing_is_printed() -> None:
    assert [at(m, call) for m in SOURCES for call, name in calls(m) if name == "print"] == []


def test_files_are_written_under_temporary_names() -> None:
    assert [
        at(module, call)
        for module in SOURCES
        if module not in PUBLISHING
        for call, function in calls(module)
        if writes(call, function)
    ] == []


def writes(call: ast.Call, function: str) -> bool:
    """Say whether a call renames a file, or writes one that is not named temporary."""
    *owner, name = function.rsplit(".", 1)
    is_dataset = bool(owner) and owner[0].endswith("history")  # whose variables are renamed
    if function == "os.replace" or (owner and name in RENAMING and not is_dataset):
        return True
    return name in WRITING and "temporary" not in ast.unparse(call)


def test_no_file_is_named_after_nothing() -> None:
    names = {
        path.stem for folder in ("delam_fem", "scripts") for path in ROOT.glob(f"{folder}/**/*.py")
    }
    assert not names & NAMELESS


def test_third_party_imports_are_declared() -> None:
    with (ROOT / "pyproject.toml").open("rb") as file:
        dependencies = tomllib.load(file)["project"]["dependencies"]
    declared = {re.split(r"[\[<>=!~ ]", entry)[0] for entry in dependencies}
    used = {name.split(".")[0] for module in SOURCES for name in imported(nodes(module))}
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
    matches = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in text_files(ROOT)
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if MACHINE_PATH.search(line)
    ]
    assert matches == []


def test_machine_paths_are_recognised() -> None:
    assert MACHINE_PATH.search("see " + "/work" + "/main/x.py")
    assert MACHINE_PATH.search("'/root" + "/x'")
    assert not MACHINE_PATH.search("docs/root/x.md")
