"""Descriptions of figures, and texts, compared with what stands in `tests/golden/`.

A description says what a figure shows: its panels with their scales, limits, labels and own ticks,
and each line, area, mark and text in them with its look. Arrays are told by their ends, extremes
and two means. Nothing in it depends on fonts or on where a layout puts a panel.

Somebody who changed a figure or a text on purpose looks at it, writes the stored ones anew, and
reads their difference:

    .venv/bin/python -m pytest tests/FOLDER --store
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import collections, colors, image, lines, patches, table, text, ticker
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axes._secondary_axes import SecondaryAxis
from matplotlib.axis import Axis
from matplotlib.figure import Figure, FigureBase
from matplotlib.legend import Legend
from matplotlib.spines import Spine
from scipy import sparse

from delam_fem.results.figures.style import styled
from delam_fem.system.files import json_ready

FOLDER = Path(__file__).parent / "golden"
ROUNDING = 3e-4
"""Relative. Five digits are stored, and other processors round differently."""
NOTHING = 1e-5
"""Numbers this much smaller than the largest of an array are told as 0."""
TINY = 1e-9
"""Numbers below this are round-off."""
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[+-]?\d+)?")
TIMED = re.compile(r"processor|seconds|assembly|cost of a step|needs (\| )?about")
"""What differs from run to run, and from machine to machine, as the number of cores does."""
MANY = 1_000_000
"""Sparse matrices are told by their entries up to this size."""
FEW = 6
"""Arrays of at most so many values are told in full."""


def check(name: str, found: str, *, store: bool) -> None:
    """Compare a text with the stored one, numbers up to rounding; or store it."""
    path = FOLDER / f"{name}.txt"
    new = [untimed(line) for line in found.splitlines()]
    if store:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("\n".join(new) + "\n", "utf-8")
        return
    old = [untimed(line) for line in path.read_text("utf-8").splitlines()]
    differ = [f"- {a}\n+ {b}" for a, b in zip(old, new, strict=False) if not is_same(a, b)]
    differ += [f"- {line}" for line in old[len(new) :]] + [f"+ {line}" for line in new[len(old) :]]
    assert not differ, f"{path} differs (see {Path(__file__).name}):\n" + "\n".join(differ[:40])


def untimed(line: str) -> str:
    """Return a line with plain minus signs, without its numbers if it tells how long it took."""
    line = line.rstrip().replace("−", "-")
    return NUMBER.sub("#", line) if TIMED.search(line) else line


def is_same(a: str, b: str) -> bool:
    """Return whether two lines are the same up to the rounding of their numbers."""
    if a == b:
        return True
    ours, theirs = NUMBER.findall(a), NUMBER.findall(b)
    return NUMBER.sub("", a) == NUMBER.sub("", b) and all(
        math.isclose(float(x), float(y), rel_tol=ROUNDING, abs_tol=TINY)
        for x, y in zip(ours, theirs, strict=True)
    )


def numbers(values: Any) -> str:
    """Return an array in words."""
    if values is None:
        return "None"
    array = np.ma.filled(np.ma.asarray(values, dtype=np.float64), np.nan).ravel()
    known = array[np.isfinite(array)]
    least = max(NOTHING * np.abs(known).max(initial=0.0), TINY)
    if array.size <= FEW or not known.size:
        return " ".join(f"{0.0 if abs(x) < least else x:.5g}" for x in array[:FEW])
    spread = np.cos(np.arange(array.size))[np.isfinite(array)]
    told = (known[0], known[-1], known.min(), known.max(), known.mean(), (spread * known).mean())
    return f"{array.size - known.size or ''}/{array.size}: {numbers(told)}".removeprefix("/")


def told(value: Any, name: str = "") -> str:
    """Return numbers and texts in dictionaries and lists, one a line."""
    if isinstance(value, dict):
        inner = [told(own, f"{name}.{key}") for key, own in value.items()]
        return "\n".join(filter(None, inner))
    try:
        return f"{name.lstrip('.')}: {numbers(value)}"
    except (TypeError, ValueError):
        if isinstance(value, list) and not all(isinstance(own, str) for own in value):
            return told({str(k): own for k, own in enumerate(value)}, name)
        return f"{name.lstrip('.')}: {value!r}"


def of_object(value: Any, name: str = "") -> str:
    """Return what an object holds, a line for each array, number and text in it."""
    here = f"{name.lstrip('.')}:"
    if is_dataclass(value):
        own = {field.name: getattr(value, field.name) for field in fields(value)}
        return "\n".join(of_object(inner, f"{name}.{key}") for key, inner in own.items())
    if isinstance(value, dict):
        return "\n".join(of_object(inner, f"{name}.{key}") for key, inner in value.items())
    if sparse.issparse(value):
        if value.shape[0] * value.shape[1] > MANY:  # what it makes of a vector
            shape, vector = f"{here} {value.shape} to", np.cos(np.arange(value.shape[1]))
            return f"{shape} {numbers(value @ vector)}; {numbers(value.diagonal())}"
        value = value.toarray()
    if value is None or isinstance(value, (str, bool, int)):
        return f"{here} {value!r}"
    try:
        array = np.asarray(value, dtype=np.complex128)
    except (TypeError, ValueError):
        if isinstance(value, (list, tuple)):
            lines = [of_object(inner, f"{name}.{k}") for k, inner in enumerate(value)]
            return "\n".join(lines or [f"{here} none"])
        return f"{here} {type(value).__name__}"
    shape = " × ".join(map(str, array.shape)) + (" of " if array.ndim else "")
    imaginary = f" + i {numbers(array.imag)}" if array.imag.any() else ""
    line = f"{here} {shape}{numbers(array.real)}{imaginary}"
    if array.ndim == 2 and array.size > FEW:  # rows may have different units
        scale = np.maximum(np.abs(array).max(axis=1, keepdims=True), TINY)
        line += f"; {numbers(array.real / scale)}"
    return line


def values_of(values: Any) -> str:
    """Return an array of real or complex numbers, or of texts, in words."""
    array = np.asarray(values)
    if array.dtype.kind == "c":
        return f"{numbers(array.real)}; imaginary {numbers(array.imag)}"
    return numbers(array) if array.dtype.kind in "fiub" else f"{array.ravel().tolist()}"


def of_dataset(data: Any) -> str:
    """Return the variables of a dataset with their dimensions and attributes, and its own."""
    lines = [told(dict(data.attrs))]
    for name, own in data.variables.items():
        about = ", ".join(f"{key} {value!r}" for key, value in own.attrs.items())
        kind = "" if name in data.data_vars else " coordinate"
        lines += [f"{name}{dict(own.sizes)}{kind}: {about}", f"  {values_of(own.to_numpy())}"]
    return "\n".join(filter(None, lines))


def colour(value: Any) -> str:
    """Return one colour, or all that differ, as hexadecimal numbers."""
    if value is None or (isinstance(value, str) and value in ("none", "auto")):
        return str(value)
    values = np.atleast_2d(colors.to_rgba_array(value))
    if len(np.unique(values, axis=0)) > FEW:
        return f"of {numbers(values)}"
    return "/".join(dict.fromkeys(colors.to_hex(v, keep_alpha=True) for v in values))


def of_axis(axis: Axis, limits: tuple[float, float]) -> str:
    """Return scale, limits, label and own ticks of an axis."""
    locator, form = axis.get_major_locator(), axis.get_major_formatter()
    told = f"{axis.get_scale()} {numbers(limits)} {axis.get_label_text()!r}"
    if isinstance(locator, ticker.FixedLocator):
        told += f" ticks {numbers(locator.locs)}"
    if isinstance(locator, ticker.MultipleLocator):
        told += f" every {numbers(locator.tick_values(0.5, 1.5))}"
    if isinstance(form, ticker.FixedFormatter):
        told += f" {list(form.seq)}"
    return told + ("" if axis.get_visible() else " hidden")


def look(artist: Artist, **more: Any) -> str:
    """Return what all artists have, and more."""
    label = str(artist.get_label())
    own = {
        "label": "" if label.startswith("_") else label,
        "alpha": artist.get_alpha(),
        **more,
        "z": artist.get_zorder(),
        "hidden": not artist.get_visible(),
    }
    told = (f"{k} {v}" for k, v in own.items() if v not in ("", None, False))
    return ", ".join(told)


def of_artist(a: Artist) -> Iterator[str]:
    """Yield the lines that describe an artist of a panel or figure."""
    if isinstance(a, lines.Line2D):
        marker = a.get_marker()
        has_marker = marker not in ("None", "", None)
        marks = {
            "marker": marker, "size": a.get_markersize(),
            "faces": colour(a.get_markerfacecolor()), "edges": colour(a.get_markeredgecolor()),
        } if has_marker else {}  # fmt: skip
        style = look(
            a, color=colour(a.get_color()), style=a.get_linestyle(), width=a.get_linewidth(),
            **marks, drawn="" if a.get_drawstyle() == "default" else a.get_drawstyle(),
        )  # fmt: skip
        yield f"line {style}"
        yield f"  x {numbers(a.get_xdata())}; y {numbers(a.get_ydata())}"
    elif isinstance(a, text.Text):
        if not a.get_text() and not isinstance(a, text.Annotation):
            return
        box = a.get_bbox_patch()
        boxed = f"{colour(box.get_facecolor())} {colour(box.get_edgecolor())}" if box else ""
        yield f"text {a.get_text()!r} at {numbers(a.get_position())} " + look(
            a, color=colour(a.get_color()), size=a.get_fontsize(), ha=a.get_ha(), va=a.get_va(),
            turn=a.get_rotation() or "", weight=a.get_weight(), box=boxed,
            to=numbers(a.xy) if isinstance(a, text.Annotation) else "",
            arrow=arrow(a) if isinstance(a, text.Annotation) else "",
        )  # fmt: skip
    elif isinstance(a, patches.Patch) and not isinstance(a, Spine):
        yield f"patch {a.__class__.__name__} " + look(
            a, face=colour(a.get_facecolor()), edge=colour(a.get_edgecolor()), fill=a.get_fill(),
            hatch=a.get_hatch(), width=a.get_linewidth(), style=a.get_linestyle(),
        )  # fmt: skip
        yield f"  points {numbers(corners(a))}"
    elif isinstance(a, (collections.Collection, image.AxesImage)):
        yield from of_collection(a)
    elif isinstance(a, Legend):
        place = getattr(a, "_outside_loc", None) or a._get_loc()
        yield f"legend {place}, {getattr(a, '_ncols', 1)} columns, {a.get_title().get_text()!r}"
        yield f"  {[entry.get_text() for entry in a.get_texts()]}"
    elif isinstance(a, table.Table):
        cells = sorted(a.get_celld().items())
        yield f"table {[(place, cell.get_text().get_text()) for place, cell in cells]}"


def arrow(a: text.Annotation) -> str:
    """Return the look of an annotation's arrow."""
    drawn = a.arrow_patch
    if drawn is None:
        return ""
    return (
        f"{type(drawn.get_arrowstyle()).__name__} {colour(drawn.get_edgecolor())} "
        f"{numbers([drawn.get_linewidth(), drawn.shrinkA, drawn.shrinkB])}"
    )


def of_collection(a: Any) -> Iterator[str]:
    """Yield the lines that describe marks, areas, meshes and images."""
    values = a.get_array()
    more: dict[str, Any] = {}
    if values is not None:
        kind = type(a.norm).__name__
        more = {"map": a.get_cmap().name, "norm": f"{kind} {numbers([a.norm.vmin, a.norm.vmax])}"}
        if isinstance(a.get_cmap(), colors.ListedColormap) and a.get_cmap().N < 20:
            more["of"] = colour(a.get_cmap().colors)
    if isinstance(a, image.AxesImage):
        yield "image " + look(a, extent=numbers(a.get_extent()), order=a.origin, **more)
    else:
        if values is None:
            more = {"face": colour(a.get_facecolor()), "edge": colour(a.get_edgecolor())}
        more |= {"width": numbers(a.get_linewidth()), "hatch": a.get_hatch()}
        sizes = a.get_sizes() if hasattr(a, "get_sizes") else ()
        yield "collection " + look(a, **more, sizes=numbers(sizes) if len(sizes) else "")
        paths = [path.vertices for path in a.get_paths()]
        offsets = np.ma.filled(a.get_offsets(), np.nan)
        told = np.concatenate(paths) if paths else np.zeros(0)
        yield f"  {len(paths)} paths {numbers(told)}; at {numbers(offsets)}"
    if values is not None:
        yield f"  values {numbers(values)}"


def of_panel(axes: Any) -> Iterator[str]:
    """Yield the lines that describe a panel."""
    if isinstance(axes, SecondaryAxis):
        yield f"axis {axes.get_xlabel()!r} {axes.get_ylabel()!r}"
        return
    place = axes.get_subplotspec()
    where = ""
    if place is not None:
        grid = place.get_gridspec()
        sizes = [numbers(r) for r in (grid.get_height_ratios(), grid.get_width_ratios())]
        where = f" {place.rowspan.start}:{place.rowspan.stop}, {place.colspan.start}:"
        where += f"{place.colspan.stop} of {sizes[0]} × {sizes[1]}"
    elif axes.get_label() != "<colorbar>":
        where = f" at {numbers(axes.get_position(original=True).bounds)}"
    titles = [axes.get_title(side) for side in ("left", "center", "right")]
    yield f"panel{where} {next(filter(None, titles), '')!r}"
    if axes.get_label() == "<colorbar>":
        yield f"  bar {axes.get_xlabel()!r} {axes.get_ylabel()!r}"
        yield from (f"  {told}" for a in axes.lines for told in of_artist(a))
        return
    for name, axis in (("x", axes.xaxis), ("y", axes.yaxis)):
        yield f"  {name} {of_axis(axis, getattr(axes, f'get_{name}lim')())}"
    if not axes.axison or axes.get_aspect() != "auto":
        yield f"  axes {axes.axison}, aspect {axes.get_aspect()}"
    for kind, own in groupby(axes.get_children(), like):
        artists = list(own)
        if kind and len(artists) > 2:
            yield f"  {len(artists)} of {kind}"
            yield f"    points {numbers([corners(a) for a in artists])}"
            continue
        for a in artists:
            if isinstance(a, (Axes, SecondaryAxis)):
                yield from (f"  {told}" for told in of_panel(a))
            elif a in (axes.title, axes._left_title, axes._right_title):
                if a.get_text():  # its place is found with the layout
                    yield f"  title {colour(a.get_color())}, size {a.get_fontsize():g}"
            elif a is not axes.patch:
                yield from (f"  {told}" for told in of_artist(a))


def like(a: Artist) -> str:
    """Return the look of a rectangle without a label, by which it is told with others; or ""."""
    is_alike = isinstance(a, patches.Rectangle) and str(a.get_label()).startswith("_")
    return next(of_artist(a)) if is_alike else ""


def corners(a: patches.Patch) -> Any:
    """Return the points of a patch in the panel."""
    return a.get_patch_transform().transform(a.get_path().vertices)


def describe(figure: FigureBase) -> str:
    """Return the description of a figure."""
    told = []
    if isinstance(figure, Figure):
        told.append(f"figure {numbers(figure.get_size_inches())} in")
    for a in figure.get_children():
        if isinstance(a, FigureBase):
            told += ["subfigure", *(f"  {line}" for line in describe(a).splitlines())]
        elif isinstance(a, Axes):
            told += of_panel(a)
        elif a is figure._suptitle:
            told.append(f"title {a.get_text()!r}")
        elif a is not figure.patch:
            told += of_artist(a)
    return "\n".join(told)


def of_report(report: Any) -> str:
    """Return what a study says of its result."""
    tables = {f"table {t.title}": [list(t.heading), *map(list, t.rows)] for t in report.tables}
    said = {"said": list(report.sentences), "remarks": list(report.remarks), "left": report.left}
    captions = {f"caption {name}": caption for name, (_, caption) in report.pictures.items()}
    parts = {"title": report.title, **said, **tables, **captions}
    lines = [f"{name}: {row}" for name, own in parts.items() for row in as_lines(own)]
    return "\n".join([*lines, told(json_ready(report.numbers or {}), "numbers")])


def of_finding(report: Any) -> str:
    """Return what a study says of its result, and its pictures; nothing is written."""
    with styled():
        drawn = [describe(draw()) for draw, _ in report.pictures.values()]
    return "\n\n".join([of_report(report), *drawn])


def of_page(page: str) -> str:
    """Return what a page says and links to, a line for each piece; not its scripts and pictures."""
    text = re.sub(r"<(script|style).*?</\1>", "", page, flags=re.DOTALL)
    text = re.sub(r"data:[^\"]*", "data", text)
    return "\n".join(filter(None, map(str.strip, text.replace("<", "\n<").splitlines())))


def spoken(output: str) -> str:
    """Return what a command prints, without the frames of its tables and the working folder."""
    frames = re.compile("[─━│┃┏┳┓┗┛┡┩┌┐└┘├┤┬┴┼╇╭╮╰╯]+")
    output = frames.sub(" | ", output.replace(str(Path.cwd()), "."))
    lines = (" ".join(line.split()) for line in output.splitlines())
    return "\n".join(line for line in lines if line.strip("| "))


def as_lines(value: Any) -> list[str]:
    """Return the entries of a list, or a text, as single lines."""
    entries = value if isinstance(value, list) else [value]
    return [" | ".join(own) if isinstance(own, list) else str(own) for own in entries]


def of_scene(plotter: Any) -> str:
    """Return the description of a scene of pyvista: its cameras, bodies and texts."""
    told_ = []
    for renderer in plotter.renderers:
        camera = renderer.camera
        view = [camera.position, camera.focal_point, camera.up]
        told_.append(f"view {numbers(renderer.viewport)}, camera {'; '.join(map(numbers, view))}")
        told_.append(f"  half the height {numbers(camera.parallel_scale)}")
        told_ += [line for actor in renderer.actors.values() for line in of_actor(actor)]
    return "\n".join(told_)


def of_actor(actor: Any) -> Iterator[str]:
    """Yield the lines that describe a body or a text of a scene."""
    mesh = getattr(getattr(actor, "mapper", None), "dataset", None)
    if mesh is not None:
        look, mapper = actor.prop, actor.mapper
        shades = [look.ambient, look.diffuse, look.specular, look.opacity, look.line_width]
        yield f"body {look.color.hex_rgba}, shades {numbers(shades)}, lit {look.lighting}"
        middle = np.asarray(mesh.points).mean(axis=0)
        yield f"  {mesh.n_cells} cells within {numbers(mesh.bounds)} about {numbers(middle)}"
        if mapper.scalar_visibility:
            values = np.sort(mesh.active_scalars)
            yield f"  values {numbers(values)}, colours {numbers(mapper.scalar_range)}"
    elif hasattr(actor, "GetNumberOfEntries"):
        entries = range(actor.GetNumberOfEntries())
        names = [(actor.GetEntryString(k), numbers(actor.GetEntryColor(k))) for k in entries]
        place = [actor.GetPosition(), actor.GetPosition2()]
        yield f"legend {names} at {'; '.join(map(numbers, place))}"
    elif hasattr(actor, "GetTitle"):
        place = [actor.GetPosition(), actor.GetPosition2()]
        yield f"bar {actor.GetTitle()!r} at {'; '.join(map(numbers, place))}"
        yield f"  {actor.GetNumberOfLabels()} labels {actor.GetLabelFormat()}"
    elif hasattr(actor, "GetInput"):
        style = actor.GetTextProperty()
        told = [actor.GetPosition(), [style.GetFontSize()], style.GetColor()]
        yield f"text {actor.GetInput()!r} at {'; '.join(map(numbers, told))}"
