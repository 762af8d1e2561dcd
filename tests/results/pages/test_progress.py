"""A bar in a cell of a notebook, executed by a real kernel; a bar of the terminal elsewhere."""

import asyncio
import re

import nbformat
import pytest
from nbclient import NotebookClient

from delam_fem.results.pages.html import reporting

CELL = """
import warnings
warnings.simplefilter("ignore")
import delam_fem as df
case = df.preset("paper", {"mesh.elements": 4, "time.steps_per_period": 60, "time.periods": 12})
result = df.run(case, progress=True)
"""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # Jupyter's own
def test_a_notebook_shows_a_bar_a_result_and_a_table() -> None:
    cells = [CELL, "result", "result.groups['events'].to_dataframe().columns.size", "case"]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(c) for c in cells])
    kernel = {"kernel_name": "python3", "timeout": 120}
    client = NotebookClient(notebook, **kernel, extra_arguments=[])
    asyncio.run(client.async_execute())
    ran, result_cell, table, case = (cell.outputs for cell in notebook.cells)
    bar = "".join(o["text"] for o in ran if o.get("name") == "stdout")
    assert re.match(r"100%.* 12/12 \[.* periods/s\]", bar.rsplit("\r", 1)[-1])
    assert "<td>outcome</td><td>completed</td>" in result_cell[0]["data"]["text/html"]
    assert int(table[0]["data"]["text/plain"]) >= 4
    assert case[0]["data"]["text/html"].startswith("<pre>")


def test_a_terminal_has_a_bar_of_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    with reporting(True, "point") as report:
        assert report is not None
        report(1, 2)
        report(2, 2)
    assert "points" in capsys.readouterr().err


def test_a_function_is_called_and_nothing_stays_nothing() -> None:
    calls: list[tuple[int, int]] = []
    with reporting(lambda *given: calls.append(given), "run") as report:
        assert report is not None
        report(3, 7)
    assert calls == [(3, 7)]
    for nothing in (None, False):
        with reporting(nothing, "run") as report:
            assert report is None
