"""Write a run as one self-contained page: a sentence, its numbers, its figures and a film.

Sentence and table of numbers also show a run in a notebook. Each clause of the sentence is a
function of the run that returns its words, or nothing. A new clause is a function and its place in
`CLAUSES`.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.case.sections import EDGE_TOLERANCE
from delam_fem.results import diagnostics
from delam_fem.results.diagnostics import LARGEST_PERIODICITY, probe_node
from delam_fem.results.fields import laminae
from delam_fem.results.fields.pictures import drawable_frames, marks, middle_lines
from delam_fem.results.figures.run import FLOWS
from delam_fem.results.figures.style import finite, lamina_colours, shown_unit
from delam_fem.results.pages import html
from delam_fem.results.pages.html import (
    Block,
    Film,
    Gallery,
    HtmlTable,
    PageSection,
    Paragraph,
    Preformatted,
    embedded,
)
from delam_fem.results.record import of_run
from delam_fem.results.schema import CHANNEL_MEASURES, contact_heading, contact_rows, rows, shown
from delam_fem.system.files import write_text

WORDS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight")
EQUAL = 0.05
"""Two speeds closer than this share of the larger one count as equal."""


@dataclass(frozen=True)
class Run:
    """The dataset, the summary and the case of a run, from which the clauses are made."""

    history: xr.Dataset
    summary: Mapping[str, Any]
    case: Case

    @property
    def end(self) -> str:
        """The word for the place of the reference probes."""
        return "tip" if probe_node(self.history) == self.history.sizes["node"] - 1 else "probe"


def sentence(history: xr.Dataset, summary: Mapping[str, Any], case: Case) -> str:
    """Return the outcome of a run in a sentence.

    Args:
        history: dataset of the run; see `schema.VARIABLES`.
        summary: the numbers of summary.json; those that are missing are not mentioned.
        case: the case.
    """
    run = Run(history, summary, case)
    text = ", ".join(words for words in (clause(run) for clause in CLAUSES) if words)
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def _outcome(run: Run) -> str:
    """Say whether the run came to its end."""
    outcome = run.summary.get("outcome", "completed")
    done = run.history.sizes["period"]
    wanted = run.case.n_periods
    return "" if outcome == "completed" else f"{outcome} in period {done} of {wanted}"


def _settled(run: Run) -> str:
    """Say whether the motion has settled, in the word of the summary, and what is missing."""
    word = str(run.summary.get("settled") or "")
    numbers = run.summary.get("settling") or {}
    if word != "not settled":
        return word
    left = numbers.get("transient")
    needed = numbers.get("periods_needed")
    parts = [] if left is None else [f"{100.0 * left:.2g} % of the amplitude is transient"]
    parts += [f"at most {needed} further periods are needed"] if needed else []
    return f"{word} ({'; '.join(parts)})" if parts else word


def _periodicity(run: Run) -> str:
    """Say after how many periods of the excitation the motion repeats."""
    if not run.case.is_periodic:
        return "not judged for periods, because the excitation has none"
    if run.summary.get("settled") == "not settled":
        return ""
    P = run.summary.get("periodicity")
    if run.summary.get("periodicity_class") == "undecided":
        single = 100.0 * run.summary["strobe_scatters"][0]
        return f"of undecided period (cycles differ by {single:.2g} % of the amplitude)"
    if P is None:
        return f"no repetition within {WORDS[LARGEST_PERIODICITY]} periods"
    return f"{_word(P)}-periodic"


def _contacts(run: Run) -> str:
    """Say how often the probes meet and stops and impactors are struck, and how fast."""
    texts = (_tips(run), *map(_struck, run.summary.get("contacts") or (), repeat(run)))
    return ", ".join(text for text in texts if text)


def _struck(contact: Mapping[str, Any], run: Run) -> str:
    """Say how often a stop or an impactor is struck, and how fast; nothing of an interface."""
    rate, velocity = contact["strikes_per_period"], contact["approach_velocity"]
    if contact["kind"] == "interface" or rate is None:
        return ""
    if not rate:
        return f"{contact['name']} is never struck"
    speed = f" at {velocity:.3g} m/s" if velocity is not None else ""
    return f"{_strikes(run, rate)} on {contact['name']}{speed}"


def _strikes(run: Run, rate: float, end: str = "") -> str:
    """Say a number of strikes: per period, or in all where the excitation has none.

    Args:
        run: the run.
        rate: strikes per period.
        end: the word for what strikes; empty: it is said elsewhere.
    """
    strike = f"{end} strike".strip()
    if run.case.is_periodic:
        return _often(rate, strike)
    times = rate * run.history.sizes["time"] / run.case.steps_per_period
    return f"{times:.0f} {strike}{'s' * (round(times) != 1)}"


def _tips(run: Run) -> str:
    """Say how often the probes meet, and how fast."""
    rate = run.summary.get("tip_contacts_per_period")
    gap = run.summary.get("minimum_tip_gap")
    if rate is None and run.history.sizes["lamina"] > 1 and "gap0" in run.history:
        return "without contact: the laminae pass through one another"
    if not rate:
        if gap is None or not np.isfinite(gap):  # nothing is known of contacts
            return ""
        near = f" (the smallest gap is {1e3 * gap:.3g} mm)" if gap > 0.0 else ""
        return f"the {run.end}s never meet{near}"
    strongest = _strongest(run)
    speed = f" at {strongest[1].approach:.3g} m/s" if strongest else ""
    return f"{_strikes(run, rate, run.end)}{speed}"


def _beats(run: Run) -> str:
    """Say which lamina is faster before the strikes."""
    strongest = _strongest(run)
    if not strongest:
        return ""
    interface, strike = strongest
    names = [str(name) for name in run.history["lamina"].to_numpy()[interface : interface + 2]]
    lower, upper = (abs(speed) for speed in strike.mean)
    if abs(lower - upper) <= EQUAL * max(lower, upper):
        return f"{names[0]} and {names[1]} equally fast"
    fast, slow = names if lower > upper else names[::-1]
    return f"{fast} beats {slow}"


CLAUSES: tuple[Callable[[Run], str], ...] = (_outcome, _settled, _periodicity, _contacts, _beats)
"""The clauses of the sentence in their order."""


def _strongest(run: Run) -> tuple[int, diagnostics.Strikes] | None:
    """Return the interface with the fastest strikes, and these; None if there are none."""
    if not run.summary.get("tip_contacts_per_period"):
        return None
    N = run.case.steps_per_period
    n = run.history.sizes["lamina"]
    candidates = [(j, diagnostics.of_interface(run.history, N, j)) for j in range(n - 1)]
    candidates = [entry for entry in candidates if entry[1].step.size and entry[1].approach > 0.0]
    return max(candidates, key=lambda entry: entry[1].approach, default=None)


def _often(rate: float, strike: str) -> str:
    """Return a number of contacts per period in words; `strike` is the word for one of them."""
    for periods in range(1, LARGEST_PERIODICITY + 1):
        count = rate * periods
        if np.isclose(count, round(count), atol=1e-6) and 1 <= round(count) < len(WORDS):
            plural = "" if round(count) == 1 else "s"
            during = "a period" if periods == 1 else f"in {_word(periods)} periods"
            return f"{_word(round(count))} {strike}{plural} {during}"
    return f"{rate:.3g} {strike}s a period"


def _word(number: int) -> str:
    """Return a small number in words."""
    return WORDS[number] if number < len(WORDS) else str(number)


def of_result(history: xr.Dataset, summary: Mapping[str, Any], case: Case) -> str:
    """Return a result as a piece of HTML for a notebook, without style and scripts."""
    names = [str(name) for name in history["lamina"].to_numpy()]
    blocks: list[Block] = [
        Paragraph(case.title),
        Paragraph(sentence(history, summary, case)),
        *(Paragraph(str(text)) for text in summary.get("warnings", ())),
        HtmlTable(("", "value", "meaning"), rows(summary, names)),
    ]
    return html.fragment(blocks)


MOST_NUMBERS = 300_000
"""Largest number of positions in a film: so many make a page 0.8 MB larger."""
MOST_NODES = 101
"""Largest number of nodes of each lamina that a film shows."""
LARGEST = 32_000
"""Largest quantised position; int16 holds it."""


def film(history: xr.Dataset, case: Case) -> Film | None:
    """Return the film of a run.

    Where there are too many nodes, some are left out; where there are too many frames, the first
    periods are left out.

    Returns:
        The film; None if no frame has finite values.
    """
    history = drawable_frames(history)
    if not history.sizes["frame"]:
        return None
    n = history.sizes["node"]
    nodes = np.rint(np.linspace(0, n - 1, min(n, MOST_NODES))).astype(np.int64)
    per_frame = history.sizes["lamina"] * nodes.size
    last = slice(-max(1, MOST_NUMBERS // per_frame), None)
    u = history["displacement"].to_numpy()
    largest = max(float(np.abs(u).max()), float(history["gap0"].to_numpy().max(initial=0.0)))
    factor = 1.0
    if 0.0 < largest < case.thickness:
        factor = float(10.0 ** np.ceil(np.log10(case.thickness / largest)))
    y = middle_lines(history, case, factor)[:, None] + factor * u
    y = 1e3 * y.transpose(1, 0, 2)[last][..., nodes]
    unit = float(np.abs(y).max()) / LARGEST or 1.0
    stops = [
        {
            "x": 1e3 * mark.x, "side": mark.side,
            "y": _short(1e3 * (mark.rest + factor * mark.motion)[last]),
            "lit": mark.state[last].tolist(),
        }
        for mark in marks(history, case, factor)
    ]  # fmt: skip
    nearest = np.concatenate([[0], (nodes[:-1] + nodes[1:]) // 2 + 1])  # first of each shown node
    lit = np.maximum.reduceat(laminae.contact_lights(history)[last], nearest, axis=-1)
    ends = [lamina.length * (1.0 + EDGE_TOLERANCE) for lamina in case.lamina]
    data = {
        "names": [str(name) for name in history["lamina"].to_numpy()],
        "colours": list(lamina_colours(history.sizes["lamina"])),
        "thickness": [1e3 * lamina.mean("thickness") for lamina in case.lamina],
        "x": _short(1e3 * history["x"].to_numpy()[nodes]),
        "ends": [int(np.sum(history["x"].to_numpy()[nodes] <= end)) for end in ends],
        "time": _short(history["frame"].to_numpy()[last]),
        "period": case.period if case.is_periodic else None,
        "unit": unit,
        "factor": factor,
        "y": _text(np.rint(y / unit).astype("<i2")),
        "lit": _text(lit),
        "held": laminae.held_ends(case),
        "stops": stops,
    }
    caption = (
        "The laminae in motion, with orange dots where pairs have been hit since the frame before "
        "and squares where they rest on one another; the strip below shows the last nodes. "
        "Between two frames the motion is interpolated."
    )
    if stops:
        caption += " Triangles are stops, impactors, and supports inside the span."
    if factor != 1.0:
        caption += f" Deflections and gaps are drawn {factor:g} times as large as they are."
    return Film(data, "The laminae in motion", caption)


def _short(values: npt.NDArray[Any]) -> list[float]:
    """Return numbers with seven digits."""
    return [float(f"{value:.7g}") for value in values]


def _text(values: npt.NDArray[Any]) -> str:
    """Return an array as base64."""
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")


CAPTIONS = {
    "laminae": "The deformed laminae about the strongest strike of the window.",
    "solid": (
        "Von Mises stress and stress along the solid laminae after the strongest strike, their "
        "thickness drawn larger."
    ),
    "tip_histories": (
        "Positions of the reference probes over the last periods: yᵢ is the displacement qᵢ plus "
        "the gaps at rest below lamina i."
    ),
    "probe_histories": "Displacements of the probes over the last periods; ticks are impacts.",
    "phase_portraits": "Phase portraits of the reference probes.",
    "channels": "Channels over the last periods, a panel for each unit.",
    "channel_spectra": "Amplitude spectra of channels, over whole periods of the window.",
    "channel_portraits": "Time derivatives of channels over the channels themselves.",
    "spectra": "Amplitude spectra of the displacements at the reference probes.",
    "responses": (
        "The drive, what it moves, and the frequency responses of all channels, beside the exact "
        "ones without contact."
    ),
    "contact_line": "Where and when neighbouring laminae touch, and the power that contact takes.",
    "energy_ledger": "What changed the energy in each period, and what was stored at its end.",
    "envelope": "Displacements at the reference probes within each period of the whole run.",
}
"""Captions of the figures in the order of the report; missing figures are left out."""

FILES = {
    "case.toml": "the complete case; it repeats the run",
    "result.nc": "all numbers, NetCDF",
    "summary.json": "the numbers above, SI units",
    "fields/fields.vtkhdf": "the laminae of all frames for ParaView",
    "fields/solid.vtkhdf": "the solid laminae of all frames with their stresses",
    "fields/fields.pvd": "the laminae of the last period, one file per frame",
    "fields/fields.bp": "the middle lines, for ParaView's ADIOS2 reader",
    "fields/solid.bp": "the solid laminae, for ParaView's ADIOS2 reader",
    "figures": "the figures as PNG",
}
"""Files beside the page with what they are; missing ones are left out."""

ORIGIN = (
    "delam_fem", "git_revision", "dolfinx", "petsc", "numpy", "numba", "blas", "processor", "host",
    "command", "engine", "outcome",
)  # fmt: skip
"""Attributes of the history with its origin."""


def write_report(
    history: xr.Dataset, summary: Mapping[str, Any], case: Case, directory: str | Path
) -> Path:
    """Write report.html with the figures found in the folder `figures` beside it.

    Args:
        history: dataset of a run; see `schema.VARIABLES`.
        summary: the numbers of summary.json.
        case: the case.
        directory: folder, which is made where it does not exist.

    Returns:
        The file.

    Raises:
        OSError: the folder cannot be written or the disk is full.
    """
    directory = Path(directory)
    return write_text(directory / "report.html", page(history, summary, case, directory))


def page(history: xr.Dataset, summary: Mapping[str, Any], case: Case, directory: Path) -> str:
    """Return the page of a run as HTML.

    Args:
        history: dataset of a run.
        summary: the numbers of summary.json.
        case: the case; of a run of operators the `Problem` in its place.
        directory: folder of the results; the page shows its figures and names its files.
    """
    names = [str(name) for name in history["lamina"].to_numpy()]
    has_laminae = "tip_node" in history  # else it is a run of operators
    words = "laminae from bottom to top" if has_laminae else "probes"
    about = f"Over the window of the last periods; {words}: {', '.join(names)}."
    flows = "What changed the stored energy, added up over the run and in the last period."
    energy = HtmlTable(("", "whole run [mJ]", "last period [mJ]"), energy_rows(history))
    origin = [(name, str(history.attrs[name])) for name in ORIGIN if name in history.attrs]
    table = HtmlTable(("", "value", "meaning"), rows(summary, names), kind="meanings")
    texts = (summary.get("message"), *summary.get("warnings", ()))
    warnings = [Paragraph(str(text), "warning") for text in texts if text]
    drawn = ((directory / "figures" / f"{name}.png", text) for name, text in CAPTIONS.items())
    figures = [(picture, text) for picture, text in drawn if picture.is_file()]
    heading = ("channel", "what it is", "smallest", "largest", "rms")
    channels = channel_rows(history, case)
    touched = contact_rows(summary)
    sections = [
        PageSection("", [Paragraph(sentence(history, summary, case), "verdict"), *warnings]),
        *(
            [PageSection("In motion", [film(history, case) or Paragraph(NO_FRAMES, "about")])]
            if has_laminae
            else []
        ),
        PageSection("Numbers", [Paragraph(about, "about"), table]),
        *([PageSection("Contacts", [HtmlTable(contact_heading(), touched)])] if touched else []),
        PageSection("Figures", [Gallery([embedded(p)], text, text) for p, text in figures]),
        PageSection("Channels", [HtmlTable(heading, channels)]),
        PageSection("Energy", [Paragraph(flows, "about"), energy]),
        PageSection("Files", [html.files(directory, FILES)]),
        *([PageSection("Case", [Preformatted(case.to_toml())])] if has_laminae else []),
        PageSection("Made by", [HtmlTable(("", "version"), origin)]),
    ]
    return html.page(case.title, sections, contents=True)


NO_FRAMES = "There is no film, because output.fields_per_period is 0 or the motion is not finite."


def channel_rows(history: xr.Dataset, case: Case) -> list[tuple[str, ...]]:
    """Return table rows of all channels over the window: name, meaning, smallest, largest, rms."""
    rows = []
    for name, channel in of_run(history, case).data_vars.items():
        unit, factor = shown_unit(channel.attrs["units"])
        values = finite(channel)
        if not values.size:
            continue
        numbers = (CHANNEL_MEASURES[key].of(values) for key in ("min", "max", "rms"))
        texts = (f"{shown(float(number), factor)} {unit}" for number in numbers)
        rows.append((str(name), str(channel.attrs["long_name"]), *texts))
    return rows


def energy_rows(history: xr.Dataset) -> list[tuple[str, str, str]]:
    """Return table rows [mJ]: what changed the stored energy, over the run and the last period."""
    rows = []
    for name, sign, label, _ in FLOWS:
        if f"energy_{name}" not in history:
            continue
        column = 1e3 * sign * history[f"energy_{name}"].to_numpy()
        if column.any():
            rows.append((label, _signed(column.sum(), ".4g"), _signed(column[-1], ".4g")))
    residual = 1e3 * history["energy_residual"].to_numpy()
    return [
        *rows,
        ("not accounted for", _signed(residual.sum(), ".1e"), _signed(residual[-1], ".1e")),
    ]


def _signed(value: float, form: str) -> str:
    """Return a number with its sign."""
    return f"{value:+{form}}".replace("-", "−")
