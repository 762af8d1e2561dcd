"""Hostile inputs with a fixed seed, and what the package makes of them.

`attempt` may accept an input or refuse it by a `CaseError` of a few lines. Anything else is a
defect: another exception, a warning, a long message, or no end. Run as a program, this module
attempts a share of the inputs of some kinds and prints the counts; a crash inside a library then
ends only that process.
"""

from __future__ import annotations

import json
import random
import signal
import sqlite3
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from delam_fem.api import Case, CaseError, load_case, preset, require_affordable, run_cost
from delam_fem.case.files import preset_text
from delam_fem.case.toml import parse_override

SEED = 20261121
SECONDS = 60
"""Time after which an input counts as one without end; machines may be busy [s]."""
MOST_LINES = 10
"""Number of lines of a message."""
ROOT = Path(__file__).parents[2]

NUMBERS = (
    "0", "-1", "1e-200", "1e200", "1e-30", "1e30", "1e-160", "1e6", "1e12", "nan", "inf", "-inf",
    "1e400", "5e-324", "9" * 30, "1" * 5000, "0x" + "f" * 5000, "1_000_000_000", "1000000000",
    "3", "0.5", "2.5e-3", "100000", "-0.0", "9223372036854775807",
)  # fmt: skip
WORDS = (
    "", "true", "'x'", '"\\u0000"', "[" * 5000, "[" * 30 + "]" * 30, "[]", "{}", "{a=1}", "[1,2]",
    "{" + ".".join("a" * 5000) + "=1}", "'newton'", "penalty", "none", "1979-05-27", "'a'\nb=1",
    "/etc/passwd", "/dev/zero", "/", "'../../x'", "é", "\ud800", '"' + "a" * 5000 + '"', "=",
    "\x1b[31m",
)  # fmt: skip
KEYS = (
    "name", "lamina.thick.length", "lamina.thin.length", "lamina.1.width", "lamina.thick.thickness",
    "lamina.thin.density", "lamina.2.young_modulus", "lamina.thick.bending_stiffness",
    "lamina.thin.damping_ratio", "gap.tip", "gap.exponent", "gap.shape", "gap.file",
    "mesh.elements", "mesh.file", "damping.rayleigh", "excitation.kind", "excitation.frequency",
    "excitation.amplitude", "contact.law", "contact.impulse", "contact.restitution",
    "contact.penalty_stiffness", "contact.penalty_damping", "contact.threshold_velocity",
    "time.scheme", "time.mass", "time.steps_per_period", "time.periods", "time.refine",
    "output.window_periods", "output.fields_per_period", "support.start", "support.end",
    "contact.points_per_element", "lamina.3.length", "lamina", "lamina.thick", "x", ".", "..",
    "a.b.c", "time", "time.periods.x", "lamina.thick.name", "é.ü", "=", "", " ", "a" * 5000,
    ".".join("a" * 5000),
)  # fmt: skip


def damaged(rng: random.Random, content: bytes) -> bytes:
    """Return a content with damage: cut, changed, repeated, moved, or replaced."""
    text = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 2, 5))):
        if not text:
            break
        i = rng.randrange(len(text))
        j = min(len(text), i + rng.choice((1, 4, 30, 400)))
        way = rng.randrange(8)
        if way == 0:
            del text[i:]
        elif way == 1:
            del text[i:j]
        elif way == 2:
            text[i] = rng.randrange(256)
        elif way == 3:
            text[i] ^= 1 << rng.randrange(8)
        elif way == 4:
            text[i:i] = text[i:j] * rng.choice((1, 3, 50))
        elif way == 5:
            text[i:j] = bytes(j - i)
        elif way == 6:
            text[i:j] = rng.randbytes(j - i)
        else:
            text[i:i] = rng.choice((*NUMBERS, *WORDS)).encode("utf-8", "surrogatepass")
    return bytes(text)


def replaced_numbers(rng: random.Random, text: str) -> str:
    """Return a text with one of its numbers or words replaced by a hostile one."""
    lines = text.split("\n")
    places = [k for k, line in enumerate(lines) if "=" in line or "," in line]
    k = rng.choice(places)
    separator = "=" if "=" in lines[k] else ","
    head, _, _ = lines[k].partition(separator)
    lines[k] = f"{head}{separator} {rng.choice((*NUMBERS, *WORDS))}"
    return "\n".join(lines)


def toml(rng: random.Random, text: str) -> bytes:
    """Return a damaged TOML text, sometimes in the encodings of other systems."""
    if rng.random() < 0.6:
        for _ in range(rng.choice((1, 1, 2))):
            text = replaced_numbers(rng, text)
        content = text.encode("utf-8", "surrogatepass")
    else:
        content = damaged(rng, text.encode())
    return rng.choice((b"", b"", b"", b"\xef\xbb\xbf", b"\xff\xfe")) + content


def usable(case: Case) -> None:
    """Go as far with a case as a command does before it computes."""
    from delam_fem.api import assemble, node_coordinates

    require_affordable(run_cost(case, "petsc"), "case", is_confirmed=False)
    if case.mesh.file is not None:
        node_coordinates(case)
    elif (case.mesh.elements or 0) <= 50:
        assemble(case, needs_dolfinx=False)


def a_case(rng: random.Random, folder: Path) -> None:
    """Read a damaged case file."""
    path = folder / "case.toml"
    path.write_bytes(toml(rng, preset_text(rng.choice(("paper", "default")))))
    usable(load_case(path))


def an_override(rng: random.Random, folder: Path) -> None:
    """Override keys by hostile values, as `--set` does."""
    texts = [
        f"{rng.choice(KEYS)}{rng.choice(('=', '=', '=', '=', ''))}{rng.choice((*NUMBERS, *WORDS))}"
        for _ in range(rng.choice((1, 1, 2)))
    ]
    usable(preset("paper", dict(parse_override(text) for text in texts)))


SWEEP = """name = "s"
base = "paper"
order = "independent"
[set]
"time.periods" = 20
[initial]
thick.displacement = 0.001
[[axis]]
key = "excitation.frequency"
start = 1.0
stop = 4.0
count = 7
[[axis]]
key = "contact.restitution"
values = [0.0, 0.1]
[record]
strobes = 5
harmonics = 3
"""


def a_sweep(rng: random.Random, folder: Path) -> None:
    """Read a damaged sweep file."""
    from delam_fem import load_sweep
    from delam_fem.studies.sweeps.run import require_computable

    path = folder / "s.toml"
    path.write_bytes(toml(rng, SWEEP))
    sweep = load_sweep(path)
    if (sweep.base.mesh.elements or 0) <= 50:
        require_computable(sweep, "serial", 1, is_confirmed=False)


def a_table(rng: random.Random, folder: Path) -> None:
    """Read a damaged table of a gap or of an excitation."""
    from delam_fem.case.excitation import read_series
    from delam_fem.case.gap import read_gap_table

    rows = [f"{0.685 * k / 9!r}, {0.012 * (k / 9) ** 2!r}" for k in range(10)]
    content = ("x [m], gap [m]\n# measured\n" + "\n".join(rows)).encode()
    if rng.random() < 0.4:
        content = replaced_numbers(rng, content.decode()).encode("utf-8", "surrogatepass")
    else:
        content = damaged(rng, content)
    path = folder / "gap.csv"
    path.write_bytes(content.replace(b"\n", rng.choice((b"\n", b"\r\n"))))
    if rng.random() < 0.7:
        read_gap_table(path, 0.685)
    else:
        read_series(path, "base")


def a_mesh(rng: random.Random, folder: Path) -> None:
    """Read a damaged mesh."""
    from delam_fem.api import node_coordinates

    path = folder / f"mesh{rng.choice(('.msh', '.msh', '.vtk', '.vtu', '.xdmf', '.mdpa'))}"
    path.write_bytes(damaged(rng, mesh_content(path.suffix)))
    node_coordinates(preset("paper", {"mesh.file": str(path)}))


def a_solid_mesh(rng: random.Random, folder: Path) -> None:
    """Assemble solids from a damaged mesh."""
    from delam_fem.api import assemble

    dim = rng.choice(("plane", "plane", "solid"))
    path = folder / "solid.msh"
    path.write_bytes(damaged(rng, (ROOT / "meshes" / "solids" / f"{dim}_strips.msh").read_bytes()))
    kind = {"plane": "plane-stress", "solid": "solid"}[dim]
    assemble(preset("paper", {"mesh.elements": None, "mesh.file": str(path), "model.kind": kind}))


_MESHES: dict[str, bytes] = {}


def mesh_content(suffix: str) -> bytes:
    """Return an intact mesh in a format."""
    import meshio

    if suffix not in _MESHES:
        source = ROOT / "meshes" / "laminae_graded.msh"
        content = source.read_bytes()
        if suffix in (".vtk", ".vtu", ".xdmf"):
            mesh = meshio.read(source, file_format="gmsh")
            lines, tags = mesh.cells_dict["line"], mesh.cell_data_dict["gmsh:physical"]["line"]
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / f"m{suffix}"
                options = {"data_format": "XML"} if suffix == ".xdmf" else {}
                meshio.Mesh(mesh.points, [("line", lines)], cell_data={"lamina": [tags]}).write(
                    path, **options
                )
                content = path.read_bytes()
        _MESHES[suffix] = content
    return _MESHES[suffix]


_WHOLE: dict[str, bytes] = {}


def a_journal(rng: random.Random, folder: Path) -> None:
    """Go on from a damaged journal of a sweep; the points it gives are those that were kept."""
    from delam_fem.api import State
    from delam_fem.studies.sweeps.journal import Journal
    from delam_fem.studies.sweeps.point import Chunk, ChunkResult, Point

    path = folder / "sweep.journal"
    if "journal" not in _WHOLE:
        with Journal(path, "sweep", resume=False) as journal:
            for first in range(0, 200, 20):
                numbers = tuple(range(first, first + 20))
                points = tuple(Point(k, "completed", "", np.arange(5.0) + k) for k in numbers)
                state = State(np.full((3, 8), first + 20.0), np.ones(4, dtype=np.bool_))
                journal.add([ChunkResult(Chunk(0, numbers), points, state, 1.0, 0.0)])
        (part,) = path.glob("*.points")
        _WHOLE["journal"] = part.read_bytes()
        part.unlink()
    path.mkdir(exist_ok=True)
    (path / "1-of-1.there.1.1.points").write_bytes(damaged(rng, _WHOLE["journal"]))
    with Journal(path, "sweep", resume=True) as journal, journal.merged() as merged:
        block = merged.block(0, 10**6, 5)
        assert np.array_equal(block.rows, block.numbers[:, None] + np.arange(5.0))
        n_done, state_found = merged.reached(np.arange(200), 0)
        assert set(range(n_done)) <= set(block.numbers.tolist())
        assert (state_found is None) == (n_done == 0)
        assert state_found is None or (state_found.motion == n_done).all()


def a_refinement(rng: random.Random, folder: Path) -> None:
    """Go on from the damaged file of a refinement; its levels are those that were kept."""
    from delam_fem.studies.convergence.analysis import Convergence
    from delam_fem.studies.convergence.level import LevelResult
    from delam_fem.studies.convergence.refinement import RefinementStudy, method
    from delam_fem.studies.convergence.run import RESULT, load_results, write_results

    path = folder / RESULT
    if "ladder" not in _WHOLE:
        refinement = RefinementStudy(preset("default"), (method("newton"),), (2, 4), (100, 200))
        results = {
            f"r{k}": LevelResult(f"r{k}", "completed", "", {"tip": (0.5 * k, 0.1)}, 1.5, 20)
            for k in range(12)
        }
        write_results(path, Convergence(refinement, results))
        _WHOLE["ladder"] = path.read_bytes()
    path.write_bytes(damaged(rng, _WHOLE["ladder"]))
    for key, result in load_results(folder / RESULT)[0].items():
        assert result.statistics == {"tip": (0.5 * int(key[1:]), 0.1)}


def a_sweep_result(rng: random.Random, folder: Path) -> None:
    """Draw the diagram of a damaged result of a sweep, up to the picture."""
    from delam_fem import run_sweep
    from delam_fem.studies.sweeps.dataset import open_result
    from delam_fem.studies.sweeps.grid import sweep_of
    from delam_fem.studies.sweeps.run import is_complete

    small = {"mesh.elements": 2, "time.steps_per_period": 20, "time.periods": 4}
    small["output.fields_per_period"] = 0
    axis = {"key": "excitation.frequency", "values": [3.0, 3.5]}
    about = {"name": "s", "base": "paper", "engine": "petsc"}
    sweep = sweep_of({**about, "set": small, "axis": [axis]})
    path = folder / "sweep.nc"
    if "sweep" not in _WHOLE:
        run_sweep(sweep, folder, "serial").close()
        _WHOLE["sweep"] = path.read_bytes()
    path.write_bytes(damaged(rng, _WHOLE["sweep"]))
    is_complete(folder, sweep)
    open_result(path, is_loaded=True).close()


def a_result(rng: random.Random, folder: Path) -> None:
    """Read the damaged result of a run, as `report` does."""
    from delam_fem.api import load_numbers
    from delam_fem.results.reading import is_complete

    case = preset("paper", SMALL)
    if "result" not in _WHOLE:
        import delam_fem as df

        df.run(case, "petsc").save_numbers(folder)
        _WHOLE["result"] = (folder / "result.nc").read_bytes()
        _WHOLE["summary"] = (folder / "summary.json").read_bytes()
        _WHOLE["case"] = (folder / "case.toml").read_bytes()
    contents = {name: _WHOLE[name] for name in ("result", "summary", "case")}
    name = rng.choice(("result", "result", "result", "summary"))
    contents[name] = damaged(rng, contents[name])
    for key, file in (("result", "result.nc"), ("summary", "summary.json"), ("case", "case.toml")):
        (folder / file).write_bytes(contents[key])
    is_complete(folder, case)
    load_numbers(folder)


SMALL = {
    "mesh.elements": 3, "time.periods": 2, "time.steps_per_period": 20,
    "output.fields_per_period": 4, "output.window_periods": 2,
}  # fmt: skip
SIZES = (
    "lamina.thick.length", "lamina.thick.width", "lamina.thick.thickness", "lamina.thin.density",
    "lamina.thin.young_modulus", "lamina.thick.bending_stiffness", "gap.tip", "gap.exponent",
    "excitation.frequency", "excitation.amplitude", "contact.penalty_stiffness",
    "contact.penalty_damping", "contact.threshold_velocity",
)  # fmt: skip
LAWS = ("none", "newton", "newton-penalty", "penalty", "newton@moreau-jean", "recovery@moreau-jean")


def a_run(rng: random.Random, folder: Path) -> None:
    """Compute a small case with sizes far from those of any beam."""
    import delam_fem as df
    from delam_fem.api import assemble

    keys: dict[str, object] = {**SMALL, "contact.law": rng.choice(LAWS)}
    for _ in range(rng.choice((1, 1, 2))):
        key = rng.choice(SIZES)
        keys[key] = 10.0 ** rng.uniform(*rng.choice(((-30, 30), (-8, 8))))
        if key == "lamina.thick.length":
            keys["lamina.thin.length"] = keys[key]
    case = preset("paper", keys)
    result = df.run(case, rng.choice(ENGINES), structure=assemble(case, needs_dolfinx=False))
    residual = result.summary["energy_residual"]
    if result.summary["outcome"] == "completed":
        assert residual is not None and residual < 1e-2, f"completed with residual {residual}"
        assert residual <= 1e-6 or result.summary["warnings"], "no warning"


ENGINES = ["petsc"]
"""Engines of the runs; the compiled one is compiled anew where the cache is empty."""

KINDS: dict[str, tuple[Callable[[random.Random, Path], None], int]] = {
    "case": (a_case, 400),
    "set": (an_override, 500),
    "sweep": (a_sweep, 250),
    "table": (a_table, 250),
    "mesh": (a_mesh, 250),
    "solid-mesh": (a_solid_mesh, 250),
    "journal": (a_journal, 150),
    "ladder": (a_refinement, 150),
    "sweep-result": (a_sweep_result, 100),
    "result": (a_result, 100),
    "run": (a_run, 60),
}
"""Functions that attempt an input, and how many of them the long form makes."""


class Endless(BaseException):
    """An input did not end in time; no handler of the package takes it for its own."""


def _stop(number: int, frame: object) -> None:
    raise Endless


def attempt(kind: str, number: int, folder: Path) -> str:
    """Attempt an input; return "accepted", "refused", or what went wrong."""
    rng = random.Random(f"{SEED} {kind} {number}")
    signal.alarm(SECONDS)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            KINDS[kind][0](rng, folder)
    except CaseError as error:
        lines = str(error).splitlines()
        return "refused" if len(lines) <= MOST_LINES else f"{len(lines)} lines"
    except Endless:
        return f"no end within {SECONDS} s"
    except (Exception, SystemExit) as error:
        return f"{type(error).__name__}: {str(error)[:150]}"
    finally:
        signal.alarm(0)
    return "accepted"


def attack(kind: str, count: int) -> dict[str, object]:
    """Attempt the first inputs of a kind; return counts and defects."""
    signal.signal(signal.SIGALRM, _stop)
    outcomes: Counter[str] = Counter()
    defects = []
    for number in range(count):
        with tempfile.TemporaryDirectory() as folder:
            outcome = attempt(kind, number, Path(folder))
        if outcome in ("accepted", "refused"):
            outcomes[outcome] += 1
        else:
            defects.append(f"{kind} {number}: {outcome}")
    return {"accepted": outcomes["accepted"], "refused": outcomes["refused"], "defects": defects}


if __name__ == "__main__":
    sqlite3.enable_callback_tracebacks(False)
    import logging

    logging.getLogger("delam_fem").addHandler(logging.NullHandler())
    logging.getLogger("delam_fem").propagate = False
    for kind in sys.argv[2:]:
        print(json.dumps(attack(kind, KINDS[kind][1] // int(sys.argv[1]))), flush=True)
