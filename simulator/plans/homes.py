"""From a plan to a scene: the shell, the furniture in it, the stairs between its floors."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import BuildingError
from surveilnav.nouns import detect_language
from surveilnav.simulator.archive import Archive
from surveilnav.simulator.furniture.catalog import CREDITS, CatalogModel, Furniture
from surveilnav.simulator.furniture.models import Model, load_model
from surveilnav.simulator.furniture.objfile import EmptyModelError
from surveilnav.simulator.furniture.parametric import parametric_piece
from surveilnav.simulator.plans.leaves import without_leaf
from surveilnav.simulator.plans.openings import beside, is_door, is_moving_part, is_pane, is_stairs, stands_open
from surveilnav.simulator.plans.outliers import without_outliers
from surveilnav.simulator.plans.placing import Kind, Models, choose, fitted, kind_of, placed, split_kind_of
from surveilnav.simulator.plans.shell import Shell
from surveilnav.simulator.plans.stairs import IsFloor, find_transit
from surveilnav.simulator.plans.sweethome import Color, Home, Level, Piece
from surveilnav.simulator.world.labels import TARGETS, label_of, naming_text, stand_in_of
from surveilnav.simulator.world.polygons import contains
from surveilnav.simulator.world.scene import Floor, Material, Scene

_GLASS = Material("glass", (0.8, 0.9, 0.95), alpha=0.15, shininess=0.8)
_TV_STAND = "Blend Swap CC-BY#tvStand"
#: How much of the height of a television on its furniture is the furniture.
_TV_STAND_SHARE = 0.42


def build_home(
    home: Home,
    name: str,
    seed: int,
    furniture: Furniture | None,
    archive: Archive | None,
    source: str,
    models: Models = "all",
) -> Scene:
    """The scene of a plan.

    Args:
        name: of the building; with the seed it decides about everything left to chance.
        seed: chooses furniture models and floor coverings.
        furniture: the libraries, or None: parametric furniture stands in then.
        archive: the .sh3d file that the plan came in, for models and textures of its own.
        source: for people.
        models: which half of the furniture models is used.
    """
    home, notes = without_outliers(home)
    furnisher = _Furnisher(home, name, seed, furniture, archive, models)
    furnisher.builder.notes.extend(notes)
    return furnisher.scene(source)


class _Furnisher(Shell):
    """Furnishes a shell. ``scene`` runs all steps in order; the object holds what they share."""

    def __init__(
        self,
        home: Home,
        name: str,
        seed: int,
        furniture: Furniture | None,
        archive: Archive | None,
        models: Models = "all",
    ) -> None:
        super().__init__(home, name, seed, archive)
        if models != "all":
            self.builder.name += f"-{models}"
        self.furniture = furniture
        self.models = models
        self.language = detect_language(piece.name for piece in home.pieces)
        self._tinted: dict[tuple[int, Color], Material] = {}
        self._opened: dict[tuple[int, bool], Model] = {}
        self._own_models: dict[str, Model | None] = {}
        self._missing: list[str] = []

    def scene(self, source: str) -> Scene:
        """All steps, one after the other."""
        self.build_shell()
        for piece in self.home.pieces:
            self._place(piece)
        self._connect_floors()
        if self._missing:
            names = ", ".join(sorted(set(self._missing))[:8])
            self.builder.notes.append(f"{len(self._missing)} pieces have no model, simple shapes stand in: {names}")
        return self.builder.build(source)

    def _place(self, piece: Piece) -> None:
        """Finds a model for a piece, places it, and labels it.

        Pieces of a kind that is swapped get a model drawn from that kind. Others keep their own model: from the plan's file,
        else from the libraries. Where none can be had a simple shape stands in.
        """
        level = self._level(piece.level)
        entry = self.furniture.find(piece.catalog_id, piece.model) if self.furniture is not None else None
        if piece.is_opening:
            self._place_opening(piece, level, entry)
            return
        title = entry.name if entry is not None else naming_text(piece.catalog_id, piece.name)
        kind = kind_of(entry.id if entry is not None else piece.catalog_id, piece.size_m)
        named = kind.label if kind is not None else label_of(title, piece.size_m, "" if entry else self.language)
        label = "stairs" if is_stairs(piece) else named
        splits = self.models != "all" and label in TARGETS and entry is not None
        if splits and kind is None and entry is not None:
            kind = split_kind_of(entry.id, label)
        if kind is not None and self.furniture is not None and self._place_swapped(piece, level, kind):
            return
        if splits:  # its own model may belong to the other half
            self._stand_in(piece, level, label)
            return
        try:
            model = self._model_of(piece, entry)
        except EmptyModelError:
            return
        if model is None:
            self._stand_in(piece, level, label)
        else:
            self._add_own(model, piece, label, level, entry)

    def _add_own(
        self,
        model: Model,
        piece: Piece,
        label: str,
        level: Level,
        entry: CatalogModel | None,
        *,
        is_open: bool = False,
    ) -> None:
        """Adds a piece as its own model, in its own colours; a door that stands open without its leaf."""
        mesh = placed(model, piece, piece.rotation, level.z_m, lambda _, m: self._tint(m, piece))
        if is_open:
            mesh = without_leaf(mesh, piece, level.z_m)
        known_as = entry.id if entry else piece.model
        self._add(mesh, piece.name, label, level, model=known_as, room=self._room_at(piece, level))

    def _place_swapped(self, piece: Piece, level: Level, kind: Kind) -> bool:
        """Places a model of the same kind instead; False where none can be had."""
        assert self.furniture is not None
        w, d, h = piece.size_m
        on_stand = kind.name == "tv on a stand"
        low = _TV_STAND_SHARE * h
        box = (0.85 * w, min(d, 0.2), h - low) if on_stand else piece.size_m
        # Pieces of one kind and about one size look alike, as the chairs around a table do.
        key = f"{self.seed}|{self.name}|{kind.name}|{w:.1f}x{d:.1f}x{h:.1f}"
        choice = choose(kind, box, self.furniture, key, self.models)
        if choice is None:
            return False
        entry, fit = choice
        try:
            model = self.furniture.load(entry)
            if on_stand:
                self._place_tv_stand(replace(piece, size_m=(w, d, low)), level)
                piece = replace(piece, size_m=box, z_m=piece.z_m + low)
            else:
                piece = fitted(piece, entry, fit)
        except BuildingError as error:
            self.builder.notes.append(f"{entry.id} can't be read: {error}")
            return False
        mesh = placed(model, piece, entry.rotation, level.z_m)
        self._add(mesh, piece.name, kind.label, level, model=entry.id, room=self._room_at(piece, level))
        self._credit(entry.library)
        return True

    def _place_tv_stand(self, piece: Piece, level: Level) -> None:
        """The furniture below a television, where the libraries have it."""
        assert self.furniture is not None
        stand = self.furniture.by_id.get(_TV_STAND)
        if stand is not None:
            mesh = placed(self.furniture.load(stand), piece, stand.rotation, level.z_m)
            self._add(mesh, "TV stand", "", level, model=stand.id, room=self._room_at(piece, level))

    def _place_opening(self, piece: Piece, level: Level, entry: CatalogModel | None) -> None:
        label = "door" if is_door(piece) else "window"
        try:
            model = self._model_of(piece, entry)
        except EmptyModelError:
            return
        if model is None:
            if self.furniture is not None:
                self._missing.append(piece.name or piece.catalog_id)
            return  # The hole in the wall is enough.
        is_open = stands_open(piece, indoors=self._is_indoors(piece, level))
        key = (id(model), is_open)
        if key not in self._opened:
            self._opened[key] = _glazed(model.without_groups(is_moving_part) if is_open else model)
        self._add_own(self._opened[key], piece, label, level, entry, is_open=is_open)

    def _is_indoors(self, piece: Piece, level: Level) -> bool:
        """Whether there is a room with a ceiling on both sides of an opening."""
        rooms = [room.outline for room in self._rooms_at(level.z_m) if room.has_floor and room.is_roofed]
        return all(any(contains(room, p) for room in rooms for p in side) for side in beside(piece))

    def _model_of(self, piece: Piece, entry: CatalogModel | None) -> Model | None:
        """The piece's own model: from its file, else from the libraries; None where it can't be had.

        Raises:
            EmptyModelError: it is there, and there is nothing to see.
        """
        path = piece.model.lstrip("/")
        own = self._own_model(piece, path)
        if own is not None:
            return own
        if self.furniture is None:
            return None
        try:
            if entry is not None:
                self._credit(entry.library)
                return self.furniture.load(entry)
            if self.furniture.jar.fingerprint(path):
                self._credit("sweethome3d")
                return self.furniture.load_path("sweethome3d", path)
        except EmptyModelError:
            raise
        except BuildingError as error:
            self.builder.notes.append(f"the model of {piece.name!r} can't be read: {error}")
        return None

    def _own_model(self, piece: Piece, path: str) -> Model | None:
        """The model at ``path`` of the file that the plan came in; None where it can't be had."""
        if self.archive is None or not path or not self.archive.fingerprint(path):
            return None
        if path not in self._own_models:
            try:
                self._own_models[path] = load_model(path, self.archive.read)
            except EmptyModelError:
                raise
            except BuildingError as error:
                self.builder.notes.append(f"the model of {piece.name!r} can't be read: {error}")
                self._own_models[path] = None
        return self._own_models[path]

    def _stand_in(self, piece: Piece, level: Level, label: str) -> None:
        """A simple shape of the same kind and size."""
        self._missing.append(piece.name or piece.catalog_id or "unnamed")
        kind = stand_in_of(naming_text(piece.catalog_id, piece.name), label)
        size = (max(piece.size_m[0], 0.01), max(piece.size_m[1], 0.01), max(piece.size_m[2], 0.005))
        mesh = parametric_piece(kind, size, self._rng(f"stand-in|{piece.name}|{size}"))
        c, s = math.cos(piece.yaw_rad), math.sin(piece.yaw_rad)
        T = np.array(
            [[c, -s, 0, piece.x_m], [s, c, 0, piece.y_m], [0, 0, 1, level.z_m + piece.z_m], [0, 0, 0, 1]],
            dtype=np.float64,
        )
        model = f"parametric/{kind.replace(' ', '_')}"
        self._add(mesh.moved(T), piece.name, label, level, model=model, room=self._room_at(piece, level))

    def _tint(self, material: Material, piece: Piece) -> Material:
        """A material in the colour that the plan gives it; pictures keep theirs."""
        color = piece.material_colors.get(material.name.lower(), piece.color)
        if color is None or material.texture is not None or material is _GLASS:
            return material
        key = (id(material), color)
        if key not in self._tinted:
            self._tinted[key] = replace(material, color=color)
        return self._tinted[key]

    def _credit(self, library: str) -> None:
        credit = CREDITS.get(library)
        if credit is not None and credit not in self.builder.credits:
            self.builder.credits.append(credit)

    def _connect_floors(self) -> None:
        """Stairs between floors, read off the treads."""
        placed = list(zip(self.meshes, self.builder.instances, strict=True))
        solid = [mesh for mesh, i in placed if i.label not in ("floor", "ceiling")]
        for flight, name in ((mesh, i.name) for mesh, i in placed if i.label == "stairs"):
            low, high = float(flight.vertices[:, 2].min()), float(flight.vertices[:, 2].max())
            reached = [f for f in self.builder.floors if low - 0.3 < f.z_m < high - 0.3]
            if len(reached) < 2:
                continue
            lower, upper = reached[0], reached[1]
            on_floors = self._is_floor(lower), self._is_floor(upper)
            stair = find_transit(flight, solid, (lower.id, lower.z_m), (upper.id, upper.z_m), on_floors)
            if stair is not None:
                self.builder.stairs.append(stair)
            else:
                self.builder.notes.append(f"{name[:40]!r} has no steps from level {lower.id} to {upper.id}: no stair")

    def _is_floor(self, floor: Floor) -> IsFloor:
        outlines = [np.array(room.polygon_m) for room in self.builder.rooms if room.floor == floor.id]
        holes = self._holes_at(floor.z_m)

        def check(p: NDArray[np.float64]) -> bool:
            if not any(contains(outline, p) for outline in outlines):
                return False
            around = [p + 0.15 * np.array([math.cos(a), math.sin(a)]) for a in np.arange(0, 2 * math.pi, math.pi / 4)]
            return not any(contains(hole, q) for hole in holes for q in (p, *around))

        return check


def _glazed(model: Model) -> Model:
    """The model with glass in the groups that are panes."""
    panes = np.array([is_pane(name) for name in model.group_names], dtype=bool)[model.group]
    if not panes.any():
        return model
    material = np.where(panes, np.int32(len(model.materials)), model.material).astype(np.int32)
    return replace(model, material=material, materials=(*model.materials, _GLASS))
