"""Damaged and forged files of ours with a fixed seed, and what the readers make of them.

A damaged file has changed, cut or repeated bytes. A forged one is whole and has a right digest, but
its content is not what the readers expect: a variable is gone, has another shape, type or unit, or
holds numbers that are not finite. Run as a program, this module attempts a share of all files, in
one process for each kind, and prints the counts.
"""

from __future__ import annotations

import hashlib
import json
import logging
import random
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from attack.hostile import Endless, damaged
from project import peak_memory

import delam_fem as df
from delam_fem import read_measured
from delam_fem.api import CaseError, load_numbers, read_arrays, write_arrays, write_dataset
from delam_fem.results.diagnostics import summary as summary_of
from delam_fem.results.export import export
from delam_fem.results.fields.vtkhdf import Series
from delam_fem.results.figures.run import save_figures
from delam_fem.results.netcdf import read_dataset
from delam_fem.results.pages.report import of_result
from delam_fem.results.reading import OF_SUMMARY

SEED = 20261127
SECONDS = 5.0
"""Processor time after which a file counts as a hang [s]."""
SMALL = {
    "mesh.elements": 4, "time.periods": 4, "time.steps_per_period": 40,
    "output.fields_per_period": 4, "output.window_periods": 2,
}  # fmt: skip
_made: dict[str, Any] = {}


def run_of(kind: str) -> Path:
    """Return the folder of a small run, of beams or of a solid."""
    if kind not in _made:
        keys = SMALL | ({} if kind == "beam" else {"model.kind": kind, "mesh.elements": 6})
        folder = Path(tempfile.mkdtemp())
        df.run(df.preset("paper", keys), "petsc").save(folder, figures=False)
        _made[kind] = folder
    return Path(_made[kind])


def copied(source: Path, folder: Path) -> None:
    """Copy the numbers of a run."""
    for name in ("case.toml", "result.nc", "summary.json", "state.npz"):
        (folder / name).write_bytes((source / name).read_bytes())


def use(folder: Path, rng: random.Random) -> None:
    """Use the result of a run as the commands do: read, compute, draw, write."""
    case, history, summary = load_numbers(folder)
    way = rng.randrange(6)
    if way == 0:
        of_result(history, summary, case)
    elif way == 1:
        save_figures(history, case, folder / "figures")
    elif way == 2:
        export(history, case, "csv", folder / "a.csv")
    elif way == 3:
        export(history, case, "vtkhdf", folder / "a.vtkhdf")
    elif way == 4:
        export(history, case, "mat", folder / "a.mat")
    else:
        summary_of(history, case)


def a_damaged_result(rng: random.Random, folder: Path) -> None:
    """Use a result of which one file has other bytes."""
    copied(run_of("beam"), folder)
    path = folder / rng.choice(("result.nc", "result.nc", "summary.json", "case.toml"))
    path.write_bytes(damaged(rng, path.read_bytes()))
    use(folder, rng)


def a_forged_result(rng: random.Random, folder: Path) -> None:
    """Use a result with a right digest and another content."""
    copied(run_of("beam"), folder)
    data = forged(rng, read_dataset(folder / "result.nc"))
    write_dataset(data, folder / "result.nc")
    use(folder, rng)


def forged(rng: random.Random, data: xr.Dataset) -> xr.Dataset:
    """Return a dataset of which something is changed."""
    name = rng.choice(sorted(map(str, data.variables)))
    variable = data[name]
    way = rng.randrange(11)
    if way == 0:
        return data.drop_vars(name)
    if way == 1 and variable.dims and name not in variable.dims:  # no dataset has such a name
        return data.drop_vars(name).assign({name: variable[0].drop_vars(variable[0].coords)})
    if way == 2 and variable.dims:
        return data.isel({variable.dims[0]: slice(0, rng.choice((0, 1)))})
    if way == 3:
        return data.assign({name: (variable.dims, np.full(variable.shape, "text"))})
    if way == 4 and variable.dtype.kind in "fiu":
        hostile = rng.choice((np.nan, np.inf, 1e300, -1e9))
        return data.assign({name: (variable.dims, np.full(variable.shape, hostile))})
    if way == 5 and variable.dtype.kind in "iu":
        return data.assign({name: (variable.dims, variable.values + rng.choice((-99, 99)))})
    if way == 6:
        return data.rename({name: f"{name}_"})
    if way == 7:
        key = rng.choice(sorted(map(str, data.attrs)))
        return data.assign_attrs({key: rng.choice((3, "", "\x1b[31m", [1.0, 2.0], "[" * 5000))})
    if way == 8:
        key = rng.choice(sorted(map(str, data.attrs)))
        return data.drop_attrs(deep=False).assign_attrs(
            {k: v for k, v in data.attrs.items() if k != key}
        )
    if way == 9:
        changed = data.copy()
        changed[name].attrs = {"units": 3}
        return changed
    return data.assign({f"more_{name}": variable})


SUMMARIES = ("[]", "3", '"a"', "{}", "null", "[" * 9999, "1e999")
"""Hostile values of summaries."""


def a_forged_summary(rng: random.Random, folder: Path) -> None:
    """Use a result whose summary has another form."""
    copied(run_of("beam"), folder)
    path = folder / "summary.json"
    if rng.random() < 0.2:
        path.write_text(rng.choice(SUMMARIES))
    else:
        content = json.loads(path.read_text())
        value = rng.choice(
            (None, [], {}, "a", 3, [1, 2, 3], [None], {"a": []}, [[1]], True, "x" * 999)
        )
        content[rng.choice(sorted(content))] = value
        if rng.random() < 0.3:
            content["settling"] = {rng.choice(("decay", "transient")): value}
        path.write_text(json.dumps(content))
    data = read_dataset(folder / "result.nc")
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    write_dataset(data.assign_attrs({OF_SUMMARY: digest}), folder / "result.nc")
    use(folder, rng)


def a_solid(rng: random.Random, folder: Path) -> None:
    """Read the damaged fields of a solid."""
    content = (run_of("plane-stress") / "fields" / "solid.vtkhdf").read_bytes()
    path = folder / "solid.vtkhdf"
    path.write_bytes(damaged(rng, content))
    series = Series.read(path)
    for name in series.names:
        series.field(name, rng.randrange(series.times.size))
    assert series.thickness >= 0.0


def a_state(rng: random.Random, folder: Path) -> None:
    """Extend a run from a damaged or a forged final state."""
    copied(run_of("beam"), folder)
    path = folder / "state.npz"
    if rng.random() < 0.5:
        path.write_bytes(damaged(rng, path.read_bytes()))
    else:
        arrays = read_arrays(path)
        name = rng.choice(sorted(arrays))
        values = arrays[name]
        change = rng.randrange(5)
        if change == 0:
            del arrays[name]
        elif change == 1:
            arrays[name] = np.concatenate([np.atleast_1d(values), np.atleast_1d(values)])
        elif change == 2:
            arrays[name] = np.full(values.shape, "text")
        elif change == 3:
            arrays[name] = np.atleast_1d(values)[:0]
        else:
            arrays[name] = np.full(values.shape, 10**6)
        write_arrays(path, arrays)
    df.run(folder / "case.toml", "petsc", directory=folder, extend=1, structure=None)


def a_measurement(rng: random.Random, folder: Path) -> None:
    """Read a damaged measurement of ours."""
    if "measured" not in _made:
        path = Path(tempfile.mkdtemp()) / "a.csv"
        path.write_text("time [s],a [mm]\n" + "".join(f"{k / 10},{k % 7}\n" for k in range(60)))
        from delam_fem.studies.signals.writing import write_measured

        _made["measured"] = write_measured(read_measured(path), path.with_name("measured.nc"))
    path = folder / "measured.nc"
    if rng.random() < 0.5:
        path.write_bytes(damaged(rng, _made["measured"].read_bytes()))
    else:
        write_dataset(forged(rng, read_dataset(_made["measured"])), path)
    from delam_fem.studies.signals.reading import lines, rows

    data = read_measured(path)
    list(rows(data))
    list(lines(data))


def a_reduction(rng: random.Random, folder: Path) -> None:
    """Assemble a damaged or forged reduced model."""
    from delam_fem.api import assemble, reduced_case

    if "reduced" not in _made:
        case = df.preset("paper", {**SMALL, "contact.impulse": "consistent"})
        target = Path(tempfile.mkdtemp())
        reduced_case(case, 3).save(target)
        _made["reduced"] = target
    for path in _made["reduced"].iterdir():
        content = path.read_bytes()
        (folder / path.name).write_bytes(content)
    (path,) = folder.glob("*.npz")
    if rng.random() < 0.5:
        path.write_bytes(damaged(rng, path.read_bytes()))
    else:
        arrays = read_arrays(path)
        name = rng.choice(sorted(arrays))
        arrays[name] = rng.choice((arrays[name][..., None], np.zeros(3), np.array("text")))
        write_arrays(path, arrays)
    (toml,) = folder.glob("*.toml")
    assemble(df.load_case(toml))


KINDS: dict[str, tuple[Callable[[random.Random, Path], None], int]] = {
    "damaged results": (a_damaged_result, 500),
    "forged results": (a_forged_result, 500),
    "forged summaries": (a_forged_summary, 250),
    "fields of solids": (a_solid, 250),
    "final states": (a_state, 200),
    "measurements": (a_measurement, 200),
    "reduced models": (a_reduction, 150),
}
"""Functions that attempt a file, and how many of them the long form makes."""


def _stop(number: int, frame: object) -> None:
    raise Endless


def attempt(kind: str, number: int) -> str:
    """Attempt a file; return "accepted", "refused", or what went wrong."""
    rng = random.Random(f"{SEED} {kind} {number}")
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        signal.setitimer(signal.ITIMER_VIRTUAL, 4 * SECONDS)
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                KINDS[kind][0](rng, Path(folder))
            said = "accepted"
        except CaseError as error:
            said = "refused" if len(str(error).splitlines()) <= 10 else "many lines"
        except Endless:
            return "no end"
        except (Exception, SystemExit) as error:
            said = f"{type(error).__name__}: {str(error)[:150]}"
        finally:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0)
    taken = time.process_time() - begin
    return f"{taken:.1f} s" if taken > SECONDS else said


def attack(kind: str, count: int) -> dict[str, object]:
    """Attempt the first files of a kind; return counts, defects and the memory of the process."""
    signal.signal(signal.SIGVTALRM, _stop)
    _warm(kind)
    counts: Counter[str] = Counter()
    defects = []
    for number in range(count):
        said = attempt(kind, number)
        counts[said] += 1
        if said not in ("accepted", "refused"):
            defects.append(f"{kind} {number}: {said}")
    return {
        "kind": kind,
        "accepted": counts["accepted"],
        "refused": counts["refused"],
        "memory": peak_memory(),
        "defects": defects,
    }


def _warm(kind: str) -> None:
    """Make what the files are copies of, which takes longer than any of them."""
    run_of("plane-stress" if kind == "fields of solids" else "beam")


if __name__ == "__main__":
    logging.getLogger("delam_fem").addHandler(logging.NullHandler())
    logging.getLogger("delam_fem").propagate = False
    for kind in sys.argv[2:] or KINDS:
        print(json.dumps(attack(kind, KINDS[kind][1] // int(sys.argv[1]))), flush=True)
