"""A figure that notebooks show without a backend of their own."""

from __future__ import annotations

from io import BytesIO

from matplotlib.figure import Figure


class Picture(Figure):
    """A figure that is a picture where a notebook displays it."""

    def _repr_png_(self) -> bytes:
        """Return the figure as PNG, for which notebooks ask."""
        self.savefig(temporary := BytesIO(), format="png")
        return temporary.getvalue()
