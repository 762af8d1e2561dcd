"""Commands of several processes of MPI: they share the factors of one solid, or say why not."""

from pathlib import Path

import pytest
from attack.processes import LIMIT, MPIRUN, command, ended, start
from mpi_pool import Crew

START = """
from pathlib import Path
import numpy as np
import delam_fem as df
from delam_fem.case.files import save_case
from delam_fem.cli import console
from delam_fem.cli.app import app

console.launched = lambda: comm if comm.size > 1 else None


def call(*words):
    return app([str(word) for word in words], standalone_mode=False) or 0


folder, = arguments
"""
REDUCE = """
alone = Path(folder, "alone")
case = df.preset("embedded", {"model.kind": "plane-stress", "mesh.elements": 16}).model_dump()
case["initial"] = [{"shape": "mode", "mode": 2, "velocity": 1e-3}]
case = [str(save_case(df.Case(**case), Path(folder, str(comm.rank)))), "-q"]
if comm.rank == 0:
    console.launched = lambda: None
    assert call("reduce", *case, "--modes", 5, "-o", alone) == 0
    console.launched = lambda: comm
comm.Barrier()
together = Path(folder, f"together{comm.size}")
assert call("reduce", *case, "--modes", 5, "-o", together) == 0
assert call("modes", *case, "-o", together / "modes") == 0
comm.Barrier()
if comm.rank == 0:
    one, many = (dict(np.load(path / "reduced.npz")) for path in (alone, together))
    assert np.allclose(many["squares"], one["squares"], rtol=1e-9), "squares"
    assert np.array_equal(many["reading_part"], one["reading_part"])
    for name in ("H", "probes", "readings", "base"):  # modes have any sign
        a, b = (content[name] for content in (one, many))
        flexible = [(x / content["squares"]) @ x.T for x, content in ((a, one), (b, many))]
        assert np.allclose(*flexible, rtol=0.0, atol=1e-9 * np.abs(flexible[0]).max()), name
    energies = [np.sum(content["start"][1] ** 2) for content in (one, many)]
    assert energies[0] > 0.0 and np.isclose(*energies, rtol=1e-8), energies
    assert (together / "modes" / "modes.json").exists()
"""
REFUSED = """
import io, sys
heard = sys.stderr = io.StringIO()
status = call(*{words!r}, "-o", Path(folder, "none"))
text = heard.getvalue()
sys.stderr = sys.__stderr__
if comm.rank == 0:
    assert status == 2 and f"given {{comm.size}}" in text, text
    assert ("-j" in text and "--shard" in text and "Dask" in text) == {is_cases}, text
else:
    assert (status, text) == (0, "")
assert not Path(folder, "none").exists()
"""
WRONG = """
import io, sys
heard = sys.stderr = io.StringIO()
status = call("reduce", *{words!r}, "-o", Path(folder, "none"))
text = heard.getvalue()
sys.stderr = sys.__stderr__
assert (status, text.count({key!r})) == ((2, 1) if comm.rank == 0 else (0, 0)), text
"""


BONDED = """
import json

keys = {"model.kind": "plane-stress", "mesh.elements": 16}
case = df.preset("embedded", keys).model_dump(mode="json", exclude_unset=True)
case = str(save_case(df.Case(**case | {"delamination": []}), Path(folder, str(comm.rank))))
found = []
for kind in ("free", "closed"):
    out = Path(folder, kind)
    assert call("modes", case, "-q", "-n", 3, "--delaminations", kind, "-o", out) == 0
    if comm.rank == 0:
        found.append(json.loads((out / "modes.json").read_text())["structure_frequency_hz"])
if comm.rank == 0:
    assert np.allclose(*found, rtol=1e-9) and found[0][0] > 1.0, found
"""


@pytest.mark.mpi
def test_what_is_bonded_everywhere_has_the_same_modes_kept_closed(
    crew: Crew, tmp_path: Path
) -> None:
    crew.run(2, START + BONDED, tmp_path)


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, pytest.param(3, marks=pytest.mark.nightly)])
def test_a_reduction_is_the_same_on_ranks(ranks: int, crew: Crew, tmp_path: Path) -> None:
    crew.run(ranks, START + REDUCE, tmp_path)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("words", "is_cases"),
    [
        (["sweep", "none.toml"], True),
        (["converge", "default"], True),
        (["orbit", "find", "default"], False),
    ],
)
def test_other_commands_refuse_ranks(
    words: list[str], is_cases: bool, crew: Crew, tmp_path: Path
) -> None:
    crew.run(2, START + REFUSED.format(words=words, is_cases=is_cases), tmp_path)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("words", "key"),
    [
        (["paper"], "contact.impulse"),
        (["embedded", "--set", "model.kind=plane-stress", "--coordinates", 1], "coordinates: exp"),
    ],
)
def test_an_error_is_told_once(words: list[object], key: str, crew: Crew, tmp_path: Path) -> None:
    """Before the ranks begin together, and in what all do."""
    crew.run(2, START + WRONG.format(words=words, key=key), tmp_path)


@pytest.mark.mpi
@pytest.mark.parametrize(("preset", "status"), [("embedded", 0), ("paper", 2)])
def test_processes_of_a_reduction_end(preset: str, status: int, tmp_path: Path) -> None:
    """The first process alone imports dolfinx, which must not add to what all do at their end."""
    keys = {"model.kind": "plane-stress", "mesh.elements": 16}
    line = command("reduce", preset, "-o", tmp_path / "out", "--modes", 5, keys=keys)
    returned, errors = ended([*MPIRUN, *line])
    assert (returned, errors.count("contact.impulse: expected")) == (status, int(preset == "paper"))
    assert "MPI_ABORT" not in errors


@pytest.mark.mpi
@pytest.mark.slow
def test_the_first_process_of_a_run_alone_speaks(tmp_path: Path) -> None:
    """Before the run begins: a warning of the case, and the table of what it would be."""
    keys = {"model.kind": "plane-stress", "mesh.elements": 4, "contact.impulse": "consistent",
            "excitation.amplitude": 2.5}  # fmt: skip
    line = command("run", "paper", "-o", tmp_path / "out", "--dry-run", keys=keys)
    process = start([*MPIRUN, *line])
    table, errors = process.communicate(timeout=LIMIT)
    assert process.returncode == 0, errors
    assert errors.count("excitation.amplitude = 2.5 m") == 1, errors
    assert table.count("unknowns") == 1
    assert not (tmp_path / "out").exists()
