// Bytes a second, sampled once a second out of sums that only grow. Bounded: five minutes.
import { onJump } from "./replay.js";
import { entries } from "./store.js";

const KEPT = 300;
export const NUMBERS = ["offered_bytes", "delivered_bytes", "wire_sent_bytes"];
const series = new Map(); // id -> {last: {number: sum}, timeMs, points: [{offered_bytes, ...}]}

/** The rates of a source ("total", "camera/c0-1"), oldest first. */
export const ratesOf = id => series.get(id)?.points ?? [];

/** Bytes a second between two sums; a process that started anew counts from 0 again. */
export const rate = (before, now, seconds) => before == null || now == null || now < before ? 0 : (now - before) / seconds;

/** Takes the sums as they are now [ms]. */
export function sample(nowMs) {
  const seen = new Set();
  for (const [id, sums] of entries("traffic")) {
    seen.add(id);
    const known = series.get(id) ?? { last: sums, timeMs: nowMs - 1000, points: [] };
    const seconds = Math.max((nowMs - known.timeMs) / 1000, 0.2);
    known.points.push(Object.fromEntries(NUMBERS.map(n => [n, rate(known.last[n], sums[n], seconds)])));
    if (known.points.length > KEPT) known.points.shift();
    series.set(id, { last: sums, timeMs: nowMs, points: known.points });
  }
  for (const id of series.keys()) if (!seen.has(id)) series.delete(id);
}

export function startRates() {
  setInterval(() => sample(performance.now()), 1000);
  onJump(() => series.clear());
}
