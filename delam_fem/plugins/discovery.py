"""Find the studies: those of this package, and those that others add from their own.

A package adds a study by an entry point in its `pyproject.toml`, whose name is that of the function
in Python:

    [project.entry-points."delam_fem.studies"]
    deflect = "my_package.deflect:STUDY"

`delam_fem.deflect`, the command of its words, its help and its refusals follow.
"""

from __future__ import annotations

import logging
from functools import cache
from importlib.metadata import entry_points
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from delam_fem.plugins.study import Study

_log = logging.getLogger(__name__)
GROUP = "delam_fem.studies"
"""Group of the entry points."""


@cache
def homes() -> Mapping[str, Any]:
    """Return the entry points of all studies by their names in Python."""
    return MappingProxyType({point.name: point for point in entry_points(group=GROUP)})


@cache
def study(name: str) -> Study[Any, Any]:
    """Return the study of a name.

    Raises:
        KeyError: nobody offers it.
        TypeError: what is offered is no study.
    """
    from delam_fem.plugins.study import Study

    offered = homes()[name].load()
    if not isinstance(offered, Study):
        source = homes()[name].value
        raise TypeError(f"{GROUP}: {name}: expected a Study in {source}, found {offered!r}")
    return offered


def studies() -> dict[str, Study[Any, Any]]:
    """Return all studies by the words of their commands."""
    every = []
    for name, point in homes().items():
        try:
            every.append(study(name))
        except Exception as error:  # somebody else's package must not stop all commands
            _log.warning("%s: %s of %s cannot be used: %s", GROUP, name, point.value, error)
    return {each.words: each for each in sorted(every, key=lambda each: each.words)}
