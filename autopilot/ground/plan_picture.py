"""A plan drawn as a map: fences, what is searched, every leg, home, north, scale and heights.

The map is in the plan's own metres, north up, one scale in both directions. Only plain strokes are used, so the same
picture comes out as SVG and as pixels (`autopilot.ground.canvas`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from shapely.geometry import LineString, Polygon

from autopilot.geo.airspace import Metres, parts
from autopilot.ground.canvas import Pen, Pixels, Point, Sheet, Svg
from autopilot.planning import Plan
from autopilot.planning.course import Leg

WIDTH_PX = 1200
MAP_LOWEST_PX, MAP_HIGHEST_PX = 420, 1300
HEAD_PX, FOOT_PX, EDGE_PX = 78, 74, 56

PAPER, INK, FAINT = "#fbfaf6", "#22303c", "#6b7780"
ROOM, ROOM_EDGE = "#e6f0e2", "#3c7a4a"
KEEP_OUT, KEEP_OUT_EDGE = "#f0b9ad", "#a93b2a"
SEEN, UNSEEN, REGION_EDGE = "#9cc4e8", "#e0463a", "#2b6ca3"
LANE, TRANSIT, LEG = "#1d5a96", "#7a5aa6", "#22303c"

PENS = {
    "leg": Pen(colour=LEG, width_px=2.2),
    "lane": Pen(colour=LANE, width_px=2.0),
    "transit": Pen(colour=TRANSIT, width_px=1.8, dash_px=(6, 4)),
    "return": Pen(colour=LEG, width_px=1.8, dash_px=(10, 6)),
}
_ROUND_LENGTHS = (1, 2, 5)


@dataclass(frozen=True, slots=True)
class Frame:
    """From metres to pixels."""

    left_m: float
    top_m: float
    px_a_metre: float
    left_px: float

    def at(self, point: Metres) -> Point:
        """Return where a point lies on the sheet."""
        x = self.left_px + (point[0] - self.left_m) * self.px_a_metre
        return x, HEAD_PX + EDGE_PX + (self.top_m - point[1]) * self.px_a_metre

    def ring(self, points: Iterable[Sequence[float]]) -> list[Point]:
        """Return where a ring's corners lie."""
        return [self.at((point[0], point[1])) for point in points]


def picture(plan: Plan, name: str, *, as_png: bool) -> bytes:
    """Return the picture of a plan; `name` is the title."""
    frame, height_px = _frame(plan)
    sheet: Sheet = (Pixels if as_png else Svg)(WIDTH_PX, height_px, PAPER)
    _fences(sheet, frame, plan)
    _searched(sheet, frame, plan)
    for leg in plan.legs:
        _leg(sheet, frame, leg)
    _names(sheet, frame, plan)
    _head(sheet, plan, name)
    _north(sheet)
    _foot(sheet, frame, plan, height_px)
    return sheet.encoded()


def _frame(plan: Plan) -> tuple[Frame, int]:
    """Fit everything that is drawn onto the sheet; return the frame and the sheet's height."""
    points = [(0.0, 0.0), plan.site.return_point, *(point for leg in plan.legs for point in leg.path)]
    points += [(east, north) for _, shape in plan.site.fences for east, north in shape.exterior.coords]
    points += [
        (east, north) for sweep in plan.sweeps for part in sweep.region.geoms for east, north in part.exterior.coords
    ]
    easts, norths = [east for east, _ in points], [north for _, north in points]
    wide_m, high_m = max(max(easts) - min(easts), 1.0), max(max(norths) - min(norths), 1.0)
    room_px = WIDTH_PX - 2 * EDGE_PX
    scale = min(room_px / wide_m, (MAP_HIGHEST_PX - 2 * EDGE_PX) / high_m)
    map_px = max(high_m * scale + 2 * EDGE_PX, MAP_LOWEST_PX)
    left_px = EDGE_PX + (room_px - wide_m * scale) / 2
    top_m = max(norths) + (map_px - 2 * EDGE_PX - high_m * scale) / 2 / scale
    return Frame(min(easts), top_m, scale, left_px), round(HEAD_PX + map_px + FOOT_PX)


def _fences(sheet: Sheet, frame: Frame, plan: Plan) -> None:
    for kind, shape in plan.site.fences:
        if kind == "INCLUSION":
            sheet.area([frame.ring(shape.exterior.coords)], ROOM, 0.75)
            sheet.line(frame.ring(shape.exterior.coords), Pen(colour=ROOM_EDGE, width_px=2.2))
    for kind, shape in plan.site.fences:
        if kind == "EXCLUSION":
            sheet.area([frame.ring(shape.exterior.coords)], KEEP_OUT, 0.8)
            for stroke in _hatching(shape, 9 / frame.px_a_metre):
                sheet.line(frame.ring(stroke), Pen(colour=KEEP_OUT_EDGE, width_px=0.8))
            sheet.line(frame.ring(shape.exterior.coords), Pen(colour=KEEP_OUT_EDGE, width_px=2.0))


def _hatching(shape: Polygon, step_m: float) -> Iterator[list[Metres]]:
    """Yield slanted strokes that fill a polygon."""
    west_m, south_m, east_m, north_m = shape.bounds
    high_m = north_m - south_m
    begin_m = west_m - high_m
    while begin_m < east_m:
        cut = LineString([(begin_m, south_m), (begin_m + high_m, north_m)]).intersection(shape)
        for piece in getattr(cut, "geoms", (cut,)):
            if isinstance(piece, LineString) and piece.length > 0:
                yield [(east, north) for east, north in piece.coords]
        begin_m += step_m * math.sqrt(2)


def _searched(sheet: Sheet, frame: Frame, plan: Plan) -> None:
    for sweep in plan.sweeps:
        for part in sweep.region.geoms:
            rings = [frame.ring(ring.coords) for ring in (part.exterior, *part.interiors)]
            sheet.area(rings, SEEN, 0.45)
            sheet.line(rings[0], Pen(colour=REGION_EDGE, width_px=1.2, dash_px=(3, 3)))
        for part in parts(sweep.unseen):
            if part.area * frame.px_a_metre**2 > 1:
                sheet.area([frame.ring(part.exterior.coords)], UNSEEN, 0.7)


def _leg(sheet: Sheet, frame: Frame, leg: Leg) -> None:
    points = [frame.at(point) for point in leg.path]
    sheet.line(points, PENS[leg.kind])
    start, end = points[0], points[-1]
    if math.dist(start, end) > 46:
        _arrow(sheet, start, end, PENS[leg.kind].colour)


def _arrow(sheet: Sheet, start: Point, end: Point, colour: str) -> None:
    """Draw a head in the middle of a leg, in the direction of flight."""
    length = math.dist(start, end)
    ahead = ((end[0] - start[0]) / length, (end[1] - start[1]) / length)
    tip = ((start[0] + end[0]) / 2 + 5 * ahead[0], (start[1] + end[1]) / 2 + 5 * ahead[1])
    back = (tip[0] - 11 * ahead[0], tip[1] - 11 * ahead[1])
    side = (-4.5 * ahead[1], 4.5 * ahead[0])
    sheet.area([[tip, (back[0] + side[0], back[1] + side[1]), (back[0] - side[0], back[1] - side[1])]], colour)


def _names(sheet: Sheet, frame: Frame, plan: Plan) -> None:
    """Write at each authored place what it is and how high; number it as in the mission."""
    ends = {leg.source: leg for leg in plan.legs if leg.kind in ("leg", "return")}
    for index, item in enumerate(plan.mission.items):
        leg = ends.get(item.id)
        if item.kind == "region_search" or leg is None or item.at is None:
            continue
        x, y = frame.at(plan.site.metres(item.at))
        words = {"return": "landing"}.get(item.kind, item.kind)
        sheet.dot((x, y), 9, "#ffffff", Pen(colour=LEG, width_px=2))
        sheet.text((x, y + 4), str(index), 11, INK, "middle")
        sheet.text((x + 14, y + 5), f"{words} {item.at.altitude_m:g} m", 13, INK)
    for sweep, leg in zip(plan.sweeps, _first_lanes(plan), strict=True):
        index = next(index for index, item in enumerate(plan.mission.items) if item.id == leg.source)
        east, north = max((corner[:2] for part in sweep.region.geoms for corner in part.exterior.coords), key=_north_of)
        x, y = frame.at((east, north))
        words = f"[{index}] search from {leg.height_m:g} m, {math.floor(1000 * sweep.coverage) / 10:g} % seen"
        sheet.text((x, y - 12), words, 15, LANE, "end" if x > WIDTH_PX / 4 else "start", bold=True)
    _home(sheet, frame.at((0.0, 0.0)))


def _north_of(point: Sequence[float]) -> float:
    return point[1]


def _first_lanes(plan: Plan) -> list[Leg]:
    """Return one lane of each search."""
    lanes: dict[str, Leg] = {}
    for leg in plan.legs:
        if leg.kind == "lane":
            lanes.setdefault(leg.source, leg)
    return list(lanes.values())


def _home(sheet: Sheet, at: Point) -> None:
    x, y = at
    house = [
        (x - 8, y + 8),
        (x - 8, y - 2),
        (x - 12, y - 2),
        (x, y - 13),
        (x + 12, y - 2),
        (x + 8, y - 2),
        (x + 8, y + 8),
    ]
    sheet.area([house], "#f2b134")
    sheet.line(house, Pen(colour=INK, width_px=1.6), closed=True)
    sheet.text((x, y + 24), "home", 13, INK, "middle", bold=True)


def _head(sheet: Sheet, plan: Plan, name: str) -> None:
    minutes, seconds = divmod(round(plan.time_s), 60)
    searched_ha = sum(region.area_m2 for region in plan.searched) / 10_000
    said = [
        f"{plan.airframe}",
        f"{len(plan.items)} items",
        f"{plan.length_m / 1000:.1f} km",
        f"{minutes} min {seconds} s",
    ]
    said += [f"{searched_ha:.1f} ha searched"] if plan.searched else []
    sheet.text((EDGE_PX, 38), name, 24, INK, bold=True)
    sheet.text((EDGE_PX, 62), ",  ".join(said), 15, FAINT)


def _north(sheet: Sheet) -> None:
    x, y = WIDTH_PX - EDGE_PX - 6, 46
    sheet.area([[(x, y - 26), (x + 9, y + 8), (x, y + 1), (x - 9, y + 8)]], INK)
    sheet.text((x, y + 26), "N", 15, INK, "middle", bold=True)


def _foot(sheet: Sheet, frame: Frame, plan: Plan, height_px: int) -> None:
    """Draw the scale bar and the legend."""
    y = height_px - 34
    length_m = _round_length(190 / frame.px_a_metre)
    left, right = EDGE_PX, EDGE_PX + length_m * frame.px_a_metre
    bar = Pen(colour=INK, width_px=2)
    sheet.line([(left, y - 6), (left, y), (right, y), (right, y - 6)], bar)
    sheet.text(
        ((left + right) / 2, y + 18),
        f"{length_m:g} m" if length_m < 1000 else f"{length_m / 1000:g} km",
        13,
        INK,
        "middle",
    )
    x = 320.0
    kinds = {leg.kind for leg in plan.legs}
    for kind, words in (("leg", "leg"), ("lane", "lane"), ("transit", "between"), ("return", "back")):
        if kind in kinds:
            sheet.line([(x, y), (x + 34, y)], PENS[kind])
            sheet.text((x + 42, y + 5), words, 13, INK)
            x += 66 + 7.2 * len(words)
    patches = [(ROOM, ROOM_EDGE, "inclusion"), (KEEP_OUT, KEEP_OUT_EDGE, "exclusion")]
    shown = {kind for kind, _ in plan.site.fences}
    marks = [patch for patch in patches if patch[2].upper() in shown]
    marks += [(SEEN, REGION_EDGE, "seen")] if plan.sweeps else []
    marks += [(UNSEEN, UNSEEN, "not seen")] if any(sweep.unseen.area > 1 for sweep in plan.sweeps) else []
    for fill, edge, words in marks:
        box = [(x, y - 8), (x + 22, y - 8), (x + 22, y + 6), (x, y + 6)]
        sheet.area([box], fill, 0.8)
        sheet.line(box, Pen(colour=edge, width_px=1.4), closed=True)
        sheet.text((x + 30, y + 5), words, 13, INK)
        x += 54 + 7.2 * len(words)


def _round_length(most_m: float) -> float:
    """Return the longest round length that fits."""
    power = 10.0 ** math.floor(math.log10(most_m))
    return max(factor * power for factor in _ROUND_LENGTHS if factor * power <= most_m)
