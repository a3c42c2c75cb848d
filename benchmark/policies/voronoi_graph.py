"""The generalised Voronoi graph of free space: where ways part, and which of these places neighbour each other.

The diagram (Choset & Burdick 1995, https://doi.org/10.1109/ROBOT.1995.525510) is the set of places with two nearest obstacles.
Here it is the thinned free space (Zhang & Suen 1984, https://doi.org/10.1145/357994.358023), which has the same branches.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

Cell = tuple[int, int]
#: Around a cell, clockwise from north.
_AROUND = ((-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1))


@dataclass(frozen=True, slots=True, eq=False)
class VoronoiGraph:
    """Nodes and the ways between neighbours.

    Attributes:
        nodes: where three or more ways part, or one ends.
        ways: by pair of neighbouring nodes, in both directions, the cells from one to the other, both ends included.
        nearest: int32 of the map's shape: the node that each free cell is nearest to, along free cells; -1: there is none.
    """

    nodes: list[Cell]
    ways: dict[tuple[int, int], list[Cell]]
    nearest: NDArray[np.int32]

    def routes(self, start: int) -> dict[int, list[int]]:
        """The nodes on the shortest way from ``start`` to each node that a way leads to, both included, the nearest first."""
        neighbours: dict[int, list[tuple[int, int]]] = {}
        for (a, b), way in self.ways.items():
            neighbours.setdefault(a, []).append((b, len(way)))
        length, routes, left = {start: 0}, {start: [start]}, {start}
        done: dict[int, list[int]] = {}
        while left:
            node = min(left, key=lambda i: (length[i], i))
            left.discard(node)
            done[node] = routes[node]
            for other, cells in neighbours.get(node, ()):
                if other not in done and length[node] + cells < length.get(other, 1 << 30):
                    length[other], routes[other] = length[node] + cells, [*routes[node], other]
                    left.add(other)
        return done

    def cells_along(self, route: list[int]) -> list[Cell]:
        """The cells of a route of nodes; of a single node, its own."""
        return [cell for pair in itertools.pairwise(route) for cell in self.ways[pair]] or [
            self.nodes[i] for i in route
        ]


def voronoi_graph(free: NDArray[np.bool_]) -> VoronoiGraph:
    """The graph of free space (rows, cols); what lies beyond the array is not free."""
    lines = thinned(free)
    crossings = np.where(lines, _crossings(lines), 0)
    marked = lines & ((crossings >= 3) | (crossings == 1))
    marked |= lines & (_neighbours(lines) == 0)
    around = cv2.dilate(marked.astype(np.uint8), np.ones((3, 3), np.uint8))  # so that no line slips past a node
    _, labels = cv2.connectedComponents(around * lines, connectivity=8)
    nodes = [_middle(np.argwhere(labels == n)) for n in range(1, int(labels.max()) + 1)]
    ways: dict[tuple[int, int], list[Cell]] = {}
    for a in range(len(nodes)):
        for cells in _ways_from(a + 1, nodes[a], lines, labels):
            b = int(labels[cells[-1]]) - 1
            if len(cells) < len(ways.get((a, b), [*cells, cells[0]])):
                ways[a, b], ways[b, a] = [*cells[:-1], nodes[b]], [nodes[b], *cells[-2::-1]]
    return VoronoiGraph(nodes, ways, _nearest(nodes, free))


def thinned(free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Lines of one cell's width in the middle of free space, connected as it is."""
    left = np.pad(free, 1).astype(np.uint8)
    tables = _thinning_tables()
    while True:
        before = int(left.sum())
        for table in tables:
            left[table[_code(left)] & (left != 0)] = 0
        if int(left.sum()) == before:
            return np.asarray(left[1:-1, 1:-1] != 0)


def _code(cells: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Which of the eight cells around each are set, a bit for each of ``_AROUND``."""
    code = np.zeros_like(cells)
    for bit, (row, col) in enumerate(_AROUND):
        code |= np.roll(cells, (-row, -col), axis=(0, 1)) << bit
    return code


@lru_cache(maxsize=1)
def _thinning_tables() -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """By code, whether a cell is taken away in the first and in the second half of a round."""
    first, second = np.zeros(256, bool), np.zeros(256, bool)
    for code in range(256):
        p = [code >> bit & 1 for bit in range(8)]
        north, east, south, west = p[0], p[2], p[4], p[6]
        if 2 <= sum(p) <= 6 and _transitions(code) == 1:
            first[code] = not (north and east and south) and not (east and south and west)
            second[code] = not (north and east and west) and not (north and south and west)
    return first, second


def _transitions(code: int) -> int:
    """How often a set cell follows an unset one around."""
    p = [code >> bit & 1 for bit in range(8)]
    return sum(p[i] == 0 and p[(i + 1) % 8] == 1 for i in range(8))


def _crossings(lines: NDArray[np.bool_]) -> NDArray[np.int64]:
    """How many lines meet at each cell."""
    table = np.array([_transitions(code) for code in range(256)])
    return np.asarray(table[_code(np.pad(lines, 1).astype(np.uint8))][1:-1, 1:-1])


def _neighbours(lines: NDArray[np.bool_]) -> NDArray[np.int64]:
    table = np.array([code.bit_count() for code in range(256)])
    return np.asarray(table[_code(np.pad(lines, 1).astype(np.uint8))][1:-1, 1:-1])


def _middle(cells: NDArray[np.int64]) -> Cell:
    row, col = cells[np.argmin(((cells - cells.mean(axis=0)) ** 2).sum(axis=1))]
    return int(row), int(col)


def _ways_from(label: int, node: Cell, lines: NDArray[np.bool_], labels: NDArray[np.int32]) -> Iterator[list[Cell]]:
    """The cells from a node along each line to the next node, by breadth-first search; each next node once."""
    came: dict[Cell, Cell | None] = {node: None}
    queue = deque([node])
    met = set()
    while queue:
        cell = queue.popleft()
        at = int(labels[cell])
        if at not in (0, label):
            if at not in met:
                met.add(at)
                yield _traced(cell, came)
            continue
        for row, col in _AROUND:
            beside = cell[0] + row, cell[1] + col
            inside = 0 <= beside[0] < lines.shape[0] and 0 <= beside[1] < lines.shape[1]
            if inside and lines[beside] and beside not in came:
                came[beside] = cell
                queue.append(beside)


def _traced(cell: Cell, came: dict[Cell, Cell | None]) -> list[Cell]:
    cells, at = [cell], came[cell]
    while at is not None:
        cells.append(at)
        at = came[at]
    return cells[::-1]


def _nearest(nodes: list[Cell], free: NDArray[np.bool_]) -> NDArray[np.int32]:
    """See ``VoronoiGraph.nearest``: all nodes spread at the same speed."""
    label = np.zeros(free.shape, np.uint16)
    for n, cell in enumerate(nodes, 1):
        label[cell] = n
    around = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    while True:
        spread = np.where(free & (label == 0), cv2.dilate(label, around), label)
        if np.array_equal(spread, label):
            return label.astype(np.int32) - 1
        label = spread
