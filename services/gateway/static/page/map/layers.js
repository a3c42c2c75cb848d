// Map layers: fetched when the maps of the floor changed, in the page's own colours.
import { address, part } from "../api.js";
import { all, one } from "../store.js";
import { colour } from "../theme.js";

/** From the bottom to the top. */
export const LAYERS = ["explored", "value", "occupancy", "frontier"];
const NAMES = { explored: "explored", value: "value", occupancy: "obstacles", frontier: "frontiers" };
const OPACITY = { explored: 1, value: 0.62, occupancy: 1, frontier: 0.95 };
const LEAST_MS = 1000;
export const nameOf = layer => NAMES[layer];
export const opacityOf = layer => OPACITY[layer];

/** What is loaded of one floor. `changed` is called when a picture came. */
export class FloorLayers {
  constructor(floor, changed) {
    Object.assign(this, { floor, changed, pictures: {}, problems: {}, asked: {}, askedMs: 0, timer: 0, box: null, ended: false });
  }

  /** Loads what is wanted and isn't up to date; at most once a second. */
  update(wanted) {
    const due = wanted.filter(layer => this.asked[layer] !== this.#version(layer));
    if (!due.length || this.timer || this.ended) return;
    this.timer = setTimeout(async () => {
      this.askedMs = performance.now();
      await Promise.all(due.map(layer => this.#load(layer).catch(() => { // cut off in the middle: it is asked for again
        this.problems[layer] = "the picture didn't come whole";
        delete this.asked[layer];
      })));
      this.timer = 0;
      if (!this.ended) this.changed();
    }, Math.max(0, LEAST_MS - (performance.now() - this.askedMs)));
  }

  end() {
    this.ended = true;
    clearTimeout(this.timer);
    for (const p of Object.values(this.pictures)) p.bitmap.close();
  }

  /** Colours again, for another theme. */
  repaint() { for (const [layer, p] of Object.entries(this.pictures)) p.canvas = painted(layer, p.bitmap); }

  #version(layer) {
    const floor = one("floor", this.floor);
    return `${floor?.revision} ${layer === "value" ? all("mission").map(m => m.id).sort().at(-1) : ""} ${floor?.last_seen ? "" : "?"}`;
  }

  async #load(layer) {
    this.asked[layer] = this.#version(layer);
    const answer = await fetch(address(`floors/${part(this.floor)}/layers/${layer}.png`)).catch(() => null);
    if (!answer?.ok) {
      this.problems[layer] = await problemOf(answer);
      if (answer?.status !== 422) delete this.asked[layer]; // it may be there later
      return;
    }
    // who looks shares a picture that may be of a moment ago: what it lacks is asked for a second later
    if (Number(answer.headers.get("x-surveilnav-revision")) !== one("floor", this.floor)?.revision) delete this.asked[layer];
    delete this.problems[layer];
    const [x, y, size, rows, columns] = answer.headers.get("x-surveilnav-grid").split(" ").map(Number);
    const bitmap = await createImageBitmap(await answer.blob());
    if (this.ended) return bitmap.close();
    this.pictures[layer]?.bitmap.close();
    const range = answer.headers.get("x-surveilnav-range")?.split(" ").map(Number);
    this.pictures[layer] = { bitmap, canvas: painted(layer, bitmap), box: [x, y, x + columns * size, y + rows * size], range };
    if (layer === "explored") this.box = contentOf(bitmap, x, y, size, rows) ?? this.box;
  }
}

async function problemOf(answer) {
  if (!answer) return "the gateway doesn't answer";
  return (await answer.json().catch(() => ({}))).detail ?? `HTTP ${answer.status}`;
}

/** The picture in the page's colour of its layer; values have their own. */
function painted(layer, bitmap) {
  const canvas = new OffscreenCanvas(bitmap.width, bitmap.height), c = canvas.getContext("2d");
  c.drawImage(bitmap, 0, 0);
  if (layer !== "value") {
    c.globalCompositeOperation = "source-in";
    c.fillStyle = colour(`map-${layer}`);
    c.fillRect(0, 0, canvas.width, canvas.height);
  }
  canvas.hasPrior = layer === "occupancy" && paintPrior(c, bitmap);
  return canvas;
}

/** What only a map from before has, in a colour of its own: green in the picture, where obstacles are grey. */
function paintPrior(c, bitmap) {
  const { width, height } = bitmap, prior = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
  prior.drawImage(bitmap, 0, 0);
  const picture = prior.getImageData(0, 0, width, height), { data } = picture;
  let found = false;
  for (let i = 0; i < data.length; i += 4) {
    const isPrior = data[i + 3] && data[i + 1] > data[i] + 60;
    data[i + 3] = isPrior ? 255 : 0;
    found ||= isPrior;
  }
  if (!found) return false;
  prior.putImageData(picture, 0, 0);
  prior.globalCompositeOperation = "source-in";
  prior.fillStyle = colour("map-prior");
  prior.fillRect(0, 0, width, height);
  c.globalCompositeOperation = "source-atop"; // its opacity stays
  c.drawImage(prior.canvas, 0, 0);
  return true;
}

/** The box [x0, y0, x1, y1] of what is explored: a home of 10 m mustn't drown in a map of 24 m. */
function contentOf(bitmap, x, y, size, rows) {
  const canvas = new OffscreenCanvas(bitmap.width, bitmap.height), c = canvas.getContext("2d", { willReadFrequently: true });
  c.drawImage(bitmap, 0, 0);
  const { data, width, height } = c.getImageData(0, 0, bitmap.width, bitmap.height);
  let u0 = width, u1 = -1, v0 = height, v1 = -1;
  for (let i = 3, p = 0; i < data.length; i += 4, p++) if (data[i]) {
    const u = p % width, v = (p - u) / width;
    u0 = Math.min(u0, u); u1 = Math.max(u1, u); v0 = Math.min(v0, v); v1 = Math.max(v1, v);
  }
  return u1 < 0 ? null : [x + u0 * size, y + (rows - v1 - 1) * size, x + (u1 + 1) * size, y + (rows - v0) * size];
}
