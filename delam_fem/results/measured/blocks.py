"""The sets of a universal file as bytes, and what is put right in them before they are parsed.

Real files have tags with trailing blanks, lines with trailing blanks, D for E in exponents, empty
lines, and stray line ends about the binary data of a set 58b, which may itself look like a tag.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from delam_fem.case.toml import CaseError

TAG = b"    -1"
TAG_LINE = re.compile(rb"(?:^|(?<=\n)|(?<=\r)) {4}-1[ \t]*(?:\r\n|\n|\r|\Z)")
"""A line that begins or ends a set."""
END_TAG = re.compile(rb"(?P<before>[\r\n]*) {4}-1[ \t]*(?:\r\n|\n|\r|\Z)")
"""The end of binary data: the tag may follow the last byte at once."""
LINE = re.compile(rb"[^\r\n]*(?:\r\n|\n|\r|\Z)")
HEADER_LINES = 13
"""Lines of a set 58 before its data: the tag, the type, eleven records."""
NUMBER_WIDTHS = {2: 4, 4: 8, 5: 8, 6: 16}
"""Bytes of a value by the type of the ordinate: real and complex, single and double."""
MOST_BYTES = 1_000_000_000


@dataclass(frozen=True)
class Block:
    """A set of a universal file.

    Attributes:
        number: of the set in the file, from 1.
        kind: its type, such as "58b".
        header: of a set 58b its first lines, otherwise all lines, without the tag at the end.
        data: binary data of a set 58b without stray line ends.
        notes: what was put right.
    """

    number: int
    kind: str
    header: bytes
    data: bytes = b""
    notes: tuple[str, ...] = ()


def blocks_of(path: Path) -> list[Block]:
    """Return the sets of a file.

    Raises:
        CaseError: the file is too large, has no set, or ends within one.
    """
    if path.stat().st_size > MOST_BYTES:
        raise CaseError(f"{path}: expected at most {MOST_BYTES} bytes")
    content, place = path.read_bytes(), 0
    found: list[Block] = []
    while (tag := TAG_LINE.search(content, place)) is not None:
        block, place = _block(content, tag.start(), len(found) + 1, path)
        found.append(block)
    if not found:
        raise CaseError(
            f"{path}: expected a universal file, found no line '    -1' that begins a set"
        )
    return found


def _block(content: bytes, start: int, number: int, path: Path) -> tuple[Block, int]:
    """Return the set that begins at a tag, and where the file goes on after it."""
    type_line = LINE.match(content, _line_end(content, start))
    kind = type_line.group().strip().decode("ascii", "replace") if type_line else ""
    if kind[:3].lower() == "58b":
        return _binary(content, start, number, path)
    end = TAG_LINE.search(content, _line_end(content, start))
    if end is None:
        raise CaseError(f"{path}: set {number} (type {kind[:6]}) has no end; the file is cut off")
    kind = kind.split()[0] if kind.split() else "empty"
    return Block(number, kind, content[start : end.start()]), end.end()


def _binary(content: bytes, start: int, number: int, path: Path) -> tuple[Block, int]:
    """Return a set 58b: its size follows from its header, not from what looks like a tag."""
    place = start
    lines = []
    for _ in range(HEADER_LINES):
        end = _line_end(content, place)
        lines.append(content[place:end].rstrip(b"\r\n"))
        place = end
    try:
        ordinate, points, is_even = (int(lines[8][k : k + 10]) for k in (0, 10, 20))
        width = NUMBER_WIDTHS[ordinate]
        of_abscissa = 0 if is_even else (4 if ordinate in (2, 5) else 8)
    except (ValueError, KeyError):
        raise CaseError(f"{path}: set {number} (type 58b): its header cannot be read") from None
    size = points * (width + of_abscissa)
    end_tag = END_TAG.search(content, place + size)
    if end_tag is None:
        raise CaseError(
            f"{path}: set {number} (type 58b): expected {size} bytes of data and its end, found "
            f"{len(content) - place} bytes; the file is cut off"
        )
    data, notes = content[place : end_tag.end("before")], list[str]()
    before, behind = _strays(data, size, ">" if lines[1][7:13].strip() == b"2" else "<")
    if before or behind:
        notes.append(f"{before + behind} stray bytes about its binary data left out")
    header = b"".join(line.rstrip() + b"\n" for line in lines)
    return Block(number, "58b", header, data[before : before + size], tuple(notes)), end_tag.end()


def _strays(data: bytes, size: int, order: str) -> tuple[int, int]:
    """Return how many stray bytes are before and behind the binary data.

    Only line ends can be stray. Where it is not clear on which side they are, because a value
    begins or ends with such a byte, the side is taken that leaves the smaller values.
    """
    extra = len(data) - size
    starts = [k for k in range(extra + 1) if not (data[:k] + data[k + size :]).strip(b"\r\n")] or [
        0
    ]
    if len(starts) > 1 and size % 8 == 0:
        largest = [np.frombuffer(data[k : k + size], f"{order}f8") for k in starts]
        with np.errstate(all="ignore"):
            spread = [float(np.max(np.abs(np.log10(np.abs(v) + 1e-30)))) for v in largest]
        starts = [starts[int(np.nanargmin(np.nan_to_num(spread, nan=np.inf)))]]
    return starts[0], extra - starts[0]


def _line_end(content: bytes, place: int) -> int:
    """Return where the line at a place ends, its line end included."""
    found = LINE.match(content, place)
    return found.end() if found else len(content)


def cleaned(block: Block) -> bytes:
    """Return a set as pyuff expects it: plain tags and line ends, no trailing blanks, no D."""
    if block.kind == "58b":
        return block.header + block.data + b"\n" + TAG + b"\n"
    lines = [line.rstrip() for line in block.header.splitlines()]
    lines[0] = TAG
    head, body = lines[:HEADER_LINES], lines[HEADER_LINES:]
    if block.kind == "58":
        lines = head + [line.replace(b"D", b"E").replace(b"d", b"E") for line in body if line]
    return b"\n".join(lines) + b"\n" + TAG + b"\n"
