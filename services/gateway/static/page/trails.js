// Where robots were since the page is open. Bounded: a long trail is thinned from its old end.
import { onJump } from "./replay.js";
import { listen } from "./store.js";

const MOST = 1200;
const STEP_M = 0.05;
const trails = new Map();

/** [{floor, x, y}], oldest first. */
export const trailOf = robot => trails.get(robot) ?? [];

/** Every second point of the older half goes: old ways get coarser, none is lost at once. */
export function thinned(points) {
  const half = points.length >> 1;
  return [...points.slice(0, half).filter((_, i) => i % 2 === 0), ...points.slice(half)];
}

function take(kind, id, robot) {
  if (kind !== "robot") return;
  if (!robot) return void trails.delete(id);
  const points = trailOf(id), last = points.at(-1), [x, y] = robot.position_m;
  if (last && last.floor === robot.floor && Math.hypot(x - last.x, y - last.y) < STEP_M) return;
  points.push({ floor: robot.floor, x, y });
  trails.set(id, points.length > MOST ? thinned(points) : points);
}

export function startTrails() {
  listen(take);
  onJump(() => trails.clear());
}
