"""Measure how often verdicts and intervals are right, and write docs/evidence/calibration.md.

    .venv/bin/python scripts/evidence/calibrate.py [--part infer …] [--short] [--folder DIR]
        [-o docs]

Each module of scripts/evidence/calibration with a function `rows(is_long, folder)` is a part. It
computes truths that the program does not know, in a folder that it may fill, and returns its rows.
A part that runs replaces its own rows of docs/evidence/calibration.json alone; the page is written
from that file. The first paragraph of a part's docstring, below its title, is its text on the page.
"""

from __future__ import annotations

import argparse
import importlib
import inspect
import json
import sys
import tempfile
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from calibration.row import Row

ROOT = Path(__file__).parents[2]
PARTS = tuple(
    path.stem
    for path in sorted((Path(__file__).parent / "calibration").glob("*.py"))
    if path.stem not in ("row", "oscillator")
)
HEAD = """# How often verdicts and intervals are right

`scripts/evidence/calibrate.py` puts truths before the program that no table and no fit has seen,
and counts how often what is printed is right. `scripts/evidence/calibration/` says how truths are
drawn, `calibration.json` has the counts of each rig, a table the least and the largest share of all
rigs that was right. "Undecided" does not count.

- Rig *as modelled*: a promise holds if the count lies in the binomial 95 % band of its share.
- Other rigs differ from the model: EI (± 5 %), clamps (soft), damping (× 2, × ½), noise (per
  point), shaker (harmonics), mesh. A promise holds if at most twice as many are wrong.
- "Mismatch named": more are wrong, but a warning names it at 90 % of the truths.
- "Falls short": do not rely on it there.

Not all truths are blind: rules of `orbit`, `converge`, `resonance`, `identify`, of free vibrations
and of Lyapunov exponents were changed after a first count on some of the same truths.
"""
DIFFERENT = {
    "EI": "EI",
    "clamps": "soft clamps",
    "damping": "damping ×",
    "noise": "noise",
    "shaker": "second harmonic",
    "mesh": "elements, not",
}
"""In what a rig may differ from its model, and the words by which its rows are known."""
COMPUTED = "nothing is measured: the verdict is on the case as given, another EI is another case"
RIGID = "soft clamps: `support.rotational_stiffness` is that of bonded beams"
WHY_NOT = {
    "basins": COMPUTED,
    "branches": "a map has no laminae, no noise and no shaker",
    "converge": f"{COMPUTED}; stiffness and damping are drawn",
    "detect": "mesh: the motion is exact, and nothing touches",
    "identify": f"{RIGID}; damping is sought itself, from half to twice",
    "fit": "damping is sought itself; noise: of lines, 1 or 5 %; shaker: a response has lines that "
    "are driven; mesh: all truths have twice the elements",
    "free": "EI, clamps: they change the frequency, which is drawn; there is no shaker and no mesh",
    "lyapunov": "an oscillator has one stop, no mesh, no noise and no shaker",
    "modulate": "nothing is measured: the command has no `--measured`",
    "multipliers": "a map has no laminae, no noise and no shaker",
    "natural": "a frequency alone is read; its noise is drawn",
    "overlay": RIGID,
    "pod": "nothing is measured: hits are drawn; those of rigs are the matter of `detect`",
    "resonance": "EI, clamps: they change the frequency, which is drawn; mesh: nothing touches",
    "settled": f"{RIGID}; a run has no noise, and its drive is that of the case",
    "stability": COMPUTED,
    "tap": "there is no shaker",
}
"""Why a part lacks a rig."""
UNCOUNTED = {
    "multipliers, doublings, folds and Lyapunov exponents of laminae": "no exact truth is known; "
    "[orbits](orbits.md) has those of two presets",
    "`orbit follow`: grazings": "the points beside it are the interval",
    "`sweep`: kinds of motion; `detect pod`: a90; `detect modulate`: calls of delaminated plates; "
    "`converge`: contact work, distortion, other harmonics": "no share is promised",
    "`measure response --poles`: errors": "`tests/studies/signals/test_poles.py` counts them",
    "`converge`: solids": "a truth costs many minutes",
}
"""What is printed and has no count, and why."""


def main(arguments: list[str] | None = None) -> int:
    """Measure the parts, write the numbers and the page; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--part", action="append", choices=PARTS, help="default: all")
    parser.add_argument("--short", action="store_true", help="few truths, in seconds")
    parser.add_argument("--redraw", action="store_true", help="write the page; compute nothing")
    parser.add_argument("--folder", type=Path, help="keeps simulations, from which a part goes on")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "evidence")
    options = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / "calibration.json"
    results = json.loads(path.read_text("utf-8")) if path.exists() else {}
    for name in () if options.redraw else options.part or PARTS:
        start = time.process_time()
        rows = measured(name, is_long=not options.short, kept=options.folder)
        spent = None if options.folder else round(time.process_time() - start)
        results[name] = {"cpu_s": spent, "rows": rows}
        path.write_text(json.dumps(results, indent=1, sort_keys=True) + "\n", "utf-8")
        sys.stdout.write(table(rows) + "\n")
    (options.output / "calibration.md").write_text(page(results), "utf-8")
    return 0


def measured(name: str, *, is_long: bool, kept: Path | None = None) -> list[dict[str, Any]]:
    """Return the rows of a part, which computes in a folder that is kept, or in none."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) if kept is None else kept / name
        folder.mkdir(parents=True, exist_ok=True)
        return [asdict(row) for row in part(name).rows(is_long, folder)]


def part(name: str) -> Any:
    """Return the module of a part."""
    return importlib.import_module(f"calibration.{name}")


def page(found: dict[str, Any]) -> str:
    """Return the page of all measured parts."""
    texts = [HEAD]
    for name in sorted(found):
        paragraphs = inspect.getdoc(part(name)).split("\n\n")
        rows = found[name]["rows"]
        texts.append("\n\n".join([f"## {title_of(name)}", *paragraphs[1:2], *rigs(rows)]) + "\n")
        texts.append(table(rows))
    texts.append("## Without a count\n")
    texts.append("| printed | why |\n|---|---|")
    texts.extend(f"| {what} | {why} |" for what, why in UNCOUNTED.items())
    return "\n".join(texts) + "\n"


def rigs(rows: list[dict[str, Any]]) -> list[str]:
    """Return a line on what the rigs of rows have that differs from the model, or none."""
    kinds = [kind for kind in DIFFERENT if kind not in lacking(rows)]
    return [f"Rigs: {', '.join(kinds)}."] * bool(kinds)


def lacking(rows: list[dict[str, Any]]) -> list[str]:
    """Return in what none of the rigs of rows differs from the model."""
    names = [row["rig"] for row in rows]
    return [kind for kind, word in DIFFERENT.items() if not any(word in name for name in names)]


def title_of(name: str) -> str:
    """Return the title of a part."""
    return inspect.getdoc(part(name)).split("\n", 1)[0].removesuffix(".")


def table(rows: list[dict[str, Any]]) -> str:
    """Return rows as a table of a page: a line for each verdict over all of its rigs."""
    lines = [
        "| printed | promised | rigs | truths | right | except |",
        "|" + "---|" * 6,
    ]
    by_verdict: dict[str, list[Row]] = {}
    for numbers in rows:
        row = Row(**numbers)
        by_verdict.setdefault(row.verdict, []).append(row)
    for verdict, rigs_of_verdict in by_verdict.items():
        first = rigs_of_verdict[0]
        shares = [share(row) for row in rigs_of_verdict if row.decided]
        ends = sorted({f"{min(shares):.0f}", f"{max(shares):.0f}"}, key=float) if shares else ["–"]
        exceptions = [row for row in rigs_of_verdict if row.judgement != "holds"]
        lines.append(
            f"| {verdict} | {'≥ ' * first.at_least}{100 * first.nominal:g} % "
            f"| {len(rigs_of_verdict)} | {sum(row.truths for row in rigs_of_verdict)} "
            f"| {' … '.join(ends)} % | {'; '.join(map(exception, exceptions))} |"
        )
    return "\n".join(lines) + "\n"


def share(row: Row) -> float:
    """Return how many of the decided truths of a row are right [%]."""
    return 100.0 * row.contained / row.decided


def exception(row: Row) -> str:
    """Return a rig on which a verdict does not hold, with its share and what is said of it."""
    right = f" {share(row):.0f} %" if row.decided else ""
    return f"{row.rig}:{right} ({row.judgement.replace('**', '')})"


if __name__ == "__main__":
    sys.exit(main())
