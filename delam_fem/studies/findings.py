"""Write what a small study found: its numbers as JSON, its picture as PNG."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from delam_fem.system.files import atomic, write_text


def save_findings(
    directory: Path | str,
    name: str,
    numbers: dict[str, object],
    draw: Callable[[], Figure] | None = None,
) -> list[Path]:
    """Write NAME.json, then draw and write NAME.png.

    Args:
        directory: folder of the files; it is made if it does not exist.
        name: name of both files, without a suffix.
        numbers: content of the JSON file.
        draw: returns the figure; if it fails, the numbers are already written. None: no figure.

    Returns:
        The paths of the files.

    Raises:
        OSError: the folder cannot be written.
    """
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    table, image = directory / f"{name}.json", directory / f"{name}.png"
    write_text(table, json.dumps(numbers, indent=2) + "\n")
    if draw is None:
        image.unlink(missing_ok=True)  # of an earlier comparison
        return [table]
    with atomic(image) as temporary:
        draw().savefig(temporary, dpi=150)
    return [table, image]
