"""Read a case from a file or a preset, and save a case with the files that it names."""

from __future__ import annotations

import os
import shutil
import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import TypeAlias

from delam_fem.case.definition import Case
from delam_fem.case.identity import companions
from delam_fem.case.toml import Data, apply_overrides, read_toml, set_key, shown, toml_text
from delam_fem.system.errors import CaseError
from delam_fem.system.files import atomic, write_text
from delam_fem.system.written import OUTPUTS

CaseSource: TypeAlias = Case | str | Path
"""A case, the name of a preset, or the path of a case file."""
PRESETS = ("paper", "default", "embedded", "edge")
"""Names of the presets: the cases that come with the package."""


def find_case(what: CaseSource, overrides: Mapping[str, object] | None = None) -> Case:
    """Return a case from what names it: the case itself, the name of a preset, or a case file.

    Args:
        what: a case, the name of a preset, or the path of a case file.
        overrides: values by key (`excitation.frequency`, `lamina.thick.length`); None removes an
            optional key. File names are relative to the working directory.

    Raises:
        CaseError: there is no such preset or file, or the case is not valid.
    """
    if isinstance(what, Case):
        return what.with_overrides(overrides) if overrides else what
    path = Path(what)
    try:
        is_file = path.suffix == ".toml" or len(path.parts) > 1 or path.is_file()
    except OSError as error:
        raise CaseError(f"case {shown(what)}: cannot be read ({error.strerror})") from None
    if not is_file and what not in PRESETS:
        raise CaseError(
            f"case {shown(what)}: neither a file nor a preset; expected a case file (.toml) or one "
            f"of {', '.join(PRESETS)}"
        )
    return load_case(path, overrides) if is_file else preset(str(what), overrides)


def load_case(path: str | Path, overrides: Mapping[str, object] | None = None) -> Case:
    """Read a case file.

    Args:
        path: TOML file; relative file names in it are relative to its folder.
        overrides: values by key (`excitation.frequency`, `lamina.thick.length`); None removes an
            optional key. File names are relative to the working directory.

    Returns:
        The case.

    Raises:
        CaseError: the file is missing or is not TOML, or the case in it is not valid.
    """
    path = Path(path)
    data = read_toml(path)
    if "axis" in data:
        raise CaseError(f"case {path}: is a sweep; compute it with delam-fem sweep {path}")
    for tables in data.values():
        for table in tables if isinstance(tables, list) else [tables]:
            if not isinstance(table, dict):
                continue
            for key in ("file", "psd"):
                if isinstance(table.get(key), str):
                    table[key] = os.path.join(path.absolute().parent, table[key])
    return _case(data, overrides, f"case {path}")


def preset(name: str, overrides: Mapping[str, object] | None = None, **by_word: object) -> Case:
    """Return a preset, a case that comes with the package.

    Args:
        name: one of `PRESETS`.
        overrides: values by key (`excitation.frequency`, `lamina.thick.length`); None removes an
            optional key. File names are relative to the working directory.
        **by_word: values by the last part of a key, if one key alone of this case ends in it:
            `frequency=3.65`.

    Returns:
        The case.

    Raises:
        CaseError: there is no such preset, or an override is not valid.
    """
    case = _case(tomllib.loads(preset_text(name)), overrides, f"case {name}")
    return case.with_overrides(None, **by_word) if by_word else case


def preset_text(name: str) -> str:
    """Return the text of a preset's case file, comments included.

    Raises:
        CaseError: there is no such preset.
    """
    if name not in PRESETS:
        raise CaseError(f"preset {name!r}: unknown; expected one of {', '.join(PRESETS)}")
    return resources.files("delam_fem.case").joinpath(f"presets/{name}.toml").read_text("utf-8")


def _case(data: Data, overrides: Mapping[str, object] | None, label: str) -> Case:
    """Apply overrides to the dictionary of a case, and return the checked case."""
    apply_overrides(data, overrides or {})
    return Case.checked(data, label).with_files_checked(label)


def save_case(case: Case, directory: str | Path) -> Path:
    """Write a case and the files that it names to one folder.

    The folder is complete: the run can be repeated from it on any machine.

    Args:
        case: the case.
        directory: folder for the files; it is made if it does not exist.

    Returns:
        The path of `case.toml`; the file names in it are relative to the folder.

    Raises:
        OSError: the folder cannot be written, or a file of the case cannot be read.
    """
    directory = Path(directory)
    data = tomllib.loads(case.to_toml())
    taken: set[str] = set()
    for key, file in case.files.items():
        prefix = key.removesuffix(".file").replace(".", "-")
        is_free = file.name not in taken and file.name not in OUTPUTS
        name = file.name if is_free else f"{prefix}-{file.name}"
        taken.add(name)
        _copy(file, directory / name)
        set_key(data, key, name)
        for beside in companions(file):
            _copy(beside, directory / beside.name)
    return write_text(directory / "case.toml", toml_text(data))


def _copy(source: Path, target: Path) -> None:
    """Copy a file so that the target is never half-written."""
    if target.exists() and target.samefile(source):
        return
    with atomic(target) as temporary:
        shutil.copyfile(source, temporary)
