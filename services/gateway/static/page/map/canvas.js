// The map's canvas: draws the scene when anything changed, and says what is under the pointer.
import { all, listen } from "../store.js";
import { onTheme } from "../theme.js";
import { gestures } from "./gestures.js";
import { FloorLayers, LAYERS } from "./layers.js";
import { Poses } from "./poses.js";
import { drawScene, palette } from "./scene.js";
import { onSelection } from "./selection.js";
import { View, boxOf } from "./view.js";

const NEAR_PX = 14;

/** The map on one canvas element, from `new` to `end()`. */
export class MapCanvas {
  constructor(canvas, { onPick, onHover, onLayers }) {
    Object.assign(this, { canvas, onPick, onHover, onLayers, view: new View(), poses: new Poses(), shown: {}, floor: null, layers: null, due: false });
    this.t = palette();
    this.ends = [
      gestures(canvas, this.view, {
        changed: () => this.draw(), fit: () => this.fit(), click: (u, v) => this.onPick(this.#under(u, v)),
        hover: (u, v) => this.onHover(u == null ? null : this.#under(u, v), u, v),
      }),
      listen(() => { this.layers?.update(this.#wanted()); this.draw(); }),
      onSelection(() => this.draw()),
      onTheme(() => { this.t = palette(); this.layers?.repaint(); this.draw(); }),
    ];
    this.resizing = new ResizeObserver(() => this.#resize());
    this.resizing.observe(canvas);
  }

  end() {
    for (const end of this.ends) end();
    this.resizing.disconnect();
    this.layers?.end();
  }

  /** Shows that floor with those switches. */
  show(floor, shown) {
    this.shown = shown;
    if (floor !== this.floor) {
      this.layers?.end();
      this.floor = floor;
      this.view.own = false;
      this.layers = floor == null ? null : new FloorLayers(floor, () => { this.onLayers(this.layers); this.layers.update(this.#wanted()); this.draw(); });
    }
    this.layers?.update(this.#wanted());
    this.draw();
  }

  /** Shows everything, and follows as it grows. */
  fit() {
    this.view.own = false;
    this.draw();
  }

  zoom(factor) {
    this.view.zoom(factor);
    this.draw();
  }

  /** Draws with the next frame; as long as a robot glides, with every one. */
  draw() {
    if (this.due) return;
    this.due = true;
    requestAnimationFrame(() => {
      this.due = false;
      this.#paint();
      if (this.poses.moving) this.draw();
    });
  }

  #paint() {
    const { canvas, view } = this, c = canvas.getContext("2d"), ratio = canvas.width / view.width;
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, view.width, view.height);
    if (!view.own) {
      const box = boxOf([this.layers?.box], this.#here("camera", "robot").map(thing => thing.position_m));
      if (box) view.fit(box);
    }
    drawScene(c, view, this.t, { floor: this.floor, layers: this.layers, shown: this.shown, poses: this.poses, came: () => this.draw() });
  }

  #wanted() {
    const searched = all("mission").length > 0; // values belong to a target
    return LAYERS.filter(layer => (this.shown[layer] || layer === "explored") && (searched || layer !== "value"));
  }
  #here(...kinds) { return kinds.flatMap(all).filter(thing => thing.floor === this.floor); }

  #resize() {
    const { width, height } = this.canvas.getBoundingClientRect(), ratio = devicePixelRatio || 1;
    if (!width || !height) return;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    this.view.resize(width, height);
    this.#paint();
  }

  /** The thing under a pixel: {kind, thing}, or null. */
  #under(u, v) {
    const near = (kind, things, place) => things.map(thing => {
      const [a, b] = this.view.to(...place(thing));
      return { kind, thing, away: Math.hypot(a - u, b - v) };
    });
    const found = [
      ...near("robot", this.#here("robot"), r => r.position_m), ...near("camera", this.#here("camera"), k => k.position_m),
      ...(this.shown.objects ? near("object", this.#here("object").filter(o => o.status !== "rejected"), o => o.center_m) : []),
      ...this.#here("plan").flatMap(p => near("place", p.candidates.filter(q => q.x_m != null), q => [q.x_m, q.y_m])),
    ].filter(f => f.away < NEAR_PX).sort((a, b) => a.away - b.away);
    return found[0] ?? null;
  }
}
