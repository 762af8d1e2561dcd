"""Commands of several processes of MPI: those that do not share their work say why."""

from pathlib import Path

import pytest
from mpi_pool import Crew

START = """
from pathlib import Path
import numpy as np
from delam_fem.cli import console
from delam_fem.cli.app import app
from delam_fem.model import factors

factors.LARGE = 100
console.launched = lambda: comm if comm.size > 1 else None


def call(*words):
    return app([str(word) for word in words], standalone_mode=False) or 0


folder, = arguments
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


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("words", "is_cases"),
    [
        (["sweep", "none.toml"], True),
        (["converge", "default"], True),
        (["orbit", "find", "default"], False),
        (["reduce", "default"], False),
        (["modes", "default"], False),
    ],
)
def test_other_commands_refuse_ranks(
    words: list[str], is_cases: bool, crew: Crew, tmp_path: Path
) -> None:
    crew.run(2, START + REFUSED.format(words=words, is_cases=is_cases), tmp_path)
