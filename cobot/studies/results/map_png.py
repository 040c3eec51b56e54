"""A map as PNG: slices of a volume, or three views of a surface. It is drawn without a graphics library."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from cobot.robot.geometry.rays import png
from cobot.studies.results.colours import NOTHING, SCALE, colours_of, range_of
from cobot.types import Array

MAX_SLICES = 12
TILE = 220
"""Maximum width of a tile without its caption, in pixels."""
GAP, CAPTION, MARGIN = 14, 18, 16
PAPER, INK = np.array([255, 255, 255]), np.array([40, 44, 52])
BAR = 160
"""Length of the colour scale, in pixels."""
SCALE_OF_TEXT = 2
WIDTH_OF_CHARACTER = 4
_GLYPHS = (
    "0:75557 1:26227 2:71747 3:71717 4:55711 5:74717 6:74757 7:71111 8:75757 9:75717 a:25755 b:65656 c:34443 "
    "d:65556 e:74647 f:74644 g:34553 h:55755 i:72227 j:11152 k:55655 l:44447 m:57755 n:65555 o:25552 p:65644 "
    "q:25563 r:65655 s:34216 t:72222 u:55557 v:55552 w:55775 x:55255 y:55222 z:71247 .:00002 -:00700 =:07070 "
    "%:51245 /:11244"
)
"""Characters of three columns and five rows. Each row is a number with three bits."""
GLYPHS = {item[0]: item[2:] for item in _GLYPHS.split()}


def draw_map(places: Array, values: Array, title: str) -> bytes:
    """Draw a PNG file.

    Args:
        places: positions of the places, shape (n, 3), m.
        values: value at each place, shape (n,); NaN if a place is not reached.
        title: title in lower case, printed above the scale.
    """
    low, high = range_of(values)
    colours = colours_of(values, low, high)
    tiles = list(_tiles(places, colours))
    columns = min(4, len(tiles))
    rows = math.ceil(len(tiles) / columns)
    height = max(len(tile) for tile, _ in tiles) + CAPTION
    width = max(max(tile.shape[1] for tile, _ in tiles), 60)
    top = MARGIN + 44
    inner = max(columns * (width + GAP), BAR + 260)
    image = np.empty((top + rows * (height + GAP) + MARGIN, 2 * MARGIN + inner, 3), np.uint8)
    image[:] = PAPER
    _legend(image, title, low, high)
    for index, (tile, caption) in enumerate(tiles):
        row, column = divmod(index, columns)
        y, x = top + row * (height + GAP), MARGIN + column * (width + GAP)
        _write(image, caption, x, y)
        image[y + CAPTION : y + CAPTION + len(tile), x : x + tile.shape[1]] = tile
    return png(image)


def _tiles(places: Array, colours: np.ndarray) -> Iterator[tuple[np.ndarray, str]]:
    """The tiles: pictures with captions."""
    heights = np.unique(places[:, 2].round(9))
    pitch = _pitch(places[:, 0]), _pitch(places[:, 1])
    if len(heights) * 3 > len(places) or len(places) < 4:  # a surface, whose places do not share heights
        for first, second, third, name in (
            (0, 1, 2, "from above"),
            (0, 2, 1, "from -y"),
            (1, 2, 0, "from x"),
        ):
            nearest_last = np.argsort(places[:, third] * (-1.0 if name == "from -y" else 1.0), kind="stable")
            yield _dots(places[nearest_last][:, [first, second]], colours[nearest_last], None), name
        return
    chosen = heights[
        np.unique(np.linspace(0, len(heights) - 1, min(MAX_SLICES, len(heights))).round().astype(int))
    ]
    extent = places[:, :2].min(axis=0), places[:, :2].max(axis=0)
    for height in chosen:
        inside = np.abs(places[:, 2] - height) < 1e-6
        yield _dots(places[inside][:, :2], colours[inside], (*extent, pitch)), f"z = {height:.3g} m"


def _pitch(values: Array) -> float:
    """Distance between neighbouring values of a grid; 0 if there is only one value."""
    distinct = np.unique(values.round(9))
    return float(np.diff(distinct).min()) if len(distinct) > 1 else 0.0


def _dots(
    points: Array, colours: np.ndarray, grid: tuple[Array, Array, tuple[float, float]] | None
) -> np.ndarray:
    """Draw points of a plane as squares. The squares of neighbouring grid points touch each other."""
    low, high = (points.min(axis=0), points.max(axis=0)) if grid is None else grid[:2]
    size = np.maximum(high - low, 1e-9)
    steps = np.array([1e9, 1e9]) if grid is None else np.array([each or 1e9 for each in grid[2]])
    cells = np.rint(size / steps).astype(int) + 1
    if grid is None:
        side, scale = 4, (TILE - 4) / size.max()
        pixels = np.ceil(size * scale).astype(int) + side
        corner = np.floor((points - low) * scale).astype(int)
    else:
        side = int(max(1, TILE // cells.max()))
        pixels, corner = cells * side, np.rint((points - low) / steps).astype(int) * side
    image = np.full((pixels[1], pixels[0], 3), 245, np.uint8)
    for (x, y), colour in zip(corner, colours, strict=True):
        image[pixels[1] - y - side : pixels[1] - y, x : x + side] = colour
    return image


def _legend(image: np.ndarray, title: str, low: float, high: float) -> None:
    _write(image, title, MARGIN, MARGIN)
    bar = np.arange(BAR) / (BAR - 1)
    steps = np.linspace(0.0, 1.0, len(SCALE))
    for channel in range(3):
        image[MARGIN + 16 : MARGIN + 28, MARGIN : MARGIN + BAR, channel] = np.interp(
            bar, steps, SCALE[:, channel]
        )
    _write(image, f"{low:.3g}", MARGIN, MARGIN + 32)
    text = f"{high:.3g}"
    _write(image, text, MARGIN + BAR - WIDTH_OF_CHARACTER * SCALE_OF_TEXT * len(text), MARGIN + 32)
    image[MARGIN + 16 : MARGIN + 28, MARGIN + BAR + 20 : MARGIN + BAR + 32] = NOTHING
    _write(image, "not reached", MARGIN + BAR + 40, MARGIN + 17)


def _write(image: np.ndarray, text: str, x: int, y: int) -> None:
    """Write lower-case text with its upper left corner at a pixel. Parts that do not fit are cut off."""
    for place, character in enumerate(text):
        rows = GLYPHS.get(character)
        if rows is None:
            continue
        bits = np.array([[int(row) >> bit & 1 for bit in (2, 1, 0)] for row in rows], bool)
        dots = bits.repeat(SCALE_OF_TEXT, axis=0).repeat(SCALE_OF_TEXT, axis=1)
        left = x + place * WIDTH_OF_CHARACTER * SCALE_OF_TEXT
        target = image[y : y + len(dots), left : left + dots.shape[1]]
        target[dots[: len(target), : target.shape[1]]] = INK
