// Robots tell where they are once a second: between two poses they glide.

const GLIDE_MS = 700;

export class Poses {
  #known = new Map();

  /** The pose to draw now. */
  of(robot) {
    const now = performance.now(), [x, y] = robot.position_m, target = { x, y, yaw: robot.yaw_rad };
    const entry = this.#known.get(robot.id);
    if (!entry) { this.#known.set(robot.id, { from: target, to: target, at: -GLIDE_MS, floor: robot.floor }); return target; }
    if (entry.to.x !== x || entry.to.y !== y || entry.to.yaw !== robot.yaw_rad) {
      const jump = entry.floor !== robot.floor || Math.hypot(x - entry.to.x, y - entry.to.y) > 2;
      Object.assign(entry, { from: jump ? target : between(entry, now), to: target, at: now, floor: robot.floor });
    }
    return between(entry, now);
  }

  /** Whether anything still moves. */
  get moving() { return [...this.#known.values()].some(e => performance.now() - e.at < GLIDE_MS); }
}

function between({ from, to, at }, now) {
  if (matchMedia("(prefers-reduced-motion: reduce)").matches) return to;
  const s = Math.min(1, (now - at) / GLIDE_MS), turn = Math.atan2(Math.sin(to.yaw - from.yaw), Math.cos(to.yaw - from.yaw));
  return { x: from.x + s * (to.x - from.x), y: from.y + s * (to.y - from.y), yaw: from.yaw + s * turn };
}
