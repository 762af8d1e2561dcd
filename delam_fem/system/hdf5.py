"""Open files of HDF5 from anybody.

They may name other files, from which HDF5 would read. Such files are refused.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py

from delam_fem.system.errors import CaseError
from delam_fem.system.footprint import require_room

MOST_NODES = 100_000
"""Largest number of groups and datasets of a file."""


def require_alone(path: Path) -> None:
    """Refuse a file of HDF5 that names other files, or is too large; see `opened`."""
    opened(path).close()


def opened(path: Path) -> Any:
    """Open a file of HDF5 that holds all that it shows; the caller closes it.

    Raises:
        CaseError: it names other files, or is too large.
        OSError: it is no file of HDF5, or damaged.
    """
    file = h5py.File(path, "r")
    try:
        size = 0
        for number, (name, node) in enumerate(_nodes(file, path)):
            if number > MOST_NODES:
                raise CaseError(f"{path}: expected at most {MOST_NODES} groups and datasets")
            if isinstance(node, h5py.Dataset):
                if node.external or node.is_virtual:
                    raise CaseError(_elsewhere(path, name))
                size += node.size * max(node.dtype.itemsize, 1) if node.shape is not None else 0
        require_room(path, size)
    except BaseException:
        file.close()
        raise
    return file


def _nodes(file: h5py.File, path: Path) -> Iterator[tuple[str, Any]]:
    """Yield the name and the object of each group and dataset once.

    Raises:
        CaseError: a link leads to another file.
    """
    waiting: list[Any] = [file]
    addresses = set()
    while waiting:
        group = waiting.pop()
        for key in group:
            link = group.get(key, getlink=True)
            if isinstance(link, h5py.ExternalLink):
                raise CaseError(_elsewhere(path, key))
            if not isinstance(link, h5py.HardLink):
                continue  # to a place in this file, which is found by itself
            node = group[key]
            address = h5py.h5o.get_info(node.id).addr
            if address in addresses:
                raise CaseError(f"{path}: damaged: {key!r} is in two places")
            addresses.add(address)
            yield key, node
            if isinstance(node, h5py.Group):
                waiting.append(node)


def _elsewhere(path: Path, name: str) -> str:
    """Return the message for a file that names other files."""
    return (
        f"{path}: {name[:40]!r} is in another file; expected a file that holds all of its data, "
        "given one that names others"
    )
