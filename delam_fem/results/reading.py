"""Read the numbers of a run from its folder, and tell whether they are complete."""

from __future__ import annotations

import hashlib
import json
import logging
from pathlib import Path
from typing import Any

import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.case.files import load_case
from delam_fem.case.identity import (
    differences,
    identity,
    located,
    require_identity,
    require_same,
)
from delam_fem.results.netcdf import read_dataset
from delam_fem.results.schema import require_history, require_summary
from delam_fem.system.errors import CaseError, reason_of
from delam_fem.system.files import UNFINISHED, require_finished
from delam_fem.system.footprint import bounded

_log = logging.getLogger(__name__)
SURFACE = "surface.vtkhdf"
"""Name of the file with the fields of a reduced plate, in the folder of the fields."""
SOLID = "solid.vtkhdf"
"""Name of the file with the fields of a solid, in the folder of the fields."""


CASE, RESULT, SUMMARY = "case.toml", "result.nc", "summary.json"
"""Names of the files of a run with its case, with all its numbers and with a few."""
OF_SUMMARY = "summary_digest"
"""Attribute of a result with the digest of its summary, which is a file of its own."""


def load_numbers(
    directory: str | Path, *, is_strict: bool = False
) -> tuple[Case, xr.Dataset, dict[str, Any]]:
    """Read the case, the history and the summary of a run from its folder.

    Args:
        directory: the folder.
        is_strict: whether to refuse a folder whose case.toml is not the case of the result;
            otherwise that is a warning, also in the summary.

    Returns:
        All three, as `Result.save_numbers` has written them; without its file the summary is empty.
        The case is that of the result.

    Raises:
        CaseError: the folder has no result, an unfinished or a damaged one, or a file of its case
            is not there any more.
    """
    directory = Path(directory)
    path = directory / RESULT
    require_finished(directory)
    if not path.is_file():
        raise CaseError(f"{directory}: expected the folder of a run, found no {RESULT} there")
    history = read_dataset(path, is_ours=True)
    require_history(history, str(path))
    summary_digest = history.attrs.pop(OF_SUMMARY, None)
    summary = _read_summary(directory / SUMMARY, history.sizes["lamina"], summary_digest)
    case, changes = _case_of(history, directory)
    if changes:
        said = f"{directory / 'case.toml'} is not the case of {RESULT}: {'; '.join(changes)}"
        if is_strict:
            raise CaseError(f"{said}. Put the case back, or run it into another folder with -o DIR")
        _log.warning("%s; the result counts", said)
        summary["warnings"] = [f"{said}; the result counts", *summary.get("warnings", ())]
    names = [lamina.name for lamina in case.lamina]
    if history["lamina"].to_numpy().tolist() != names:
        raise CaseError(f"{path}: expected the laminae {', '.join(names)[:80]} of its case")
    return case, history, summary


def _read_summary(path: Path, n_laminae: int, digest: str | None) -> dict[str, Any]:
    """Return the numbers of a run; without the file there are none.

    Raises:
        CaseError: the file is damaged, was changed, or is of another result.
    """
    if not path.exists():
        return {}
    try:
        with bounded(path):
            content = path.read_bytes()
            summary = json.loads(content.decode())
    except (OSError, ValueError, RecursionError) as error:
        if isinstance(error, CaseError):
            raise
        raise CaseError(
            f"{path}: damaged, or not the summary of a run ({reason_of(error)})"
        ) from None
    summary = require_summary(summary, n_laminae, str(path))
    if digest not in (None, hashlib.sha256(content).hexdigest()):
        raise CaseError(
            f"{path}: was changed after it was written, or is of another result than {RESULT} "
            "beside it; copy it again from where it came, or remove it: no other file needs it"
        )
    return summary


def _case_of(history: xr.Dataset, directory: Path) -> tuple[Case, list[str]]:
    """Return the case of a result, and in what the case.toml beside it differs.

    Files of the case are looked for beside the result, and where they were when it was computed.
    """
    origin = history.attrs.get("identity")
    if origin is None:  # of an earlier version, or made by hand
        return load_case(directory / CASE), []
    beside: Case | None
    try:
        beside = load_case(directory / CASE)
        changes = differences(origin, identity(beside), of_case=True)
    except CaseError as error:
        changes = [str(error)]
        beside = None
    if beside is not None and not changes:
        return beside, []
    origin = require_identity(origin, directory / RESULT)
    cases = [case for case in (beside, Case.from_toml(history.attrs["case"])) if case is not None]
    return located(origin, *cases), changes


def is_complete(directory: str | Path, case: Case, engine: str | None = None) -> bool:
    """Return whether a folder has the complete result of a case.

    Args:
        directory: the folder.
        case: the case.
        engine: the engine that must have computed it; None: any.

    Raises:
        CaseError: it has the complete result of another case, or by another engine.
    """
    path = Path(directory) / RESULT
    if (path.parent / UNFINISHED).exists():
        return False
    try:
        about = read_dataset(path).attrs
    except CaseError:  # a damaged file; see `load_numbers`
        return False
    if about.get("outcome") != "completed":
        return False
    open_parts = ("version", "ranks", "engine") if engine is None else ("version", "ranks")
    require_same(
        str(about.get("identity")), identity(case, engine=engine), path, without=open_parts
    )
    return True
