"""A figure that notebooks show without a backend of their own."""

from __future__ import annotations

from io import BytesIO

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure


class Picture(Figure):
    """A figure that is a picture where a notebook displays it."""

    def _repr_png_(self) -> bytes:
        """Return the figure as PNG, for which notebooks ask."""
        picture = BytesIO()
        FigureCanvasAgg(self).print_png(picture)
        return picture.getvalue()
