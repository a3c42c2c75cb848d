// The building as the gateway tells of it: resources by kind and id. Parts of the page are drawn again when it changes.
import { useEffect, useState } from "./ui.js";

export const KINDS = ["building", "readiness", "floor", "area", "camera", "robot", "worker", "recorder", "service", "mission", "plan", "cost", "object", "traffic", "replay", "removal"];
const REDRAW_MS = 150;

const things = Object.fromEntries(KINDS.map(kind => [kind, new Map()]));
const order = new Intl.Collator(undefined, { numeric: true }); // c2 before c10
const listeners = new Set();
const redraws = new Set();
let timer = 0;

/** All things of a kind, in the order of their ids. */
export const all = kind => [...things[kind].values()].sort((a, b) => order.compare(a.id, b.id));
export const entries = kind => [...things[kind].entries()];
export const one = (kind, id) => things[kind].get(id);

/** Calls `heard(kind, id, state)` at every change; returns what ends that. */
export function listen(heard) {
  listeners.add(heard);
  return () => listeners.delete(heard);
}

/** Takes in that a thing is now so; null: it is gone. */
export function put(kind, id, state) {
  if (!things[kind]) return; // of a newer gateway
  state === null ? things[kind].delete(id) : things[kind].set(id, state);
  for (const heard of listeners) heard(kind, id, state);
  redraw();
}

/** Forgets everything: it follows anew. */
export function clear() {
  for (const kind of KINDS) things[kind].clear();
}

/** Draws soon, once for many changes. */
export function redraw() {
  timer ||= setTimeout(() => { timer = 0; for (const draw of redraws) draw(); }, REDRAW_MS);
}

/** Has a component drawn again when anything changed. */
export function useStore() {
  const [, draw] = useState(0);
  useEffect(() => {
    const again = () => draw(n => n + 1);
    redraws.add(again);
    return () => redraws.delete(again);
  }, []);
}
