// What a person has clicked, what the command makes of it, and the way back by undo.
import { useEffect, useState } from "../page/ui.js";
import * as server from "./server.js";

const MOST_UNDOS = 200;

/** The two places of a point: `px` in the camera's picture, `plan_px` on the plan. */
export const OTHER = { px: "plan_px", plan_px: "px" };

class Model {
  constructor() {
    this.points = []; // {px, plan_px, z_m}
    this.half = null; // the point of which one place is missing: {px} or {plan_px}
    this.fitHfov = false;
    this.selected = -1;
    this.nextHeight = 0;
    this.solution = this.problem = null; // what follows from the points; at most one of the two
    this.solving = false;
    this.fault = ""; // the command can't be reached, or its files can't be used
    this.shown = { walls: true, grid: true };
    this.undos = [];
    this.heard = new Set();
    this.again = false;
  }

  begin(state) {
    this.state = state;
    this.points = state.points;
    this.fitHfov = state.fit_hfov;
    if (this.points.length) this.solve(); else this.tell();
  }

  get pairs() { return { points: this.points, fit_hfov: this.fitHfov }; }

  /** A click in the picture (`place`: "px") or on the plan ("plan_px"): the second place of a point, or the first of a new one. */
  click(place, at) {
    this.remember();
    if (!this.half?.[OTHER[place]]) {
      this.half = { [place]: at };
      this.selected = -1;
      return this.tell();
    }
    this.points = [...this.points, { ...this.half, [place]: at, z_m: this.nextHeight }];
    this.half = null;
    this.selected = this.points.length - 1;
    return this.solve();
  }

  /** Moves a place of a point. A drag is one step of undo: `remember` is called when it begins. */
  move(index, place, at) {
    if (index === this.points.length) { this.half = { [place]: at }; return this.tell(); }
    this.points = this.points.map((point, i) => i === index ? { ...point, [place]: at } : point);
    return this.solve();
  }

  setHeight(index, z_m) {
    if (this.points[index].z_m === z_m) return;
    this.remember();
    this.points = this.points.map((point, i) => i === index ? { ...point, z_m } : point);
    this.solve();
  }

  remove(index) {
    if (index < 0 || index > this.points.length) return;
    this.remember();
    if (index === this.points.length) { this.half = null; this.selected = -1; return void this.tell(); }
    this.points = this.points.filter((_, i) => i !== index);
    this.selected = -1;
    this.solve();
  }

  select(index) { this.selected = index; this.tell(); }
  setNextHeight(z_m) { this.nextHeight = z_m; this.tell(); }
  show(what, on) { this.shown = { ...this.shown, [what]: on }; this.tell(); }
  setFitHfov(on) { this.remember(); this.fitHfov = on; this.solve(); }

  remember() {
    const { points, half, fitHfov } = this;
    this.undos = [...this.undos, { points, half, fitHfov }].slice(-MOST_UNDOS);
  }

  undo() {
    const before = this.undos.at(-1);
    if (!before) return;
    this.undos = this.undos.slice(0, -1);
    Object.assign(this, before, { selected: -1 });
    this.solve();
  }

  /** Has the pose computed for the points as they are; while an answer is on its way, only the newest question waits. */
  async solve() {
    this.again = true;
    this.tell();
    if (this.solving) return;
    this.solving = true;
    try {
      while (this.again) {
        this.again = false;
        const { solution = null, problem = null } = await server.solve(this.pairs);
        Object.assign(this, { solution, problem, fault: "" });
        this.tell();
      }
    } catch (error) {
      Object.assign(this, { fault: error.message, again: false });
    }
    this.solving = false;
    this.tell();
  }

  /** The indices of points that contradict the others. */
  get contradicting() {
    if (this.solution) return new Set(this.solution.points.flatMap((p, i) => p.used ? [] : [i]));
    return new Set((this.problem?.points ?? []).map(number => number - 1));
  }

  tell() { for (const hear of this.heard) hear(); }
}

export const model = new Model();

/** Draws a component again when something has changed. */
export function useModel() {
  const [, again] = useState(0);
  useEffect(() => {
    const hear = () => again(n => n + 1);
    model.heard.add(hear);
    return () => model.heard.delete(hear);
  }, []);
  return model;
}
