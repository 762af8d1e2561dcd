"""Join columns that are parts of frequency responses: real and imaginary, amplitude and phase."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from delam_fem.results.measured.channels import Channel

PART = re.compile(
    r"(?P<name>.+?)[\s_.-]+(?P<part>real|re|imaginary|imag|im|amplitude|magnitude|mag|phase|coherence"
    r"|coh)",
    re.IGNORECASE,
)
"""The name of a response with the part of it that a column is."""
PARTS = {"real": "real", "re": "real", "imaginary": "imag", "imag": "imag", "im": "imag",
         "amplitude": "size", "magnitude": "size", "mag": "size", "phase": "phase",
         "coherence": "coherence", "coh": "coherence"}  # fmt: skip


def joined(channels: Sequence[Channel]) -> list[Channel]:
    """Return channels in which each frequency response is one complex channel.

    Columns `NAME real` and `NAME imag`, or `NAME amplitude` and `NAME phase`, become the response
    NAME; `NAME coherence` its coherence. A phase is in radians once its unit has been converted.
    Other columns over the frequency are responses as they are.
    """
    kept = [channel for channel in channels if channel.axis != "frequency"]
    parts: dict[str, dict[str, Channel]] = {}
    for channel in channels:
        if channel.axis != "frequency":
            continue
        found = PART.fullmatch(channel.name)
        if channel.column.kind == "coherence":
            name, part = channel.name, "coherence"
        elif found is None:
            name, part = channel.name, "whole"
        else:
            name, part = found["name"], PARTS[found["part"].lower()]
        parts.setdefault(name, {})[part] = channel
    for name, own in parts.items():
        kept += _joined(name, own)
    return kept


def _joined(name: str, parts: dict[str, Channel]) -> list[Channel]:
    """Return the response that parts make, and its coherence."""
    found = []
    if "real" in parts and "imag" in parts:
        values = parts["real"].values + 1j * parts["imag"].values
        found.append(_renamed(parts["real"], name, "response", values))
    elif "size" in parts and "phase" in parts:
        values = parts["size"].values * np.exp(1j * parts["phase"].values)
        found.append(_renamed(parts["size"], name, "response", values))
    else:
        found += [
            _renamed(own, own.name, "response", own.values.astype(complex))
            for part, own in parts.items()
            if part != "coherence"
        ]
    if "coherence" in parts:
        own = parts["coherence"]
        found.append(_renamed(own, name, "coherence", own.values))
    return found


def _renamed(channel: Channel, name: str, kind: str, values: object) -> Channel:
    """Return a channel with a name, a kind and values."""
    column = replace(channel.column, name=name, kind=kind)
    return replace(channel, name=name, column=column, values=np.asarray(values))
