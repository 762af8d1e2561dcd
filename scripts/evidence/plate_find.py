"""Count how many delaminated plates that were never seen before are found, and how well.

Each plate has one patch: rectangle of 20 to 80 mm along both axes, anywhere, at 15 to 45 % of the
thickness. Damping is half to twice that of the case, Young's modulus up to 5 % off. A shaker drives
the plate at a point; a vibrometer scans 10 mm apart with 40 dB of noise. The harmonics of the drive
are taken away with the responses of the intact plate of the case, which does not know the errors.

    python scripts/evidence/plate_find.py [--plates 40] [--folder DIRECTORY] [--page]

Plates are computed one after another; those in DIRECTORY/plates.json are not computed again. With
--page the table and the figure of docs/evidence/plate_detection.md are written.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from delam_fem.api import Case, FloatArray, scanned_places, style
from delam_fem.studies.detection.detect import (
    drive_responses,
    in_modes,
    intact,
    per_shape,
    simulated,
)
from delam_fem.studies.detection.indices import Mark, mark
from delam_fem.studies.detection.maps import patches_of
from delam_fem.studies.detection.region import Region, marked_region
from delam_fem.studies.detection.study import Scan
from delam_fem.studies.signals.scan import Shapes, shapes_of

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs/evidence/plate_detection.md"
FIGURE = ROOT / "docs/figures/plate_find.png"
SEED = 20461
THICKNESS, LENGTH, WIDTH = 0.002, 0.2, 0.15
FREQUENCIES = (3000.0, 6000.0, 9000.0)
"""Frequencies of the excitation [Hz], chosen with plates of another seed."""
ALL = "all"
"""What the frequencies say together: a point is marked if one of them marks it."""
NOISE_DB = 40.0
INDICES = ("curvature", "V2")
SCAN = Scan(periods=64, noise_db=NOISE_DB)
MODES = 60
SETTLED = 0.05
"""Share of a free motion that is left when a record begins; what is left counts as noise."""
HEALTHY = 200
"""Noisy records of the intact plate that count false calls, at each frequency."""
ALUMINIUM = {"length": LENGTH, "width": WIDTH, "density": 2700.0}


@dataclass(frozen=True)
class Specimen:
    """A plate with one patch.

    Attributes:
        start, size: where the patch begins along x, and its lengths along x and z [m].
        low: where it begins along z [m].
        depth: thickness above it over that of the plate.
        damping: damping ratio.
        stiffness: Young's modulus over that of the case.
    """

    start: float
    low: float
    size: tuple[float, float]
    depth: float
    damping: float
    stiffness: float

    @property
    def case(self) -> Case:
        """The plate."""
        patch = {
            "between": ["lower", "upper"],
            "start": self.start,
            "end": self.start + self.size[0],
            "across": [self.low, self.low + self.size[1]],
        }
        return plate(self.depth, self.damping, self.stiffness, patch)


def plate(
    depth: float = 0.3, damping: float = 0.005, stiffness: float = 1.0, patch: object = None
) -> Case:
    """Return an aluminium plate, clamped at two edges, with a patch or without."""
    lamina = {**ALUMINIUM, "young_modulus": 70e9 * stiffness, "damping_ratio": damping}
    return Case(
        name="plate",
        lamina=[
            {"name": "lower", "thickness": THICKNESS * (1.0 - depth), **lamina},
            {"name": "upper", "thickness": THICKNESS * depth, **lamina},
        ],
        support=[{"side": "start", "kind": "clamped"}, {"side": "end", "kind": "clamped"}],
        delamination=[patch] if patch else [],
        model={"kind": "solid", "poisson": 0.33},
        mesh={"elements": 14, "across": 10},
        excitation={
            "kind": "force", "lamina": "lower", "position": [0.03, 0.05], "amplitude": 1.0,
            "frequency": FREQUENCIES[0],
        },
        contact={"law": "newton-penalty", "impulse": "consistent"},
        time={"steps_per_period": 100, "periods": 1},
        scan={"spacing": 0.01},
    )  # fmt: skip


def drawn(n: int) -> list[Specimen]:
    """Return n plates."""
    rng = np.random.default_rng(SEED)
    plates = []
    for _ in range(n):
        a, b = rng.uniform(0.02, 0.08, 2)
        start = rng.uniform(0.01, LENGTH - 0.01 - a)
        low = rng.uniform(-0.5 * WIDTH + 0.01, 0.5 * WIDTH - 0.01 - b)
        depth = rng.uniform(0.15, 0.45)
        damping = 0.005 * math.exp(rng.uniform(-math.log(2.0), math.log(2.0)))
        plates.append(
            Specimen(*(round(v, 4) for v in (start, low)), (round(a, 4), round(b, 4)),
                     round(depth, 3), damping, rng.uniform(0.95, 1.05))
        )  # fmt: skip
    return plates


def responses_of(case: Case, folder: Path) -> dict[float, dict[float, FloatArray]]:
    """Return the linear responses of the intact plate of the case, kept in the folder."""
    store = folder / "responses.npz"
    if not store.is_file():
        model = in_modes(case, MODES, folder)
        places = scanned_places(model)
        arrays = {
            f"{f:g}": drive_responses(
                model.with_overrides({"excitation.frequency": f}), "upper", places, f, (2.0,)
            )[2.0]
            for f in FREQUENCIES
        }
        np.savez(store, **arrays)
    with np.load(store) as archive:
        return {f: {2.0: archive[f"{f:g}"]} for f in FREQUENCIES}


def judged(shapes: Shapes, drive: dict[float, FloatArray]) -> dict[str, Mark]:
    """Return the marks of both indices without the harmonics of the drive."""
    clean = shapes.without_drive(drive)
    return {name: mark(name, clean) for name in INDICES}


def computed(
    specimen: Specimen, number: int, responses: dict[float, dict[float, FloatArray]]
) -> dict[str, object]:
    """Return what is found on a plate at each frequency."""
    begin = time.process_time()
    case = specimen.case
    truth = patches_of(case)
    of_frequencies: dict[str, object] = {}
    together: dict[str, list[Mark]] = {name: [] for name in INDICES}
    with tempfile.TemporaryDirectory() as folder:
        model = in_modes(case, MODES, Path(folder))
        for f in FREQUENCIES:
            field = simulated(model.with_overrides({"excitation.frequency": f}), SCAN, left=SETTLED)
            noisy = field.noisy(field.noise_of(SCAN), 1000 * number + int(f))
            shapes = shapes_of(noisy.field, noisy.times, f, noisy.x, z=noisy.z)
            marks = judged(shapes, responses[f])
            of_frequencies[f"{f:g}"] = {
                name: described(one.region, float((one.values / one.limits).max()), truth)
                for name, one in marks.items()
            }
            for name, one in marks.items():
                together[name].append(one)
    of_frequencies[ALL] = {
        name: described(
            marked_region(
                marks[0].x, marks[0].z, np.max([one.values / one.levels for one in marks], axis=0)
            ),
            max(float((one.values / one.limits).max()) for one in marks),
            truth,
        )
        for name, marks in together.items()
    }
    return {
        "start": specimen.start, "low": specimen.low, "size": specimen.size,
        "depth": specimen.depth, "damping": specimen.damping, "stiffness": specimen.stiffness,
        "found": of_frequencies, "seconds": time.process_time() - begin,
    }  # fmt: skip


def described(region: Region, over: float, truth: Region) -> dict[str, object]:
    """Return what is kept of a marked region: calls, overlap with the patch, outlines."""
    is_called = bool(region.outlines)
    return {
        "detected": is_called,
        "over": over,
        "overlap": region.overlap(truth),
        "touches": is_called and _touches(region, truth),
        "region": [outline.tolist() for outline in region.outlines],
    }


def _touches(region: Region, truth: Region) -> bool:
    """Return whether a marked region has something of the patch."""
    corners = np.concatenate(region.outlines)
    return bool(truth.contains(*corners.T).any()) or region.overlap(truth) > 0.0


def healthy(responses: dict[float, dict[float, FloatArray]]) -> dict[str, dict[str, float]]:
    """Return the share of noisy records of an intact plate, 5 % too stiff, that are called."""
    rng = np.random.default_rng(SEED + 1)
    shares: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        model = in_modes(plate(stiffness=1.05), MODES, Path(folder))
        for f in FREQUENCIES:
            field = simulated(model.with_overrides({"excitation.frequency": f}), SCAN, left=SETTLED)
            shapes = shapes_of(field.field, field.times, f, field.x, z=field.z)
            noise = per_shape(field.noise_of(SCAN), field.times.size)
            calls = dict.fromkeys(INDICES, 0)
            for _ in range(HEALTHY):
                again = shapes.noisy(noise, rng, shapes.n_lines)
                for name, one in judged(again, responses[f]).items():
                    calls[name] += one.is_detected
            shares[f"{f:g}"] = {name: count / HEALTHY for name, count in calls.items()}
    return shares


def outcome(found: dict[str, dict[str, object]]) -> str:
    """Return what an index says of a plate at one frequency: called, missed or false."""
    if not found["detected"]:
        return "missed"
    return "called" if found["touches"] else "false"


def table(data: dict[str, object]) -> str:
    """Return the table of the page."""
    plates = data["plates"]
    lines = [
        "| frequency | index | called | missed | false place | overlap, median of called | "
        "intact plates called |",
        "|---|---|---|---|---|---|---|",
    ]
    for f in [*(f"{f:g}" for f in FREQUENCIES), ALL]:
        for name in INDICES:
            results = [one["found"][f][name] for one in plates]
            if f == ALL:
                healthy_share = 1.0 - math.prod(
                    1.0 - data["healthy"][f"{g:g}"][name] for g in FREQUENCIES
                )
            else:
                healthy_share = data["healthy"][f][name]
            words = [outcome(one) for one in results]
            overlaps = [
                one["overlap"] for one, w in zip(results, words, strict=True) if w == "called"
            ]
            unit = "" if f == ALL else " Hz"
            lines.append(
                f"| {f}{unit} | `{name}` | {words.count('called')} | {words.count('missed')} | "
                f"{words.count('false')} | {np.median(overlaps) if overlaps else math.nan:.2f} | "
                f"{100.0 * healthy_share:.1f} % |"
            )
    return "\n".join(lines)


def write_page(data: dict[str, object]) -> None:
    """Write the table between its marks on the page, and the figure."""
    begin, end = "<!-- find -->", "<!-- /find -->"
    text = PAGE.read_text("utf-8")
    before, remainder = text.split(begin)
    _, after = remainder.split(end)
    count = f"{len(data['plates'])} plates, seed {SEED}:"
    PAGE.write_text(f"{before}{begin}\n{count}\n\n{table(data)}\n{end}{after}", "utf-8")
    figure, panels = style.side_by_side(2, 3.4, above=0.4)
    plates = data["plates"]
    size = [1e3 * math.sqrt(one["size"][0] * one["size"][1]) for one in plates]
    best = [one["found"][ALL]["curvature"] for one in plates]
    words = [outcome(one) for one in best]
    colours = {"called": style.BLUE, "missed": style.VERMILLION, "false": style.GREEN}
    for word, colour in colours.items():
        chosen = [k for k, w in enumerate(words) if w == word]
        panels[0].plot(
            [size[k] for k in chosen], [100.0 * plates[k]["depth"] for k in chosen], "o",
            color=colour, label=word,
        )  # fmt: skip
        panels[1].plot(
            [size[k] for k in chosen], [best[k]["over"] for k in chosen], "o", color=colour
        )
    panels[0].set(xlabel="√(area of the patch) [mm]", ylabel="depth [% of the thickness]")
    panels[1].set(xlabel="√(area of the patch) [mm]", ylabel="index over its limit", yscale="log")
    panels[1].axhline(1.0, color=style.BASE_COLOUR, ls="--")
    panels[0].legend(frameon=False)
    figure.savefig(FIGURE, dpi=110)


def main() -> None:
    """Compute plates, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plates", type=int, default=40)
    parser.add_argument("--folder", type=Path, default=Path("runs/plate_find"))
    parser.add_argument("--seconds", type=float, default=math.inf, help="begin no plate later")
    parser.add_argument("--page", action="store_true")
    options = parser.parse_args()
    begin = time.perf_counter()
    options.folder.mkdir(parents=True, exist_ok=True)
    store = options.folder / "plates.json"
    data = json.loads(store.read_text()) if store.is_file() else {"plates": [], "healthy": {}}
    responses = responses_of(intact(plate()), options.folder)
    for number, specimen in enumerate(drawn(options.plates)):
        if number < len(data["plates"]):
            continue
        data["plates"].append(computed(specimen, number, responses))
        store.write_text(json.dumps(data))
        if time.perf_counter() - begin > options.seconds:
            return
    if not data["healthy"]:
        data["healthy"] = healthy(responses)
        store.write_text(json.dumps(data))
    if options.page:
        write_page(data)


if __name__ == "__main__":
    main()
