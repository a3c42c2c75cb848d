// What cameras look at: outlines of their views, asked once for each camera.
import { get, part } from "../api.js";

const known = new Map(); // camera id -> {key, outlines}

/** Outlines [[x, y], ...] of a camera's views; empty until they came. `came` is called then. */
export function conesOf(camera, came) {
  const key = `${camera.position_m} ${camera.views.length}`, entry = known.get(camera.id);
  if (entry?.key === key) return entry.outlines;
  const fresh = { key, outlines: [] };
  known.set(camera.id, fresh);
  get(`cameras/${part(camera.id)}/cones`).then(
    answer => { fresh.outlines = answer.items.map(c => c.outline_m); came(); },
    () => known.delete(camera.id),
  );
  return fresh.outlines;
}
