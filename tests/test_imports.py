"""The rules of the code's structure, read from its sources.

Discretisation, contact law, stepper and loop do not know each other; the reference shares nothing
with what it judges; one file knows dolfinx.
"""

import ast
import re
import sys
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "delam_fem"
SOURCES = {path.stem: path for path in sorted(PACKAGE.glob("*.py"))}

# Each module with the modules of the package that it may import, at the top or in a function.
ALLOWED: dict[str, set[str]] = {
    "__init__": {"parameters", "results", "run", "sweep", "sweepgrid"},
    # cases
    "values": set(),
    "sections": {"cantilever", "values"},
    "casefile": set(),
    "overrides": {"casefile"},
    "case": {"cantilever", "casefile", "overrides", "sections", "values"},
    "parameters": {"case", "casefile", "overrides", "sections"},
    "gap": {"cantilever", "parameters"},
    "excitation": {"parameters"},
    # the semi-discrete problem, and what makes it
    "operators": set(),
    "model": {"operators"},
    "cantilever": set(),
    "_dolfinx": set(),
    "mesh": {"_dolfinx", "operators", "parameters"},
    "hermite": {"_dolfinx", "operators"},
    "beam": {"gap", "hermite", "mesh", "model", "operators", "parameters"},
    # contact
    "complementarity": {"operators"},
    "contact": {"complementarity", "operators"},
    "supervisor": {"contact", "operators"},
    # time
    "energy": {"operators"},
    "petsc": {"operators"},
    "compliance": {"operators", "petsc"},
    "dynamics": {"energy", "operators", "petsc", "supervisor"},
    "newmark": {"compliance", "dynamics", "operators", "petsc", "supervisor"},
    "moreau": {"compliance", "dynamics", "operators", "petsc", "supervisor"},
    "moreau_laws": {"contact", "operators", "supervisor"},
    "stability": {"operators", "parameters"},
    "jumps": {"operators", "supervisor"},
    "recorder": {"energy", "jumps", "operators", "supervisor"},
    "simulate": {"operators", "recorder", "supervisor"},
    "engines": {
        *(
            "moreau",
            "moreau_laws",
            "newmark",
            "operators",
            "parameters",
            "simulate",
            "stability",
            "supervisor",
        ),
    },
    "checkpoint": {"energy", "jumps", "operators", "parameters", "recorder", "simulate"},
    "watch": {"simulate"},
    # the compiled engine
    "simd": {"operators"},
    "banded": {"operators"},
    "lanes": {"lane_kernels", "operators", "simd"},
    "lane_kernels": {"simd"},
    "compiled_state": {"lane_kernels", "operators", "simd"},
    "compiled_system": {"banded", "lane_kernels", "lanes", "operators", "simd"},
    "compiled_contact": {
        *("banded", "compiled_algebra", "compiled_springs", "compiled_state", "complementarity"),
        "lane_kernels",
    },
    "compiled_loop": {
        *("banded", "compiled_algebra", "compiled_contact", "compiled_springs", "compiled_state"),
        *("lane_kernels", "simd"),
    },
    "compiled": {
        *("compiled_contact", "compiled_loop", "compiled_state", "compiled_stepper"),
        *("compiled_system", "jumps", "operators", "parameters", "recorder", "simulate"),
        "stability",
        "supervisor",
    },
    "compiled_algebra": {"banded", "compiled_state", "lane_kernels"},
    "compiled_springs": {"banded", "compiled_algebra", "compiled_state", "lane_kernels"},
    "compiled_stepper": {
        *("compiled_loop", "compiled_state", "compiled_system", "energy", "lane_kernels"),
        *("operators", "supervisor"),
    },
    "recording": {"excitation", "operators", "parameters", "recorder"},
    # results and their pictures
    "fields": {"model", "operators"},
    "harmonics": set(),
    "diagnostics": {"harmonics", "parameters"},
    "figure_style": {"parameters"},
    "contact_figures": {"diagnostics", "figure_style", "parameters"},
    "motion_figures": {"diagnostics", "figure_style", "harmonics", "parameters"},
    "plots": {"contact_figures", "figure_style", "motion_figures", "parameters"},
    "ribbons": {"parameters"},
    "snapshots": {"diagnostics", "figure_style", "parameters", "ribbons"},
    "vtk": {"parameters", "ribbons", "snapshots"},
    "vtx": {"_dolfinx", "operators"},
    "report": {"contact_figures", "figure_style", "parameters"},
    "results": {
        *("fields", "model", "operators", "parameters", "plots", "recorder", "report"),
        *("simulate", "vtk", "vtx"),
    },
    # the whole
    "run": {
        *("_dolfinx", "beam", "checkpoint", "compiled", "diagnostics", "energy_gain", "engines"),
        *("model", "parameters", "recorder", "recording", "results", "simulate", "watch"),
    },
    "modes": {"beam", "cantilever", "model", "operators", "parameters"},
    # the reference
    "reference": {"gap", "model", "operators", "parameters"},
    "reference_contact": {"operators", "parameters"},
    "reference_loop": {"excitation", "model", "operators", "parameters", "reference_contact"},
    "compare": {
        *("beam", "model", "modes", "operators", "parameters", "reference", "reference_loop"),
        "run",
    },
    # lateral impact on one lamina
    "ground": {"cantilever", "operators", "parameters", "reference"},
    "struck_beam": {"operators", "parameters"},
    "ground_run": {
        *("compiled", "compiled_state", "compiled_system", "operators", "recorder", "simulate"),
    },
    "rolling": {"ground", "ground_run", "operators", "parameters"},
    "tip_block": {"ground_run", "operators", "parameters", "struck_beam"},
    "tip_fall": {
        *("ground", "ground_run", "operators", "parameters", "simulate", "struck_beam"),
        "tip_block",
    },
    "lateral": {"ground", "ground_run", "rolling", "tip_block", "tip_fall"},
    "rolling_figure": {
        *("figure_style", "ground", "ground_run", "lateral", "rolling", "tip_block", "tip_figure"),
    },
    "tip_figure": {"figure_style", "struck_beam", "tip_block"},
    # the paper
    "restitution": set(),
    "paper": {
        *("figure_style", "paper_chart", "paper_claims", "paper_detail", "paper_lab"),
        *(
            "paper_lateral",
            "paper_linear",
            "paper_mesh",
            "paper_motion",
            "paper_page",
            "paper_plane",
            "paper_response",
            "paper_shapes",
        ),
        *("paper_spectra", "paper_strikes", "paper_system", "paper_threshold", "parameters"),
    },
    "paper_chart": {
        *("diagnostics", "figure_style", "paper_claims", "paper_lab", "paper_shapes"),
        "results",
    },
    "paper_claims": set(),
    "paper_detail": {
        *("diagnostics", "figure_style", "motion_figures", "paper_claims", "paper_lab"),
        *("paper_measures", "paper_motion", "results"),
    },
    "paper_lab": {"executors", "parameters", "results", "run", "sweep", "sweepgrid"},
    "paper_lateral": {
        *("lateral", "paper_claims", "paper_lab", "rolling_figure", "tip_figure"),
    },
    "paper_linear": {
        *("cantilever", "figure_style", "paper_claims", "paper_lab", "paper_sweep"),
        *("parameters", "results"),
    },
    "paper_measures": {"diagnostics", "results"},
    "paper_mesh": {
        *("diagnostics", "figure_style", "motion_figures", "paper_claims", "paper_detail"),
        *("paper_lab", "paper_measures", "paper_motion", "results"),
    },
    "paper_motion": {
        *("diagnostics", "figure_style", "motion_figures", "paper_claims", "paper_lab"),
        *("paper_measures", "results"),
    },
    "paper_page": {"paper_claims"},
    "paper_plane": {
        *("attractors", "diagnostics", "figure_style", "paper_claims", "paper_lab"),
        "paper_plane_measures",
    },
    "paper_plane_measures": {"attractors", "diagnostics"},
    "paper_response": {
        *("figure_style", "paper_claims", "paper_lab", "paper_sweep"),
        "parameters",
        "results",
    },
    "paper_shapes": {
        *("diagnostics", "figure_style", "paper_claims", "paper_lab", "parameters"),
        "results",
    },
    "paper_spectra": {
        *("diagnostics", "figure_style", "harmonics", "paper_claims", "paper_lab"),
        *("paper_measures", "results"),
    },
    "paper_strikes": {"figure_style", "paper_claims", "paper_lab", "restitution", "results"},
    "paper_sweep": {"excitation", "parameters", "results"},
    "paper_system": {"figure_style", "gap", "paper_claims", "paper_lab", "parameters"},
    "paper_threshold": {
        *("figure_style", "paper_claims", "paper_lab", "reference", "results"),
        "stability",
    },
    # sweeps of runs and their diagrams
    "executors": {"parameters"},
    "initial": {"operators", "parameters", "simulate"},
    "sweepfile": {"values"},
    "sweepgrid": {"casefile", "overrides", "parameters", "sweepfile"},
    "sweep_quantities": {
        *("diagnostics", "fields", "harmonics", "operators", "parameters", "recorder", "sweepfile"),
    },
    "sweep_point": {
        *("beam", "compiled", "engines", "initial", "lyapunov", "model", "operators", "parameters"),
        *("recorder", "recording", "reference", "simulate", "sweep_quantities", "sweepgrid"),
    },
    "sweep_journal": {"operators", "parameters", "simulate", "sweep_point"},
    "sweep_schedule": {"simulate", "sweep_point"},
    "sweep_dataset": {"operators", "sweep_journal", "sweep_point", "sweep_quantities", "sweepgrid"},
    "sweep": {
        *("executors", "parameters", "sweep_dataset", "sweep_journal", "sweep_point"),
        *("sweep_quantities", "sweep_schedule", "sweepgrid", "watch"),
    },
    "lyapunov": {"operators", "recorder", "simulate"},
    "attractors": set(),
    "diagram_axes": {"parameters"},
    "line_diagrams": {"attractors", "diagram_axes", "figure_style", "parameters"},
    "map_diagrams": {"attractors", "diagnostics", "diagram_axes", "figure_style", "parameters"},
    "diagrams": {"figure_style", "line_diagrams", "map_diagrams"},
    # ladders of runs
    "extrapolation": set(),
    "ladder_statistics": {"diagnostics", "harmonics", "operators", "recorder"},
    "ladder": {"mesh", "parameters"},
    "ladder_rung": {
        *("compiled", "engines", "initial", "ladder", "ladder_statistics", "mesh", "operators"),
        *("parameters", "recorder", "recording", "reference", "simulate"),
    },
    "convergence": {
        *("executors", "extrapolation", "ladder", "ladder_rung", "ladder_statistics"),
        *("operators", "parameters", "results", "watch"),
    },
    "convergence_tables": {"convergence", "extrapolation", "ladder", "ladder_statistics"},
    "convergence_figures": {"convergence", "figure_style", "ladder", "ladder_statistics"},
    "energy_gain": {"parameters", "recorder"},
    "__main__": {"cli"},
    "cli_inputs": {"overrides", "parameters"},
    "cli_sweep": {
        *("diagrams", "executors", "overrides", "parameters", "progress", "sweep", "sweepgrid"),
        "terminal",
    },
    "cli_converge": {
        *("cli_inputs", "convergence", "convergence_figures", "convergence_tables", "ladder"),
        *("parameters", "progress", "terminal"),
    },
    # the command
    "progress": set(),
    "terminal": {"parameters"},
    "cli_paper": {"paper", "paper_lab", "paper_page", "terminal"},
    "cli": {
        *("__init__", "cli_converge", "cli_inputs", "cli_paper", "cli_sweep", "compare", "modes"),
        *("parameters", "progress", "run", "terminal"),
    },
}

# Modules that must not reach one another, even through others.
STRANGERS = [
    ({"_dolfinx", "mesh", "hermite", "beam"}, {"contact", "supervisor", "newmark", "simulate"}),
    ({"contact", "complementarity"}, {"_dolfinx", "petsc", "newmark", "moreau", "simulate"}),
    ({"supervisor"}, {"_dolfinx", "petsc", "dynamics", "newmark", "moreau", "simulate"}),
    ({"dynamics", "newmark", "moreau", "engines"}, {"_dolfinx", "hermite", "beam", "run"}),
    ({"compiled"}, {"_dolfinx", "hermite", "beam", "petsc", "dynamics", "run"}),
    ({"simulate", "recorder"}, {"_dolfinx", "beam", "dynamics", "newmark", "moreau", "petsc"}),
    (
        {"reference", "reference_contact", "reference_loop"},
        {"_dolfinx", "hermite", "beam", "contact", "complementarity", "supervisor", "petsc"}
        | {"dynamics", "newmark", "moreau", "simulate", "energy"},
    ),
]

ABOVE_DOLFINX = {"_dolfinx", "hermite", "beam", "run", "vtx"}
ABOVE_PETSC = {
    "petsc",
    "compliance",
    "dynamics",
    "newmark",
    "moreau",
    "engines",
    "watch",
    *ABOVE_DOLFINX,
}
FROM_THE_DISTRIBUTION = {"basix", "dolfinx", "mpi4py", "petsc4py", "slepc4py", "ufl"}
PART_OF = {  # modules that another distribution pins and brings
    "llvmlite": "numba",
    "pydantic_core": "pydantic",
}
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


def own(names: Iterable[str]) -> set[str]:
    """Return the modules of the package among imported names."""
    parts = (name.split(".") for name in names)
    second = {name[1] if len(name) > 1 else "__init__" for name in parts if name[0] == "delam_fem"}
    return {name if name in SOURCES else "__init__" for name in second}


def at_the_top(module: str) -> list[str]:
    """Return the full names that importing `module` imports at once."""
    statements = [s for s in tree(module).body if isinstance(s, ast.Import | ast.ImportFrom)]
    return list(imported(ast.Module(statements, [])))


def reach(module: str, imports: dict[str, set[str]]) -> set[str]:
    """Return the modules that `module` imports, directly or through others, and itself."""
    found: set[str] = set()
    waiting = {module}
    while waiting:
        found |= waiting
        waiting = {name for m in waiting for name in imports[m]} - found
    return found


def test_every_module_has_its_row() -> None:
    assert set(ALLOWED) == set(SOURCES)


@pytest.mark.parametrize("module", SOURCES)
def test_imports_are_allowed(module: str) -> None:
    assert own(imported(tree(module))) <= ALLOWED.get(module, set())


@pytest.mark.parametrize(("some", "others"), STRANGERS)
def test_strangers_do_not_reach_each_other(some: set[str], others: set[str]) -> None:
    imports = {module: own(imported(tree(module))) - {"__init__"} for module in SOURCES}
    assert {(a, b) for a in some for b in reach(a, imports) & others} == set()


@pytest.mark.parametrize(
    ("libraries", "users"),
    [({"dolfinx", "ufl", "basix"}, ABOVE_DOLFINX), ({"petsc4py", "mpi4py"}, ABOVE_PETSC)],
)
def test_pure_part_needs_no_dolfinx_and_no_petsc(libraries: set[str], users: set[str]) -> None:
    names = {module: at_the_top(module) for module in SOURCES}
    imports = {module: own(names[module]) - {"__init__"} for module in SOURCES}
    direct = {m for m in SOURCES if libraries & {name.split(".")[0] for name in names[m]}}
    assert {m for m in SOURCES if reach(m, imports) & direct} <= users


def test_only_one_file_imports_dolfinx() -> None:
    users = {
        module
        for module in SOURCES
        if {"dolfinx", "basix"} & {name.split(".")[0] for name in imported(tree(module))}
    }
    assert users == {"_dolfinx"}


@pytest.mark.parametrize("module", sorted(set(SOURCES) - {"_dolfinx"}))
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


@pytest.mark.parametrize("module", sorted(set(SOURCES) - {"_dolfinx"}))
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


def test_readme_maps_every_module() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| *(`\w+\.py`[^|]*)\| *\S", readme, flags=re.MULTILINE)
    mapped = sorted(name for row in rows for name in re.findall(r"`(\w+\.py)`", row))
    assert mapped == sorted(path.name for path in SOURCES.values())


def text_files(folder: Path) -> Iterator[Path]:
    """Yield the project's own text files below a folder."""
    for path in sorted(folder.iterdir()):
        if path.is_dir() and not NOT_OURS.fullmatch(path.name):
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
