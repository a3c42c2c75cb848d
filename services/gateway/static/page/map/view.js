// From the world (metres, y up) to the screen (CSS pixels, y down): a centre and a scale.

const LEAST = 4, MOST = 400; // pixels a metre

export class View {
  constructor() { this.x = 0; this.y = 0; this.scale = 40; this.width = 1; this.height = 1; this.own = false; }

  /** World to screen. */
  to(x, y) { return [this.width / 2 + (x - this.x) * this.scale, this.height / 2 - (y - this.y) * this.scale]; }
  /** Screen to world. */
  from(u, v) { return [this.x + (u - this.width / 2) / this.scale, this.y - (v - this.height / 2) / this.scale]; }

  resize(width, height) { this.width = width; this.height = height; }

  /** Moves by pixels; from then on the view is a person's own, and doesn't follow the map. */
  pan(du, dv) { this.own = true; this.x -= du / this.scale; this.y += dv / this.scale; }

  /** Zooms about a pixel, whose place in the world stays. */
  zoom(factor, u = this.width / 2, v = this.height / 2) {
    const [x, y] = this.from(u, v);
    this.own = true;
    this.scale = Math.min(MOST, Math.max(LEAST, this.scale * factor));
    this.x = x - (u - this.width / 2) / this.scale;
    this.y = y + (v - this.height / 2) / this.scale;
  }

  /** Shows a box [x0, y0, x1, y1] of the world whole. */
  fit([x0, y0, x1, y1], marginPx = 28) {
    const w = Math.max(x1 - x0, 2), h = Math.max(y1 - y0, 2);
    this.x = (x0 + x1) / 2;
    this.y = (y0 + y1) / 2;
    this.scale = Math.min(MOST, Math.max(LEAST, Math.min((this.width - 2 * marginPx) / w, (this.height - 2 * marginPx) / h)));
    this.own = false;
  }
}

/** A round length [m] that is at most `most` long: 1, 2 or 5 times a power of ten. */
export function roundLength(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  return [5, 2, 1].map(k => k * power).find(length => length <= most);
}

/** The box of boxes and points; null if there is nothing. */
export function boxOf(boxes, points) {
  const all = [...boxes.filter(Boolean), ...points.map(([x, y]) => [x, y, x, y])];
  if (!all.length) return null;
  return all.reduce((a, b) => [Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.max(a[2], b[2]), Math.max(a[3], b[3])]);
}
