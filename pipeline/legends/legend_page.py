"""The page that a legend is drawn on: sizes in points, text that is measured and shortened, and the files of it."""

from __future__ import annotations

import io
import threading
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from z2p_core.coloring.scales import Color

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINTS_PER_INCH = 72
_DESIGN_DPI = 300
"""Resolution of PNG files, and at which the texts of vector files are measured."""
_FONTS = (
    "DejaVu Sans", "Noto Sans CJK SC", "Noto Sans CJK JP", "Source Han Sans SC", "WenQuanYi Micro Hei",
    "Microsoft YaHei", "Yu Gothic", "Malgun Gothic", "PingFang SC", "Hiragino Sans", "Arial Unicode MS",
)  # fmt: skip
"""The first comes with matplotlib; of the others, those that are installed have the characters that it lacks."""
_SETTINGS = {
    "svg.fonttype": "none", "svg.hashsalt": "z2p", "pdf.fonttype": 42, "pdf.compression": 6,
    "pdf.use14corefonts": False, "text.usetex": False, "text.hinting": "force_autohint", "text.antialiased": True,
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial", "Helvetica"], "savefig.bbox": None, "path.effects": [],
    "path.sketch": None,
}  # fmt: skip
"""Settings of matplotlib that hold while a legend is drawn, whatever the user's are."""
_NO_METADATA: dict[str, dict[str, None]] = {
    "png": {"Software": None},
    "svg": dict.fromkeys(("Date", "Creator", "Format", "Type")),
    "pdf": dict.fromkeys(("CreationDate", "Creator", "Producer")),
}
"""Nothing in a file tells when or by which version it was made: the same legend is the same file."""
_DESCRIPTION_KEYS = {"svg": "Description", "pdf": "Subject"}
"""Kind of file -> matplotlib's name of the entry of its metadata that holds a description."""
_SLACK = 1e-3
"""Part of a pixel by which pages are larger, as matplotlib cuts off what is left of a pixel."""
_LOCK = threading.RLock()
"""Settings of matplotlib and filters of warnings hold for a whole process."""


@contextmanager
def drawing_settings() -> Iterator[None]:
    """Inside, matplotlib draws by z2p's settings and says nothing of characters that no installed font has."""
    import matplotlib  # late: slow to import

    with _LOCK, matplotlib.rc_context(_SETTINGS), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=r".*[Gg]lyph")
        warnings.filterwarnings("ignore", message=r".*Matplotlib currently does not support")
        yield


class LegendPage:
    """A transparent page whose origin is at its upper left; lengths are points, of 1/72 inch."""

    figure: Figure

    def __init__(self, height: float, ink: Color, dpi: float = _DESIGN_DPI) -> None:
        """A page of a height, points; `ink` is the color of texts and lines, `dpi` the pixels of an inch of it.

        Its width is open until `finish`.
        """
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self.height, self.ink, self.dpi = height, ink, dpi
        self.figure = Figure(figsize=(1, height / POINTS_PER_INCH), dpi=dpi, facecolor="none", edgecolor="none")
        FigureCanvasAgg(self.figure)
        self._families = _installed_fonts()
        self._artists: list[Any] = []
        self._pictures: list[tuple[tuple[float, float, float, float], np.ndarray]] = []
        self._pixel = POINTS_PER_INCH / dpi
        self._widths: dict[tuple[str, float], float] = {}

    def snap(self, length: float) -> float:
        """The length, points, rounded to whole pixels."""
        return round(length / self._pixel) * self._pixel

    def text_width(self, text: str, size: float) -> float:
        """The width of a line of text in a font of a size, both in points."""
        from matplotlib.font_manager import FontProperties

        if (text, size) not in self._widths:
            font = FontProperties(family=self._families, size=size)
            renderer = self.figure.canvas.get_renderer()  # type: ignore[attr-defined]
            pixels = renderer.get_text_width_height_descent(text, font, ismath=False)[0]
            self._widths[text, size] = float(pixels) * self._pixel
        return self._widths[text, size]

    def shorten(self, text: str, size: float, most: float) -> str:
        """The text on one line, with an ellipsis in the place of what goes beyond a width of `most` points."""
        text = " ".join("".join(character if character.isprintable() else " " for character in text[:400]).split())
        if self.text_width(text, size) <= most:
            return text
        shortest, longest = 0, len(text)
        while shortest < longest:  # the longest beginning that fits
            middle = (shortest + longest + 1) // 2
            if self.text_width(f"{text[:middle].rstrip()}…", size) <= most:
                shortest = middle
            else:
                longest = middle - 1
        return f"{text[:shortest].rstrip()}…"

    def text(self, x: float, y: float, text: str, size: float, **alignment: Any) -> None:
        """A line of text at a point; `alignment` holds matplotlib's ``ha``, ``va`` and ``rotation``."""
        self._artists.append(self.figure.text(x, -y, text, fontsize=size, color=self.ink, family=self._families,
                                              parse_math=False, **alignment))  # fmt: skip

    def rectangle(self, box: tuple[float, float, float, float], color: Color | None, outline: float = 0) -> None:
        """A filled rectangle (left, top, width, height); with an `outline` of a width in points it has the ink's."""
        from matplotlib.patches import Rectangle

        left, top, width, height = box
        edge = self.ink if outline else "none"
        shape = Rectangle((left, -top - height), width, height, facecolor=color or "none", edgecolor=edge,
                          linewidth=outline, joinstyle="miter")  # fmt: skip
        self._artists.append(self.figure.add_artist(shape))

    def rectangles(self, boxes: Sequence[tuple[float, float, float, float]], colors: np.ndarray) -> None:
        """Filled rectangles (left, top, width, height) of colors (N, 3), the later ones over the earlier."""
        from matplotlib.collections import PolyCollection

        corners = [[(left, -top), (left + width, -top), (left + width, -top - height), (left, -top - height)]
                   for left, top, width, height in boxes]  # fmt: skip
        shapes = PolyCollection(corners, facecolors=colors, edgecolors="none", linewidths=0)
        self._artists.append(self.figure.add_artist(shapes))

    def line(self, start: tuple[float, float], end: tuple[float, float], width: float) -> None:
        """A straight line in the ink's color, of a width in points."""
        from matplotlib.lines import Line2D

        xs, ys = (start[0], end[0]), (-start[1], -end[1])
        shape = Line2D(xs, ys, color=self.ink, linewidth=width, solid_capstyle="butt")
        self._artists.append(self.figure.add_artist(shape))

    def picture(self, box: tuple[float, float, float, float], picture: np.ndarray) -> None:
        """A picture (H, W, 3 or 4) uint8 in a box (left, top, width, height), below all else; only for vector files."""
        self._pictures.append((box, picture))

    def finish(self, width: float) -> None:
        """Gives the page its width, points, rounded up to whole pixels; nothing is drawn after this."""
        from matplotlib.transforms import Affine2D

        columns, rows = np.ceil(width / self._pixel - 1e-6), round(self.height / self._pixel)
        self.figure.set_size_inches((columns + _SLACK) / self.dpi, (rows + _SLACK) / self.dpi)
        to_inches = Affine2D().scale(1 / POINTS_PER_INCH).translate(0, self.height / POINTS_PER_INCH)
        for artist in self._artists:
            artist.set_transform(to_inches + self.figure.dpi_scale_trans)
        across, down = (float(side) * POINTS_PER_INCH for side in self.figure.get_size_inches())
        for (left, top, wide, high), picture in self._pictures:
            frame = (left / across, 1 - (top + high) / down, wide / across, high / down)
            axes = self.figure.add_axes(frame, zorder=-1)
            axes.set_axis_off()
            axes.imshow(picture, interpolation="none", aspect="auto")

    def pixels(self) -> np.ndarray:
        """The page as a picture (H, W, 4) uint8, straight sRGB and alpha."""
        self.figure.canvas.draw()
        return np.array(self.figure.canvas.buffer_rgba())  # type: ignore[attr-defined]

    def encode(self, kind: str, background: Color | None, description: str = "") -> bytes:
        """The page as a file of a kind, ``png``, ``svg`` or ``pdf``; transparent without a background.

        `description` is kept in the file's metadata, but for a PNG's.
        """
        stream = io.BytesIO()
        described = {_DESCRIPTION_KEYS[kind]: description} if description and kind in _DESCRIPTION_KEYS else {}
        self.figure.savefig(stream, format=kind, dpi=self.dpi, facecolor=background or "none",
                            metadata={**_NO_METADATA[kind], **described})  # fmt: skip
        return stream.getvalue()


def _installed_fonts() -> list[str]:
    """Those of `_FONTS` that there are, the first always is; and the generic family, for viewers of SVG."""
    from matplotlib.font_manager import fontManager

    installed = {font.name for font in fontManager.ttflist}
    return [*(name for name in _FONTS if name in installed), "sans-serif"]
