"""The contexts in which libraries are imported leave nothing behind."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module, metadata
from pathlib import Path
from types import ModuleType

import pytest

from delam_fem.api import added
from delam_fem.system import imports
from delam_fem.system.imports import Within, elsewhere


def test_the_working_folder_is_left_and_found_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "own"
    folder.mkdir()
    monkeypatch.chdir(folder)
    handles = len(os.listdir("/proc/self/fd"))
    with pytest.raises(KeyError), elsewhere():
        assert Path.cwd() == Path("/")
        folder.rename(tmp_path / "renamed")  # it is the same folder still
        raise KeyError
    assert Path.cwd() == tmp_path / "renamed"
    assert len(os.listdir("/proc/self/fd")) == handles


def test_variables_are_added_where_there_are_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DF_ONE", "own")
    monkeypatch.delenv("DF_TWO", raising=False)
    monkeypatch.delenv("DF_THREE", raising=False)
    with pytest.raises(KeyError), added({"DF_ONE": "1", "DF_TWO": "2", "DF_THREE": "3"}):
        assert [os.environ[f"DF_{name}"] for name in ("ONE", "TWO", "THREE")] == ["own", "2", "3"]
        del os.environ["DF_THREE"]
        raise KeyError
    assert os.environ["DF_ONE"] == "own"
    assert "DF_TWO" not in os.environ and "DF_THREE" not in os.environ


def test_a_stand_in_tells_versions_for_the_time_of_an_import(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delitem(sys.modules, "pkg_resources", raising=False)
    with pytest.raises(KeyError), imports._versions_from_metadata():
        distribution = sys.modules["pkg_resources"].get_distribution("numpy")
        assert distribution.version == metadata.version("numpy")
        raise KeyError
    assert "pkg_resources" not in sys.modules
    there = ModuleType("pkg_resources")
    monkeypatch.setitem(sys.modules, "pkg_resources", there)
    with imports._versions_from_metadata():
        assert sys.modules["pkg_resources"] is there
    assert sys.modules["pkg_resources"] is there


def test_a_package_is_imported_within_its_context(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its modules as well; not a package whose name begins alike."""
    depth: list[bool] = []
    events: list[str] = []

    @contextmanager
    def context() -> Iterator[None]:
        depth.append(True)
        try:
            yield
        finally:
            depth.pop()
            events.append("left")

    for name in ("df_inside", "df_inside_not"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("import sys\nDEPTH = len(sys.df_depth)\n")
        (tmp_path / name / "part.py").write_text("import sys\nDEPTH = len(sys.df_depth)\n")
    monkeypatch.setattr(sys, "df_depth", depth, raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "meta_path", [Within("df_inside", context), *sys.meta_path])
    try:
        assert import_module("df_inside").DEPTH == 1
        assert import_module("df_inside.part").DEPTH == 1
        assert import_module("df_inside_not").DEPTH == 0
        assert import_module("df_inside_not.part").DEPTH == 0
        assert events == ["left", "left"] and depth == []
        assert Within("df_inside", context).find_spec("df_inside_not") is None
        assert Within("df_missing", context).find_spec("df_missing") is None
    finally:
        for name in [name for name in sys.modules if name.startswith("df_inside")]:
            del sys.modules[name]


def test_symbols_stay_local_within_the_context_alone() -> None:
    import llvmlite.binding

    flags, loader = sys.getdlopenflags(), llvmlite.binding.load_library_permanently
    setter = sys.setdlopenflags
    with imports._symbols_stay_local():
        sys.setdlopenflags(os.RTLD_GLOBAL | os.RTLD_NOW)
        llvmlite.binding.load_library_permanently("/nowhere.so")
        assert sys.getdlopenflags() == flags
    assert sys.setdlopenflags is setter
    assert llvmlite.binding.load_library_permanently is loader
