"""Matplotlib's figure, shown as a picture where it is the value of a notebook's cell."""

from __future__ import annotations

import io

from matplotlib.figure import Figure


class NotebookFigure(Figure):
    """A figure that needs no pyplot to be shown.

    IPython shows those that pyplot has made, or all once pyplot has drawn something.
    """

    def _repr_png_(self) -> bytes:
        picture = io.BytesIO()
        self.savefig(picture, format="png")
        return picture.getvalue()
