"""Two sheets to draw on with the same strokes: SVG written by hand, and pixels through OpenCV.

Coordinates are pixels from the upper left. Colours are "#rrggbb". A sheet knows nothing of what is drawn on it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol
from xml.sax.saxutils import escape, quoteattr

import numpy as np

Point = tuple[float, float]
FONT = "DejaVu Sans, Helvetica, Arial, sans-serif"


@dataclass(frozen=True, slots=True, kw_only=True)
class Pen:
    """How a line is drawn."""

    colour: str
    width_px: float = 1.5
    dash_px: tuple[float, float] | None = None  # on, off


class Sheet(Protocol):
    """What can be drawn."""

    def area(self, rings: Sequence[Sequence[Point]], fill: str, opacity: float = 1.0) -> None:
        """Fill between rings (even-odd)."""

    def line(self, points: Sequence[Point], pen: Pen, *, closed: bool = False) -> None:
        """Draw straight pieces through points."""

    def dot(self, centre: Point, radius_px: float, fill: str, pen: Pen | None = None) -> None:
        """Fill a circle, and draw its rim."""

    def text(
        self, at: Point, words: str, size_px: float, colour: str, anchor: str = "start", bold: bool = False
    ) -> None:
        """Write words on a base line; `anchor` is start, middle or end. A light rim keeps them readable on lines."""

    def encoded(self) -> bytes:
        """Return the file."""


class Svg:
    """A sheet that is text."""

    def __init__(self, width_px: int, height_px: int, paper: str) -> None:
        self._paper = paper
        self._parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width_px} {height_px}" width="{width_px}" '
            f'height="{height_px}" font-family={quoteattr(FONT)}>',
            f'<rect width="{width_px}" height="{height_px}" fill="{paper}"/>',
        ]

    def area(self, rings: Sequence[Sequence[Point]], fill: str, opacity: float = 1.0) -> None:
        """Fill between rings (even-odd)."""
        path = " ".join(f"M{_points(ring, ' ')}Z" for ring in rings)
        self._parts.append(f'<path d="{path}" fill="{fill}" fill-rule="evenodd" fill-opacity="{opacity:g}"/>')

    def line(self, points: Sequence[Point], pen: Pen, *, closed: bool = False) -> None:
        """Draw straight pieces through points."""
        name = "polygon" if closed else "polyline"
        self._parts.append(
            f'<{name} points="{_points(points, " ")}" fill="none" {_stroke(pen)} stroke-linejoin="round"/>'
        )

    def dot(self, centre: Point, radius_px: float, fill: str, pen: Pen | None = None) -> None:
        """Fill a circle, and draw its rim."""
        rim = f" {_stroke(pen)}" if pen else ""
        self._parts.append(f'<circle cx="{centre[0]:.1f}" cy="{centre[1]:.1f}" r="{radius_px:g}" fill="{fill}"{rim}/>')

    def text(
        self, at: Point, words: str, size_px: float, colour: str, anchor: str = "start", bold: bool = False
    ) -> None:
        """Write words on a base line, with a rim of paper."""
        form = f'font-size="{size_px:g}" fill="{colour}" text-anchor="{anchor}"' + (
            ' font-weight="bold"' if bold else ""
        )
        rim = f'stroke="{self._paper}" stroke-width="3" stroke-linejoin="round" paint-order="stroke"'
        self._parts.append(f'<text x="{at[0]:.1f}" y="{at[1]:.1f}" {form} {rim}>{escape(words)}</text>')

    def encoded(self) -> bytes:
        """Return the SVG."""
        return ("\n".join([*self._parts, "</svg>"]) + "\n").encode()


class Pixels:
    """A sheet of pixels, twice as fine as it is asked for, and brought back smoothly."""

    _FINER = 2

    def __init__(self, width_px: int, height_px: int, paper: str) -> None:
        import cv2  # heavy, and only a PNG needs it

        self._cv2: Any = cv2
        self._paper = paper
        self._size = (width_px, height_px)
        shape = (height_px * self._FINER, width_px * self._FINER, 3)
        self._image: Any = np.full(shape, _bgr(paper), dtype=np.uint8)
        face = getattr(cv2, "FontFace", None)  # OpenCV 5 has fonts; before it there are strokes
        self._face = None if face is None else face("sans")

    def area(self, rings: Sequence[Sequence[Point]], fill: str, opacity: float = 1.0) -> None:
        """Fill between rings (even-odd)."""
        over = self._image.copy()
        self._cv2.fillPoly(over, [self._fixed(ring) for ring in rings], _bgr(fill), self._cv2.LINE_AA, _SHIFT)
        self._image = self._cv2.addWeighted(over, opacity, self._image, 1 - opacity, 0)

    def line(self, points: Sequence[Point], pen: Pen, *, closed: bool = False) -> None:
        """Draw straight pieces through points."""
        whole = [*points, points[0]] if closed else list(points)
        pieces = [whole] if pen.dash_px is None else list(_dashes(whole, pen.dash_px))
        self._cv2.polylines(
            *(self._image, [self._fixed(piece) for piece in pieces], False, _bgr(pen.colour)),
            *(max(1, round(pen.width_px * self._FINER)), self._cv2.LINE_AA, _SHIFT),
        )

    def dot(self, centre: Point, radius_px: float, fill: str, pen: Pen | None = None) -> None:
        """Fill a circle, and draw its rim."""
        at = tuple(int(part) for part in self._fixed([centre])[0])
        radius = round(radius_px * self._FINER * (1 << _SHIFT))
        aa = self._cv2.LINE_AA
        self._cv2.circle(self._image, at, radius, _bgr(fill), -1, aa, _SHIFT)
        if pen is not None:
            width = max(1, round(pen.width_px * self._FINER))
            self._cv2.circle(self._image, at, radius, _bgr(pen.colour), width, aa, _SHIFT)

    def text(
        self, at: Point, words: str, size_px: float, colour: str, anchor: str = "start", bold: bool = False
    ) -> None:
        """Write words on a base line, with a rim of paper."""
        if self._face is None:
            self._strokes(at, words, size_px, colour, anchor, bold)
            return
        size, weight = round(size_px * self._FINER), 700 if bold else 400
        origin = (round(at[0] * self._FINER), round(at[1] * self._FINER))
        box = self._cv2.getTextSize((1, 1), words, (0, 0), self._face, size, weight)
        left = origin[0] - round(_SHARE[anchor] * box[2])
        rim = self._FINER
        around = [(dx, dy) for dx in (-rim, 0, rim) for dy in (-rim, 0, rim) if (dx, dy) != (0, 0)]
        for dx, dy in around:
            place = (left + dx, origin[1] + dy)
            self._cv2.putText(self._image, words, place, _bgr(self._paper), self._face, size, weight)
        self._cv2.putText(self._image, words, (left, origin[1]), _bgr(colour), self._face, size, weight)

    def _strokes(self, at: Point, words: str, size_px: float, colour: str, anchor: str, bold: bool) -> None:
        """Write with the plotter's letters that every OpenCV has, which know ASCII alone."""
        plain = words.encode("ascii", "replace").decode()
        font, scale, width = self._cv2.FONT_HERSHEY_SIMPLEX, size_px * self._FINER / 32, 3 if bold else 2
        (wide, _), _ = self._cv2.getTextSize(plain, font, scale, width)
        place = (round(at[0] * self._FINER - _SHARE[anchor] * wide), round(at[1] * self._FINER))
        aa = self._cv2.LINE_AA
        self._cv2.putText(self._image, plain, place, font, scale, _bgr(self._paper), width + 5, aa)
        self._cv2.putText(self._image, plain, place, font, scale, _bgr(colour), width, aa)

    def encoded(self) -> bytes:
        """Return the PNG."""
        small = self._cv2.resize(self._image, self._size, interpolation=self._cv2.INTER_AREA)
        _, data = self._cv2.imencode(".png", small)
        return bytes(data)

    def _fixed(self, points: Sequence[Point]) -> Any:
        scale = self._FINER * (1 << _SHIFT)
        return np.array([[round(x * scale), round(y * scale)] for x, y in points], dtype=np.int32)


_SHIFT = 4  # bits behind the point in OpenCV's coordinates
_SHARE = {"start": 0.0, "middle": 0.5, "end": 1.0}


def _bgr(colour: str) -> tuple[int, int, int]:
    return int(colour[5:7], 16), int(colour[3:5], 16), int(colour[1:3], 16)


def _points(points: Sequence[Point], between: str) -> str:
    return between.join(f"{x:.1f},{y:.1f}" for x, y in points)


def _stroke(pen: Pen) -> str:
    dash = f' stroke-dasharray="{pen.dash_px[0]:g} {pen.dash_px[1]:g}"' if pen.dash_px else ""
    return f'stroke="{pen.colour}" stroke-width="{pen.width_px:g}"{dash}'


def _dashes(points: Sequence[Point], dash_px: tuple[float, float]) -> Iterator[list[Point]]:
    """Yield the drawn pieces of a dashed line; a dash that meets a corner goes around it in two pieces."""
    on, period = dash_px[0], sum(dash_px)
    gone = 0.0  # along the whole line
    for one, other in pairwise(points):
        length = math.dist(one, other)
        at = 0.0
        while at < length:
            phase = (gone + at) % period
            step = max((on if phase < on else period) - phase, 1e-6)
            end = min(at + step, length)
            if phase < on:
                yield [_between(one, other, at / length), _between(one, other, end / length)]
            at = end
        gone += length


def _between(one: Point, other: Point, part: float) -> Point:
    return one[0] + part * (other[0] - one[0]), one[1] + part * (other[1] - one[1])
