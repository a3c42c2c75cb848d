// What every map has: a grid of metres, a north arrow, a scale bar.
import { label } from "./symbols.js";
import { roundLength } from "./view.js";

export function metreGrid(c, view, t) {
  const step = [1, 5, 10].find(s => s * view.scale > 26) ?? 50;
  const [x0, y1] = view.from(0, 0), [x1, y0] = view.from(view.width, view.height);
  c.strokeStyle = t.line;
  c.lineWidth = 1;
  c.beginPath();
  for (let x = Math.ceil(x0 / step) * step; x <= x1; x += step) { const [u] = view.to(x, 0); c.moveTo(Math.round(u) + 0.5, 0); c.lineTo(Math.round(u) + 0.5, view.height); }
  for (let y = Math.ceil(y0 / step) * step; y <= y1; y += step) { const [, v] = view.to(0, y); c.moveTo(0, Math.round(v) + 0.5); c.lineTo(view.width, Math.round(v) + 0.5); }
  c.stroke();
}

/** North is +y of the world, which every map has up. */
export function northArrow(c, view, t) {
  const u = view.width - 26, v = 22;
  c.fillStyle = t.ink;
  c.beginPath();
  c.moveTo(u, v - 12); c.lineTo(u + 7, v + 9); c.lineTo(u, v + 4); c.lineTo(u - 7, v + 9); c.closePath();
  c.fill();
  c.textAlign = "center";
  label(c, "N", u, v + 24, t, t.ink, 700);
  c.textAlign = "start";
}

export function scaleBar(c, view, t) {
  const length = roundLength(130 / view.scale), w = length * view.scale, u = 16, v = view.height - 16;
  c.strokeStyle = t.paper;
  for (const [ink, width] of [[t.paper, 5], [t.ink, 2]]) {
    c.strokeStyle = ink;
    c.lineWidth = width;
    c.beginPath();
    c.moveTo(u, v - 5); c.lineTo(u, v); c.lineTo(u + w, v); c.lineTo(u + w, v - 5);
    c.stroke();
  }
  label(c, length >= 1 ? `${length} m` : `${Math.round(length * 100)} cm`, u + 6, v - 7, t);
}
