"""A program that fails ends its processes and says why; the next one finds new ones."""

import pytest
from mpi_pool import Crew


@pytest.mark.mpi
@pytest.mark.nightly
def test_a_failure_of_one_rank_is_told_and_the_next_program_runs(crew: Crew) -> None:
    with pytest.raises(AssertionError, match=r"comm\.rank == 0[\s\S]*ZeroDivisionError"):
        crew.run(2, "if comm.rank == 0: comm.Barrier()\n1 / int(comm.rank == 0)")
    with pytest.raises(AssertionError, match="a process has ended"):
        crew.run(3, "import os\nif comm.rank == 1: os._exit(3)")
    crew.run(2, "assert comm.allgather(comm.rank) == [0, 1] and arguments == ['a']", "a")
