"""The floor from above, as SVG around PNG. Everything is drawn in pixels, y down; ``_Frame`` maps the world's metres there."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from surveilnav.cli.report.coverage import Sector, azimuth, coverage
from surveilnav.cli.report.svg import data_uri, drawing, tag
from surveilnav.geometry import Grid
from surveilnav.messages import CameraInfo, ObjectRecord
from surveilnav.services.gateway.core.layers import COLOURS, colour_cells, colour_values, encode_png
from surveilnav.words import canonical

Layers = dict[str, tuple[Grid, NDArray]]

PATH, TARGET, REJECTED, CAMERA, IDLE, DECIDING = "#d6336c", "#12805c", "#a33a2b", "#6741d9", "#868e96", "#e8a200"
DOUBTED = "#495057"
_WIDTH_PX, _HEIGHT_PX = 1080.0, 760.0
_MARGIN_M, _CONE_M = 0.8, 1.2


@dataclass(frozen=True, slots=True)
class _Frame:
    """The stretch of the world that a picture shows."""

    west_m: float
    south_m: float
    east_m: float
    north_m: float

    @property
    def scale(self) -> float:
        """Pixels per metre."""
        return min(_WIDTH_PX / (self.east_m - self.west_m), _HEIGHT_PX / (self.north_m - self.south_m), 120.0)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height [px]."""
        return (self.east_m - self.west_m) * self.scale, (self.north_m - self.south_m) * self.scale

    def at(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Pixel (u, v) of a place in the world."""
        return (x_m - self.west_m) * self.scale, (self.north_m - y_m) * self.scale


@dataclass(frozen=True, slots=True)
class MapContent:
    """What a picture of one floor shows; ``path_m`` (N, 2) is the way that the robot went there. ``objects``: what somebody
    took for the ``target``."""

    target: str
    layers: Layers
    path_m: NDArray[np.float64]
    planned_m: Sequence[tuple[float, float]]
    waypoint_m: tuple[float, float] | None
    cameras: Sequence[CameraInfo]
    invoked: frozenset[str]
    deciding: frozenset[tuple[str, int]]
    objects: Sequence[ObjectRecord]
    starts: bool
    stops: bool


def map_svg(content: MapContent, title: str) -> str:
    """The joint map from above: explored, value tint, obstacles, frontiers, cameras, objects, the robot's way."""
    frame = _frame(content)
    parts = [_layer(frame, content.layers, "explored"), _layer(frame, content.layers, "value", tint=True)]
    parts += [_layer(frame, content.layers, "occupancy"), _layer(frame, content.layers, "frontier")]
    for info in content.cameras:
        parts.append(_cones(frame, info, info.camera in content.invoked, content.deciding))
    parts += [_planned(frame, content), _path(frame, content.path_m)]
    parts += [_object(frame, o, content.target) for o in content.objects]
    parts += [_camera(frame, c, c.camera in content.invoked, content.deciding) for c in content.cameras]
    parts += [_ends(frame, content), _scale_bar(frame)]
    return drawing(frame.size, parts, title)


def value_svg(content: MapContent, title: str) -> tuple[str, float, float] | None:
    """The value map with obstacles and the robot's way, and the ends of its scale; None if nothing is known."""
    if "value" not in content.layers:
        return None
    _, values = content.layers["value"]
    if not np.isfinite(values).any():
        return None
    frame = _frame(content)
    parts = [_layer(frame, content.layers, "explored"), _layer(frame, content.layers, "value")]
    parts += [_layer(frame, content.layers, "occupancy"), _path(frame, content.path_m, thin=True)]
    parts += [_object(frame, o, content.target) for o in content.objects if _is_found(o, content.target)]
    parts.append(_scale_bar(frame))
    return drawing(frame.size, parts, title), float(np.nanmin(values)), float(np.nanmax(values))


# --- parts ----------------------------------------------------------------------------------------------------


def _frame(content: MapContent) -> _Frame:
    """Everything that matters, with a margin: a home of ten metres must not drown in a map of twenty-four."""
    points = [content.path_m] if len(content.path_m) else []
    points += [np.array([c.position_m[:2]]) for c in content.cameras]
    points += [np.array([[o.center_m[0], o.center_m[1]]]) for o in content.objects]
    for name in ("explored", "occupancy"):
        if name in content.layers:
            grid, cells = content.layers[name]
            rows, cols = np.nonzero(cells)
            if len(rows):
                points.append(grid.centres_of([[rows.min(), cols.min()], [rows.max(), cols.max()]]))
    everything = np.concatenate(points) if points else np.array([[-1.0, -1.0], [1.0, 1.0]])
    everything = everything[np.isfinite(everything).all(axis=1)]
    (west, south), (east, north) = everything.min(axis=0) - _MARGIN_M, everything.max(axis=0) + _MARGIN_M
    return _Frame(float(west), float(south), float(east), float(north))


def _layer(frame: _Frame, layers: Layers, name: str, tint: bool = False) -> str:
    """A layer as PNG, cut to the frame. As a tint, values show the more the higher they are."""
    if name not in layers:
        return ""
    grid, cells = layers[name]
    low, high = grid.cells_of([[frame.west_m, frame.south_m], [frame.east_m, frame.north_m]])
    row0, col0 = (max(0, int(v)) for v in low)
    row1, col1 = min(grid.rows, int(high[0]) + 1), min(grid.cols, int(high[1]) + 1)
    if row1 <= row0 or col1 <= col0:
        return ""
    cut = cells[row0:row1, col0:col1]
    colour = COLOURS[name]
    rgba = colour_cells(cut, colour) if colour is not None else _colour_values(cells, cut, tint)
    if rgba is None:
        return ""
    r = grid.resolution_m
    x, y = frame.at(grid.origin_x_m + col0 * r, grid.origin_y_m + row1 * r)
    width, height = (col1 - col0) * r * frame.scale, (row1 - row0) * r * frame.scale
    place = {"x": x, "y": y, "width": width, "height": height}
    png = data_uri("png", encode_png(rgba))
    return tag("image", href=png, **place, class_="layer", preserveAspectRatio="none")


def _colour_values(values: NDArray, cut: NDArray, tint: bool) -> NDArray[np.uint8] | None:
    """RGBA of the stretch ``cut`` of ``values``, on the scale of them all; None if nothing is known."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return None
    low, high = float(finite.min()), float(finite.max())
    rgba, _, _ = colour_values(cut, low, high)
    if tint:
        share = (np.nan_to_num(cut, nan=low, posinf=low, neginf=low) - low) / max(high - low, 1e-9)
        rgba[..., 3] = (rgba[..., 3] * 0.75 * share).astype(np.uint8)
    return rgba


def _line(frame: _Frame, path_m: Iterable[Sequence[float]], stroke: str, stroke_width: float, **more: object) -> str:
    places = (frame.at(p[0], p[1]) for p in path_m if all(map(math.isfinite, p[:2])))
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
    style = {"stroke_linejoin": "round", "stroke_linecap": "round", **more}
    return tag("polyline", points=points, fill="none", stroke=stroke, stroke_width=stroke_width, **style)


def _path(frame: _Frame, path_m: NDArray[np.float64], thin: bool = False) -> str:
    """The way, with a chevron every two metres that says where it leads."""
    if len(path_m) < 2:
        return ""
    way = path_m.tolist()
    if thin:
        return _line(frame, way, "#fff", 2.0, stroke_dasharray="5 4", opacity=0.9)
    parts = [_line(frame, way, "#fff", 6.0), _line(frame, way, PATH, 3.2)]
    gone_m = 1.0  # the first chevron comes after a metre
    for (x0, y0), (x1, y1) in pairwise(way):
        gone_m += math.hypot(x1 - x0, y1 - y0)
        if gone_m >= 2.0:
            gone_m = 0.0
            (u, v), degrees = frame.at((x0 + x1) / 2, (y0 + y1) / 2), -math.degrees(math.atan2(y1 - y0, x1 - x0))
            place = f"translate({u:.1f} {v:.1f}) rotate({degrees:.0f})"
            chevron = "M9 0L-6 7L-2.5 0L-6 -7Z"
            parts.append(tag("path", d=chevron, transform=place, fill=PATH, stroke="#fff", stroke_width=1.5))
    return "".join(parts)


def _planned(frame: _Frame, content: MapContent) -> str:
    """Where the robot would have gone next, and the last waypoint."""
    parts = []
    if len(content.planned_m) > 1:
        parts.append(_line(frame, content.planned_m, PATH, 2.0, stroke_dasharray="2 5", opacity=0.8))
    if content.waypoint_m is not None and all(map(math.isfinite, content.waypoint_m)):
        u, v = frame.at(*content.waypoint_m)
        ring = tag("circle", cx=u, cy=v, r=8, fill="none", stroke=PATH, stroke_width=2)
        cross = tag("path", d=f"M{u - 12:.1f} {v:.1f}h24M{u:.1f} {v - 12:.1f}v24", stroke=PATH, stroke_width=1.4)
        parts.append(tag("g", "<title>last waypoint</title>", ring, cross))
    return "".join(parts)


def _ends(frame: _Frame, content: MapContent) -> str:
    if not len(content.path_m):
        return ""
    parts = []
    if content.starts:
        u, v = frame.at(*content.path_m[0])
        parts.append(tag("circle", cx=u, cy=v, r=7, fill="#fff", stroke=PATH, stroke_width=3.5))
        parts.append(_text(u + 11, v + 4, "start"))
    if content.stops:
        u, v = frame.at(*content.path_m[-1])
        square = {"x": u - 6.5, "y": v - 6.5, "width": 13, "height": 13, "rx": 2}
        parts.append(tag("rect", **square, fill=PATH, stroke="#fff", stroke_width=2))
        parts.append(_text(u + 12, v + 4, "stop"))
    return "".join(parts)


def _sector(frame: _Frame, x_m: float, y_m: float, sector: Sector, radius_m: float, **style: object) -> str:
    (u, v), r = frame.at(x_m, y_m), radius_m * frame.scale
    start, end = sector
    if end - start >= math.tau - 1e-6:
        return tag("circle", cx=u, cy=v, r=r, **style)
    (u0, v0), (u1, v1) = ((u + r * math.cos(a), v - r * math.sin(a)) for a in sector)
    arc = f"A{r:.1f} {r:.1f} 0 {int(end - start > math.pi)} 0 {u1:.1f} {v1:.1f}"
    return tag("path", d=f"M{u:.1f} {v:.1f}L{u0:.1f} {v0:.1f}{arc}Z", **style)


def _cones(frame: _Frame, info: CameraInfo, invoked: bool, deciding: frozenset[tuple[str, int]]) -> str:
    """What a camera's views cover together, a tick for each, and the views that decided as long cones."""
    x, y = info.position_m[:2]
    u, v = frame.at(x, y)
    colour, half, r = CAMERA if invoked else IDLE, info.intrinsics.hfov_rad / 2, _CONE_M * frame.scale
    soft = {"fill": colour, "fill_opacity": "0.13", "stroke": colour, "stroke_opacity": "0.35"}
    strong = {"fill": DECIDING, "fill_opacity": "0.22", "stroke": DECIDING, "stroke_width": 1.6}
    parts = [_sector(frame, x, y, sector, _CONE_M, **soft) for sector in coverage(info)]
    for view in info.views:
        if (yaw := azimuth(view)) is None:
            continue
        if (info.camera, view.view) in deciding:
            parts.append(_sector(frame, x, y, (yaw - half, yaw + half), 2.4 * _CONE_M, **strong))
        (u0, v0), (u1, v1) = ((u + f * r * math.cos(yaw), v - f * r * math.sin(yaw)) for f in (0.8, 1.0))
        parts.append(
            tag("path", d=f"M{u0:.1f} {v0:.1f}L{u1:.1f} {v1:.1f}", stroke=colour, stroke_width=1.3, opacity=0.8)
        )
    return "".join(parts)


def _camera(frame: _Frame, info: CameraInfo, invoked: bool, deciding: frozenset[tuple[str, int]]) -> str:
    u, v = frame.at(*info.position_m[:2])
    decided = any(camera == info.camera for camera, _ in deciding)
    said = "decided" if decided else "in use" if invoked else "not in use"
    parts = [f"<title>{escape(f'camera {info.camera}: {said}')}</title>"]
    if decided:
        parts.append(tag("circle", cx=u, cy=v, r=10.5, fill="none", stroke=DECIDING, stroke_width=4))
    colour = CAMERA if invoked else IDLE
    parts.append(tag("circle", cx=u, cy=v, r=6, fill=colour, stroke="#fff", stroke_width=2))
    return tag("g", *parts, _text(u + 12, v - 7, info.camera))


def _is_found(record: ObjectRecord, target: str) -> bool:
    return record.status == "confirmed" and canonical(record.label) == canonical(target)


def _object(frame: _Frame, record: ObjectRecord, target: str) -> str:
    """The object's box from above, with its label if it is confirmed as the target."""
    if not all(map(math.isfinite, (*record.center_m, *record.size_m))):
        return ""
    (x, y), (w, d) = record.center_m[:2], record.size_m[:2]
    u, v = frame.at(x - w / 2, y + d / 2)
    width, height = max(4.0, w * frame.scale), max(4.0, d * frame.scale)
    found = _is_found(record, target)
    colour = TARGET if found else REJECTED if record.status == "rejected" else DOUBTED
    style = {"fill": colour, "fill_opacity": "0.16", "stroke": colour, "stroke_width": 2.6, "rx": 2}
    said = f"#{record.id} {record.label}: {record.status}, {record.confidence:.2f}. {record.reason}"
    parts = [f"<title>{escape(said)}</title>"]
    if found:
        parts.append(tag("rect", x=u, y=v, width=width, height=height, **style))
        parts.append(_text(u + width / 2, v - 6, f"{record.label} {record.confidence:.2f}", colour, "middle"))
    else:
        parts.append(tag("rect", x=u, y=v, width=width, height=height, stroke_dasharray="5 4", **style))
    return tag("g", *parts)


def _text(u: float, v: float, text: str, colour: str = "#1c2430", anchor: str = "start") -> str:
    return tag("text", escape(text), x=u, y=v, fill=colour, text_anchor=anchor)


def _scale_bar(frame: _Frame) -> str:
    length_m = next((m for m in (10, 5, 2) if m * frame.scale < 0.25 * frame.size[0]), 1)
    u, v = 16.0, frame.size[1] - 16.0
    end = u + length_m * frame.scale
    bar = f"M{u:.1f} {v - 5:.1f}V{v:.1f}H{end:.1f}V{v - 5:.1f}"
    drawn = tag("path", d=bar, fill="none", stroke="#1c2430", stroke_width=1.8)
    return drawn + _text((u + end) / 2, v - 6, f"{length_m} m", anchor="middle")
