"""Say what is computed, so that what is kept of it is taken up by the same computation alone.

The identity of a computation is its resolved case, the content of every file that the case names,
and the question that is asked of it: engine, options, axes of a sweep. It names no paths, so that
what is moved or renamed stays the same, and what is edited does not. Everything that can be
resumed, extended, merged or looked at again keeps this text, and `require_same` compares it.
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict, is_dataclass
from pathlib import Path

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.toml import Data, set_key, toml_text
from delam_fem.system.errors import CaseError, reason_of
from delam_fem.system.files import IDENTITY, write_text
from delam_fem.system.written import PREFIX

_CONTENT = "sha256-"
"""Beginning of the word that stands for a file; the digest of its content follows."""


def located(kept: str, *cases: Case) -> Case:
    """Return the case of an identity, with its files where one of some cases names them.

    Args:
        kept: the identity.
        *cases: cases whose files are looked at, in this order.

    Raises:
        CaseError: none of them names a file that still has the content.
    """
    case = Case.from_toml(json.loads(kept)["case"])
    places: dict[str, object] = {}
    for key, word in case.files.items():
        named = [other.files[key] for other in cases if key in other.files]
        match = next((file for file in named if _has_content(file, word.name)), None)
        if match is None:
            tried = ", ".join(dict.fromkeys(map(str, named))) or "nowhere"
            raise CaseError(
                f"{key}: expected the file that was computed with; it is not there any more, or "
                f"was changed (looked at {tried}): put it back"
            )
        places[key] = str(match)
    return case.with_overrides(places) if places else case


def _has_content(file: Path, word: str) -> bool:
    """Return whether a file can be read and has the content that a word stands for."""
    try:
        return content_of(file, "") == word
    except CaseError:
        return False


_FILE = "a file"
"""Such a word in a message."""
_MOST_DIFFERENCES = 4
"""Number of differences that a message lists."""


def identity(case: Case, **question: object) -> str:
    """Return a text that is equal for the same case, files and question, wherever the files are.

    Args:
        case: the case.
        **question: what is asked of the case, as numbers, texts, arrays, paths, and such in
            mappings, sequences and dataclasses; a path stands for the content of its file.

    Raises:
        CaseError: a file cannot be read.
    """
    data = tomllib.loads(case.to_toml())
    for key, file in case.files.items():
        set_key(data, key, content_of(file, key))
    return json.dumps({"case": toml_text(data), "question": _plain(question)}, sort_keys=True)


def digest(text: str) -> str:
    """Return a short name for an identity, fit for a file."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def content_of(file: Path, key: str) -> str:
    """Return a word that is equal for files of the same content, and for nothing else.

    Args:
        file: the file; what an XDMF file keeps beside it belongs to it.
        key: where the file is named, for messages.

    Raises:
        CaseError: the file cannot be read.
    """
    content = hashlib.sha256()
    for path in (file, *companions(file)):
        try:
            with path.open("rb") as stream:
                content.update(hashlib.file_digest(stream, "sha256").digest())
        except OSError as error:
            raise CaseError(f"{key}: {file} cannot be read ({error.strerror})") from None
    return _CONTENT + content.hexdigest()


def companions(file: Path) -> list[Path]:
    """Return the files that belong to a file of a case: XDMF keeps its numbers in another one."""
    heavy = file.with_suffix(".h5")
    return [heavy] if file.suffix == ".xdmf" and heavy.is_file() else []


def differences(
    kept: str, asked: str, without: Collection[str] = (), *, of_case: bool = False
) -> list[str]:
    """Return in words where two identities differ, key by key; none if they are the same.

    A key that the kept case lacks has come with a later version; its default counts.

    Args:
        kept: identity of what is kept.
        asked: identity of what is computed.
        without: keys, and parts of the question, that may differ.
        of_case: whether to compare cases and files alone, whatever was asked of them.
    """
    if kept == asked:
        return []
    try:
        before = dict(_entries(kept, of_case=of_case))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        return [f"it does not say of what it is ({reason_of(error)})"]
    after = dict(_entries(asked, of_case=of_case))
    return [
        _said(name, before.get(name), after.get(name))
        for name in {**before, **after}
        if before.get(name) != after.get(name) and name not in without
    ]


def require_identity(kept: object, where: object) -> str:
    """Return what was read as an identity, if it is one.

    Args:
        kept: what was read.
        where: the file of what is kept.

    Raises:
        CaseError: it is none.
    """
    try:
        dict(_entries(str(kept), of_case=False))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise CaseError(
            f"{where}: damaged, or not written by delam-fem: it does not say of what case it is "
            f"({reason_of(error)})"
        ) from None
    return str(kept)


def require_same(kept: str, asked: str, where: object, *, without: Collection[str] = ()) -> None:
    """Refuse to go on with what belongs to another computation.

    Args:
        kept: identity of what is kept.
        asked: identity of what is computed.
        where: the file or folder of what is kept.
        without: keys that may differ.

    Raises:
        CaseError: the two differ; the message says in which keys, files and options.
    """
    texts = differences(kept, asked, without)
    if not texts:
        return
    listed = "; ".join(texts[:_MOST_DIFFERENCES])
    more = len(texts) - _MOST_DIFFERENCES
    raise CaseError(
        f"{where} belongs to another case or question: {listed}"
        + (f"; and {more} more" if more > 0 else "")
        + ". Ask the same, as with --set KEY=VALUE; or choose another folder with -o DIR, or "
        "compute everything anew with --overwrite"
    )


def belong(folder: Path, asked: str) -> None:
    """Let a folder of what is kept say of what it is, or check what it says.

    Args:
        folder: the folder; what is kept goes there.
        asked: identity of what is computed.

    Raises:
        CaseError: the folder belongs to another computation, or does not say to which.
        OSError: the folder cannot be read or written.
    """
    note = folder / IDENTITY
    if note.is_file():
        require_same(note.read_text("utf-8", errors="replace"), asked, folder)
    elif any(not path.name.startswith(PREFIX) for path in folder.iterdir()):
        require_same("", asked, folder)
    else:
        write_text(note, asked)


def _said(name: str, before: str | None, after: str | None) -> str:
    """Return a difference in words."""
    there, here = (_word(text) for text in (before, after))
    if there == here == _FILE:
        return f"{name}: the file has another content"
    return f"{name}: {there} there, {here} here"


def _word(text: str | None) -> str:
    """Return a value of an entry as a message shows it."""
    if text is None:
        return "none"
    return _FILE if text.startswith(f'"{_CONTENT}') else text[:60]


def _entries(text: str, *, of_case: bool) -> Iterator[tuple[str, str]]:
    """Yield the keys and the parts of the question of an identity, with their values as JSON."""
    content = json.loads(text)
    case = Case.from_toml(content["case"])  # with the defaults of keys that it lacks
    data = tomllib.loads(case.to_toml())
    for key, file in case.files.items():
        set_key(data, key, file.name)
    yield from _leaves(data)
    if not of_case:
        yield from _leaves(content["question"])


def _leaves(tables: Data, place: str = "") -> Iterator[tuple[str, str]]:
    """Yield the values in nested tables by keys with dots, each as JSON."""
    for key, value in tables.items():
        if isinstance(value, Mapping):
            yield from _leaves(dict(value), f"{place}{key}.")
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            named = {str(entry.get("name", k)): entry for k, entry in enumerate(value, start=1)}
            yield from _leaves(dict(named), f"{place}{key}.")
        else:
            yield f"{place}{key}", json.dumps(value)


def _plain(value: object) -> object:
    """Return a question as JSON knows it, with contents in place of paths."""
    if isinstance(value, Path):
        return content_of(value, "file")
    if isinstance(value, np.ndarray):
        head = f"{value.dtype.str} {value.shape} ".encode()
        return hashlib.sha256(head + value.tobytes()).hexdigest()
    if is_dataclass(value) and not isinstance(value, type):
        return _plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return value
