"""A run as a file of MATLAB: all variables under their own names, their units in a structure."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import xarray as xr
from scipy.io import savemat

from delam_fem.case.atomic import atomic

LONGEST = 63
"""Longest name in MATLAB."""


def write(history: xr.Dataset, path: Path) -> list[Path]:
    """Write a file of version 5, which `load` of MATLAB and Octave reads.

    Arrays have the dimensions of the dataset, in the same order; histories of two laminae are
    2 × n. `units`, `meaning` and `dimensions` are structures with a text for each variable;
    `lamina` holds the names of the laminae, `case_file` the case.

    Args:
        history: of a run; see `schema.VARIABLES`.
        path: of the file, in an existing folder.

    Returns:
        The file.

    Raises:
        OSError: the file cannot be written.
    """
    content: dict[str, Any] = {"units": {}, "meaning": {}, "dimensions": {}}
    for name in [*history.coords, *history.data_vars]:
        own, word = history[name], _word(str(name))
        values = own.to_numpy()
        content[word] = values.astype(object) if values.dtype.kind in "UO" else values
        content["units"][word] = str(own.attrs.get("units", ""))
        content["meaning"][word] = str(own.attrs.get("long_name", ""))
        content["dimensions"][word] = ", ".join(map(str, own.dims))
    content["case_file"] = str(history.attrs.get("case", ""))
    content["outcome"] = str(history.attrs.get("outcome", ""))
    with atomic(path) as temporary:
        savemat(
            temporary, content, appendmat=False, long_field_names=True, do_compression=True,
            oned_as="row",
        )  # fmt: skip
    return [path]


def _word(name: str) -> str:
    """Return a name that MATLAB takes."""
    word = re.sub(r"\W", "_", name, flags=re.ASCII)[:LONGEST]
    return word if word[:1].isalpha() else f"v_{word}"[:LONGEST]
