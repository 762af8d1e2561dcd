"""The schema says all names: the code reads no others, and the documentation shows them."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from project import ROOT
from synthetic import small_case, synthetic_history

import delam_fem as df
from delam_fem.api import schema
from delam_fem.studies.orbits.follow import VARIABLES as OF_BRANCHES
from delam_fem.studies.signals.reading import BESIDES
from delam_fem.studies.sweeps.point import VARIABLES as OF_SWEEPS

SOURCES = sorted((ROOT / "delam_fem").rglob("*.py"))
DATASET = re.compile(r"\b(xr|xarray)\.Dataset\b")
SELECTING = {"isel", "sel", "copy", "load", "set_coords", "assign_coords"}
"""Methods that return a dataset with the same variables."""
MAKING = {"xr.Dataset", "dataset.history"}
"""Functions that return a dataset."""
OF_ORBITS = {*OF_BRANCHES, *(dim for row in OF_BRANCHES.values() for dim in row.dims)}
OF_TRIALS = {"specimen", "hit", "overlap"}
"""Names in the dataset of `population.trials` that no file has."""
NAMES = {*schema.VARIABLES, *schema.DIMENSIONS, *OF_SWEEPS, *BESIDES, *OF_ORBITS, *OF_TRIALS}
DOCUMENT = ROOT / "docs" / "results.md"
MARKED = re.compile(r"<!-- (schema|summary) -->\n(.*?)\n<!-- end -->", re.DOTALL)


def functions(path: Path) -> Iterator[ast.FunctionDef]:
    """Yield the functions and methods of a file."""
    code = ast.parse(path.read_text("utf-8"))
    yield from (node for node in ast.walk(code) if isinstance(node, ast.FunctionDef))


def datasets(function: ast.FunctionDef) -> set[str]:
    """Return the names of arguments and variables that hold a dataset."""
    arguments = [*function.args.args, *function.args.kwonlyargs]
    names = {a.arg for a in arguments if a.annotation and DATASET.search(ast.unparse(a.annotation))}
    for _ in range(2):  # a variable may come from another one
        for node in ast.walk(function):
            if isinstance(node, ast.Assign):
                names |= {
                    target.id
                    for target, value in assigned(node)
                    if isinstance(target, ast.Name) and is_dataset(value, names)
                }
    return names


def assigned(node: ast.Assign) -> Iterator[tuple[ast.expr, ast.expr]]:
    """Yield targets and values of an assignment, those of tuples one by one."""
    (target, *_), value = node.targets, node.value
    if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
        if not any(isinstance(part, ast.Starred) for part in (*target.elts, *value.elts)):
            yield from zip(target.elts, value.elts, strict=True)
    else:
        yield target, value


def is_dataset(node: ast.AST, known: set[str]) -> bool:
    """Say whether an expression is a dataset, where the code alone tells."""
    if isinstance(node, ast.Name):
        return node.id in known
    if isinstance(node, ast.Attribute):
        return node.attr == "history"
    if isinstance(node, ast.Call):
        called = node.func
        name = getattr(called, "attr", getattr(called, "id", ""))
        if name in ("last_periods", "drawable_frames") or ast.unparse(called) in MAKING:
            return True
        if name in SELECTING and isinstance(called, ast.Attribute):
            return is_dataset(called.value, known)
    return False


def subscripts(function: ast.FunctionDef) -> Iterator[tuple[str, int]]:
    """Yield the string subscripts of datasets and their sizes, with the lines."""
    known = datasets(function)
    for node in ast.walk(function):
        if not isinstance(node, ast.Subscript) or not isinstance(node.slice, ast.Constant):
            continue
        value = node.value
        if isinstance(value, ast.Attribute) and value.attr in ("sizes", "dims", "variables"):
            value = value.value
        if isinstance(node.slice.value, str) and is_dataset(value, known):
            yield node.slice.value, node.lineno


def attributes(function: ast.FunctionDef) -> Iterator[tuple[str, int]]:
    """Yield the attributes of datasets, with the lines."""
    known = datasets(function)
    for node in ast.walk(function):
        if isinstance(node, ast.Attribute) and is_dataset(node.value, known):
            yield node.attr, node.lineno


@pytest.mark.slow
def test_datasets_are_read_by_names_of_the_schema() -> None:
    wrong, read = [], {}
    for path in SOURCES:
        for function in functions(path):
            wrong += [
                f"{path.relative_to(ROOT)}:{line} {name}"
                for name, line in subscripts(function)
                if name not in NAMES
            ]
            read |= {
                name: f"{path.relative_to(ROOT)}:{line}" for name, line in attributes(function)
            }
    assert wrong == []
    assert {name: read[name] for name in read if name in NAMES} == {}, "read them by subscript"
    assert {name: read[name] for name in read if not hasattr(xr.Dataset, name)} == {}


def test_the_search_finds_what_it_looks_for() -> None:
    text = """
def f(data: xr.Dataset, other: dict, result: Result):
    last = data.isel(time=-1)
    whole = diagnostics.last_periods(result.history, case)
    g(data["a"], last["b"], whole["c"], other["no"], result.history.sizes["d"], data.attrs["no"])
    return whole.e
"""
    (function,) = [n for n in ast.walk(ast.parse(text)) if isinstance(n, ast.FunctionDef)]
    assert sorted(name for name, _ in subscripts(function)) == ["a", "b", "c", "d"]
    assert "e" in {name for name, _ in attributes(function)}


def test_enough_of_the_code_is_searched() -> None:
    names = {name for path in SOURCES for f in functions(path) for name, _ in subscripts(f)}
    assert {"gap0", "contact_state", "event_node", "tip_node", "tip_amplitude", "frame"} <= names


def test_a_variable_outside_the_schema_is_refused() -> None:
    with pytest.raises(KeyError, match="no_such_name"):
        schema.add(xr.Dataset(), no_such_name=1.0)
    with pytest.raises(ValueError, match="tip_displacement"):
        schema.add(xr.Dataset(), tip_displacement=np.zeros(3))


def test_interfaces_come_first_also_if_there_is_one() -> None:
    history = synthetic_history(small_case())
    assert schema.by_interface(history["gap0"]).shape == (1, 6)
    assert schema.event_interfaces(history).tolist() == [0] * history.sizes["event"]


def table(*rows: tuple[str, ...]) -> str:
    """Return rows as a table of Markdown, the first as its heading."""
    heading, *body = (f"| {' | '.join(row)} |" for row in rows)
    return "\n".join([heading, "|" + "---|" * len(rows[0]), *body])


@pytest.mark.stored
def test_the_document_shows_the_schema(request: pytest.FixtureRequest) -> None:
    """`--store` writes the tables, as it writes texts of tests/golden."""
    dimensions = [(f"`{name}`", meaning) for name, meaning in schema.DIMENSIONS.items()]
    variables = [
        (f"`{row.name}`", ", ".join(row.dims) or "–", row.units, row.long_name)
        for row in schema.VARIABLES.values()
    ]
    measures = [
        (f"`{row.name}`", row.units if row.units not in ("", "1") else "–", row.long_name)
        for row in schema.MEASURES.values()
    ]
    of_dimensions = table(("dimension", "entries"), *dimensions)
    of_variables = table(("variable", "dimensions", "unit", "meaning"), *variables)
    expected = {
        "schema": f"{of_dimensions}\n\n{of_variables}",
        "summary": table(("entry", "unit", "meaning"), *measures),
    }
    text = DOCUMENT.read_text("utf-8")
    if request.config.getoption("store"):
        marked = [f"<!-- {name} -->\n{body}\n<!-- end -->" for name, body in expected.items()]
        DOCUMENT.write_text(MARKED.sub(lambda _: marked.pop(0), text), "utf-8")
        return
    tables = dict(MARKED.findall(text))
    assert tables == expected, "write them by -m stored --store"


def test_every_number_of_a_summary_is_a_measure() -> None:
    keys = {"time.periods": 1, "output.window_periods": 1, "output.fields_per_period": 0}
    summary = df.run(df.preset("paper", keys), "compiled").summary
    assert set(summary) | set(summary["settling"]) <= set(schema.MEASURES)
    for name, value in summary.items():
        dims = schema.MEASURES[name].dims
        assert np.ndim(value) in (0, len(dims)) and (dims != ("lamina",) or len(value) == 2), name


def test_a_measure_is_shown_in_units_that_people_read() -> None:
    units = {name: schema.MEASURES[name].shown for name in ("tip_min", "thd", "decay", "engine")}
    expected = {
        "tip_min": ("mm", 1e3),
        "thd": ("%", 100.0),
        "decay": ("", 1.0),
        "engine": ("", 1.0),
    }
    assert units == expected
