"""Options of PETSc before it is loaded, and how one rank ends all others."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import pytest

from delam_fem.api import CaseError
from delam_fem.system import mpi


@pytest.fixture
def unloaded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let PETSc look as if nobody had loaded it."""
    monkeypatch.setitem(sys.modules, "petsc4py.PETSc", None)
    words = "-newmark_ksp_type preonly -newmark_mass_pc_type lu -moreau_x -other 3 newmark_word"
    monkeypatch.setenv("PETSC_OPTIONS", words)


@pytest.mark.usefixtures("unloaded")
def test_an_option_belongs_to_the_first_prefix_that_it_starts_with() -> None:
    assert mpi.given_options("newmark_") == ["newmark_ksp_type"]
    assert mpi.given_options("newmark_mass_") == ["newmark_mass_pc_type"]
    assert mpi.given_options("moreau_") == ["moreau_x"]
    assert mpi.given_options() == ["newmark_ksp_type", "newmark_mass_pc_type", "moreau_x"]


@pytest.mark.usefixtures("unloaded")
def test_without_petsc_no_option_is_read() -> None:
    with pytest.raises(CaseError) as error:
        mpi.require_options_used()
    assert str(error.value) == (
        "PETSC_OPTIONS: -newmark_ksp_type, -newmark_mass_pc_type, -moreau_x: expected options that "
        "the solvers of this run read (docs/continuum.md has their prefixes); given, but read by "
        "none"
    )


def test_other_options_are_left_alone(unloaded: None, monkeypatch: pytest.MonkeyPatch) -> None:
    for words in ("", "-other 3 -log_view"):
        monkeypatch.setenv("PETSC_OPTIONS", words)
        mpi.require_options_used()
        assert mpi.given_options() == []


def test_an_uncaught_exception_ends_all_ranks_with_a_failure(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ended: list[int] = []
    comm: Any = SimpleNamespace(size=2, Abort=ended.append)
    monkeypatch.setattr(sys, "excepthook", sys.__excepthook__)
    mpi.end_with_any(SimpleNamespace(size=1, Abort=ended.append))  # type: ignore[arg-type]
    assert sys.excepthook is sys.__excepthook__
    mpi.end_with_any(comm)
    hook = sys.excepthook
    assert hook is not sys.__excepthook__
    mpi.end_with_any(comm)  # somebody else, or this function, shows exceptions already
    assert sys.excepthook is hook
    hook(ValueError, ValueError("why"), None)
    assert ended == [1]
    assert "ValueError: why" in capsys.readouterr().err


def test_a_single_rank_has_nothing_to_release(monkeypatch: pytest.MonkeyPatch) -> None:
    collected: list[int] = []
    monkeypatch.setattr(mpi.gc, "collect", lambda: collected.append(1))
    monkeypatch.setitem(sys.modules, "petsc4py", SimpleNamespace(PETSc=None))
    comm: Any = SimpleNamespace(size=1, Barrier=lambda: collected.append(2))
    mpi.release(comm)
    assert not collected
    comm.size = 2
    mpi.release(comm)
    assert collected == [1, 2]
