// The joint cloud in 3D, with who is in it. Loaded when somebody opens it; holds one cloud of a bounded size.
import { address, ask, part } from "../api.js";
import { label } from "../map/symbols.js";
import { palette } from "../map/scene.js";
import { all, listen, one } from "../store.js";
import { onTheme } from "../theme.js";
import { trailOf } from "../trails.js";
import { gestures } from "../map/gestures.js";
import { readNpy } from "./npy.js";
import { Orbit } from "./orbit.js";
import { Points } from "./points.js";

const MOST = matchMedia("(max-width: 699px)").matches ? 30000 : 100000;
const AGAIN_MS = 10000;

/** The view on two canvases above each other: points below, names above. */
export class CloudView {
  constructor(canvas, names, say) {
    Object.assign(this, { canvas, names, say, orbit: new Orbit(), floor: null, revision: null, cut: 2, due: false, timer: 0, t: palette(), askedMs: -AGAIN_MS });
    this.points = new Points(canvas);
    const turning = { own: false, pan: (du, dv) => this.orbit.turn(du, dv), zoom: factor => this.orbit.zoom(factor) };
    this.ends = [
      gestures(names, turning, { changed: () => this.draw(), fit: () => this.fit(), click: () => {}, hover: () => {} }),
      listen(() => { this.#update(); this.draw(); }), onTheme(() => { this.t = palette(); this.draw(); }),
    ];
    this.resizing = new ResizeObserver(() => this.#resize());
    this.resizing.observe(names);
  }

  end() {
    for (const end of this.ends) end();
    clearTimeout(this.timer);
    this.resizing.disconnect();
    this.points.end();
  }

  show(floor) {
    if (floor === this.floor) return;
    Object.assign(this, { floor, revision: null, askedMs: -AGAIN_MS });
    this.orbit.own = false;
    this.#update();
  }

  setCut(height) { this.cut = height; this.draw(); }
  fit() { this.orbit.own = false; this.#fit(); this.draw(); }
  zoom(factor) { this.orbit.zoom(factor); this.draw(); }

  /** Asks for the cloud when the maps changed; seldom, for it is large. */
  #update() {
    const revision = one("floor", this.floor)?.revision;
    if (this.floor == null || this.timer || revision === this.revision) return;
    this.timer = setTimeout(async () => {
      this.revision = revision;
      this.askedMs = performance.now();
      await this.#load();
      this.timer = 0;
      if (this.revision === null) this.#update();
    }, Math.max(0, AGAIN_MS - (performance.now() - this.askedMs)));
  }

  async #load() {
    const floor = this.floor;
    try {
      const answer = await ask(`floors/${part(floor)}/cloud.npy?points=${MOST}`);
      const { shape, values } = readNpy(await answer.arrayBuffer());
      if (floor !== this.floor) return; // another floor is shown meanwhile: it is asked for by itself
      this.points.set(values);
      this.box = boxOf(values);
      if (!this.orbit.own) this.#fit();
      this.say(`${shape[0].toLocaleString("en")} points`);
    } catch (error) { this.say(error.message); }
    this.draw();
  }

  #fit() { if (this.box) this.orbit.fit(this.box); }

  #floorZ() { return one("floor", this.floor)?.z_m ?? 0; }

  draw() {
    if (this.due) return;
    this.due = true;
    requestAnimationFrame(() => { this.due = false; this.#paint(); });
  }

  #paint() {
    const z = this.#floorZ(), { orbit, canvas, names } = this;
    orbit.z = z + 0.6;
    this.points.draw(orbit.matrix(), canvas.width, canvas.height, z + this.cut);
    const c = names.getContext("2d"), ratio = names.width / orbit.width;
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, orbit.width, orbit.heightPx);
    drawThings(c, orbit, this.t, this.floor, z);
  }

  #resize() {
    const { width, height } = this.names.getBoundingClientRect(), ratio = Math.min(devicePixelRatio || 1, 2);
    if (!width || !height) return;
    for (const canvas of [this.canvas, this.names]) { canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio); }
    this.orbit.resize(width, height);
    if (!this.orbit.own) this.#fit();
    this.#paint();
  }
}

/** [x0, y0, x1, y1] of most of the points: what flies about alone doesn't count. */
function boxOf(values) {
  const xs = [], ys = [];
  for (let i = 0; i < values.length; i += 60) { xs.push(values[i]); ys.push(values[i + 1]); }
  if (!xs.length) return null;
  const inner = list => { list.sort((a, b) => a - b); return [list[Math.floor(0.01 * list.length)], list[Math.floor(0.99 * (list.length - 1))]]; };
  const [x0, x1] = inner(xs), [y0, y1] = inner(ys);
  return [x0, y0, x1, y1];
}

function drawThings(c, orbit, t, floor, z) {
  const matrix = orbit.matrix(), here = kind => all(kind).filter(thing => thing.floor === floor);
  for (const robot of here("robot")) {
    path(c, orbit, matrix, trailOf(robot.id).filter(p => p.floor === floor).map(p => [p.x, p.y, z + 0.03]), t.robot, []);
    mark(c, orbit.to([...robot.position_m.slice(0, 2), z + 0.3], matrix), robot.id, t.robot, 8, t);
  }
  for (const plan of here("plan")) path(c, orbit, matrix, plan.path_m.map(([x, y]) => [x, y, z + 0.03]), t.plan, [6, 5]);
  for (const camera of here("camera")) mark(c, orbit.to(camera.position_m, matrix), camera.id, camera.stale ? t.stale : camera.invoked ? t.camera : t.quiet, 6, t);
  for (const o of here("object").filter(o => o.status === "confirmed")) mark(c, orbit.to(o.center_m, matrix), o.label, t.object, 4, t);
}

function mark(c, at, text, ink, r, t) {
  if (!at) return;
  c.fillStyle = ink;
  c.strokeStyle = t.paper;
  c.lineWidth = 2;
  c.beginPath(); c.arc(at[0], at[1], r, 0, 7); c.fill(); c.stroke();
  label(c, text, at[0] + r + 4, at[1] + 4, t);
}

function path(c, orbit, matrix, points, ink, dash) {
  c.strokeStyle = ink;
  c.lineWidth = 2.5;
  c.setLineDash(dash);
  c.beginPath();
  for (const at of points.map(p => orbit.to(p, matrix))) if (at) c.lineTo(...at);
  c.stroke();
  c.setLineDash([]);
}
