// What is pointed at or chosen, on the map and beside it.
import { redraw } from "../store.js";

export const selection = { point: null, object: null, camera: null, floor: null };
const redrawMap = new Set();

/** Calls `draw` when something else is chosen. */
export function onSelection(draw) {
  redrawMap.add(draw);
  return () => redrawMap.delete(draw);
}

function changed() {
  for (const draw of redrawMap) draw();
  redraw();
}

/** Marks a place {x, y} on the map; null: none. */
export function highlight(point) { selection.point = point; changed(); }
/** Opens an object by its key, "floor/id"; null closes. */
export function chooseObject(key) { selection.object = key; changed(); }
export function chooseCamera(id) { selection.camera = id; changed(); }
export function chooseFloor(floor) { selection.floor = floor; changed(); }
