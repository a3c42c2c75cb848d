// Keepout zones, doors and lifts: hatched where no robot is sent, outlined where one may pass.
import { label, withAlpha } from "./symbols.js";

const HATCH_PX = 9;

/** Whether no robot is sent there now. */
export const bars = area => area.kind === "keepout" || area.state === "closed";

/** What an area is, for people. */
export function nameOfArea(area) {
  const what = area.kind === "keepout" ? `keepout: ${area.name}` : `${area.kind} ${area.name}, ${area.state}`;
  return what + (area.stale ? " (old)" : "");
}

export function areaMark(c, view, area, t) {
  const outline = area.outline_m.map(([x, y]) => view.to(x, y)), ink = inkOf(area, t), passage = area.kind !== "keepout";
  c.save();
  trace(c, outline);
  c.fillStyle = withAlpha(ink, bars(area) ? 0.14 : 0.08);
  c.fill();
  if (bars(area)) hatch(c, outline, ink, view);
  c.lineWidth = passage ? 3 : 2;
  c.strokeStyle = ink;
  c.setLineDash(passage && area.state === "unknown" ? [4, 4] : []);
  c.stroke();
  c.restore();
}

/** Names in the middle of areas, else below or above, where no other name is. `taken`: boxes of names, to which theirs are added. */
export function areaNames(c, view, areas, t, taken) {
  c.font = `600 12px ${t.font}`;
  for (const area of areas) {
    const outline = area.outline_m.map(([x, y]) => view.to(x, y)), vs = outline.map(p => p[1]);
    const u = mean(outline.map(p => p[0])), half = c.measureText(nameOfArea(area)).width / 2;
    const boxes = [mean(vs), Math.max(...vs) + 10, Math.min(...vs) - 10].map(v => [u - half, v - 7, u + half, v + 7]);
    const box = boxes.find(b => !taken.some(o => o[0] < b[2] && b[0] < o[2] && o[1] < b[3] && b[1] < o[3])) ?? boxes[0];
    taken.push(box);
    label(c, nameOfArea(area), box[0], box[1] + 11, t, inkOf(area, t), 600);
  }
}

const mean = numbers => numbers.reduce((sum, n) => sum + n, 0) / numbers.length;

/** The middle [x, y] of an area. */
export const middleOf = area => [0, 1].map(i => mean(area.outline_m.map(p => p[i])));

function inkOf(area, t) {
  if (area.stale) return t.stale;
  return bars(area) ? t.bad : area.state === "open" ? t.object : t.quiet;
}

/** Lines from the lower left to the upper right, within the outline; of areas that reach far only where they are seen. */
function hatch(c, outline, ink, view) {
  const us = outline.map(p => p[0]), vs = outline.map(p => p[1]);
  const [u0, u1] = [Math.max(0, Math.min(...us)), Math.min(view.width, Math.max(...us))];
  const [v0, v1] = [Math.max(0, Math.min(...vs)), Math.min(view.height, Math.max(...vs))];
  if (u0 >= u1 || v0 >= v1) return;
  const [origin] = view.to(0, 0), h = v1 - v0, first = u0 - h - (((u0 - h - origin) % HATCH_PX) + HATCH_PX) % HATCH_PX;
  c.save();
  c.clip();
  c.beginPath();
  for (let u = first; u < u1; u += HATCH_PX) { c.moveTo(u, v1); c.lineTo(u + h, v0); }
  c.lineWidth = 1.2;
  c.strokeStyle = withAlpha(ink, 0.65);
  c.stroke();
  c.restore();
  trace(c, outline); // the hatch was the path
}

function trace(c, outline) {
  c.beginPath();
  outline.forEach((p, i) => i ? c.lineTo(...p) : c.moveTo(...p));
  c.closePath();
}
