// The camera's picture and the floor plan, side by side; points are set in both in the same way.
import { Icon } from "../page/icons.js";
import { html, useEffect, useRef, useState } from "../page/ui.js";
import { drawMarker, drawResidual } from "./markers.js";
import { model, OTHER, useModel } from "./model.js";
import * as server from "./server.js";
import { Stage } from "./stage.js";

const GRID = "rgb(18 190 190 / .75)", WALL = "#ff4fe0", CAMERA = "#7a3fd1";
const KEYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const FINE = 0.25;

/** What stage and points have to do with each other; `place` is "px" or "plan_px". */
function owner(place, drawBelow) {
  return {
    draw(c, stage) {
      drawBelow(c, stage);
      const contradicting = model.contradicting;
      for (const { index, at } of this.markers()) {
        const bad = contradicting.has(index), should = place === "px" && model.solution?.predicted_px[index];
        // The number doesn't cover the line to where the point should be.
        drawMarker(c, stage.to(at), index, { selected: index === model.selected, bad, left: bad && should && should[0] > at[0] });
      }
    },
    markers() {
      const all = model.half ? [...model.points, model.half] : model.points;
      return all.flatMap((point, index) => point[place] ? [{ index, at: point[place] }] : []);
    },
    click: at => model.click(place, at),
    // Whoever has clicked in one picture and then clicks on a marker in the other means its place: the top above a foot.
    pick: (index, at) => model.half?.[OTHER[place]] ? model.click(place, at) : model.select(index),
    grab: index => { model.remember(); model.selected = index; },
    move: (index, at) => model.move(index, place, at),
  };
}

function drawOnPicture(c, stage) {
  const { solution, shown, points, contradicting } = model;
  if (!solution) return;
  c.save();
  c.beginPath();
  c.rect(stage.x, stage.y, stage.width * stage.scale, stage.height * stage.scale);
  c.clip(); // the lines end beyond the picture's edge
  c.lineJoin = "round";
  if (shown.grid) stroke(c, stage.path(solution.grid), [[GRID, 1]]);
  if (shown.walls) stroke(c, stage.path(solution.walls), [["rgb(0 0 0 / .4)", 4.5], [WALL, 2.2]]);
  c.restore();
  solution.predicted_px.forEach((from, i) => {
    if (from && points[i]) drawResidual(c, stage.to(from), stage.to(points[i].px), contradicting.has(i));
  });
}

function stroke(c, path, strokes) {
  for (const [colour, width] of strokes) {
    c.strokeStyle = colour;
    c.lineWidth = width;
    c.stroke(path);
  }
}

function drawOnPlan(c, stage) {
  const { solution, state } = model;
  scaleBar(c, stage, state.plan.resolution_m);
  if (!solution) return;
  const view = stage.path([solution.view_px], true), [x, y] = stage.to(solution.place_px);
  c.globalAlpha = 0.16;
  c.fillStyle = CAMERA;
  c.fill(view);
  c.globalAlpha = 1;
  c.strokeStyle = CAMERA;
  c.lineWidth = 1.5;
  c.stroke(view);
  c.beginPath();
  c.arc(x, y, 7, 0, 2 * Math.PI);
  c.fillStyle = CAMERA;
  c.fill();
  c.strokeStyle = "#fff";
  c.lineWidth = 2;
  c.stroke();
}

/** How long a round number of metres is, so that one sees whether the plan's scale is right. */
function scaleBar(c, stage, resolution) {
  const metres = [0.1, 0.5, 1, 2, 5, 10, 20, 50].findLast(m => m / resolution * stage.scale <= 140) ?? 0.1;
  const length = metres / resolution * stage.scale, y = stage.canvas.clientHeight - 12;
  c.font = "12px system-ui, sans-serif";
  c.textBaseline = "alphabetic";
  for (const [colour, width] of [["#fff", 5], ["#17202b", 2]]) {
    Object.assign(c, { strokeStyle: colour, fillStyle: colour, lineWidth: width });
    c.beginPath();
    c.moveTo(12, y - 5); c.lineTo(12, y); c.lineTo(12 + length, y); c.lineTo(12 + length, y - 5);
    c.stroke();
    c.lineWidth = 3;
    if (width === 5) c.strokeText(`${metres} m`, 18, y - 6); else c.fillText(`${metres} m`, 18, y - 6);
  }
}

/** A picture with its head. `load(fresh)` gets it; `tools`: what more stands in the head. */
function StagePanel({ id, title, place, size, load, draw, tools }) {
  useModel();
  const canvas = useRef(), stage = useRef(), [told, setTold] = useState("");
  const get = async fresh => {
    setTold(fresh ? "Taking a new picture …" : "Loading the picture …");
    try { stage.current.show(await load(fresh), ...size); setTold(""); } catch (error) { setTold(error.message); }
  };
  useEffect(() => {
    stage.current = new Stage(canvas.current, owner(place, draw));
    get(false);
  }, []);
  useEffect(() => stage.current.draw());
  useEffect(() => { const at = model.points[model.selected]?.[place]; if (at) stage.current.reveal(at); }, [model.selected]);
  const nudge = e => {
    const step = KEYS[e.key], at = model.points[model.selected]?.[place];
    if (!step || !at || e.ctrlKey || e.altKey || e.metaKey) return;
    e.preventDefault();
    model.remember();
    model.move(model.selected, place, stage.current.clamped(at.map((v, i) => v + step[i] * (e.shiftKey ? FINE : 1))));
  };
  const waiting = model.half && !model.half[place];
  return html`<section class="panel stage-panel" id=${id} aria-label=${title}>
    <div class="row head"><h2>${title}</h2><span class="grow"></span>${tools?.(get)}
      <button class="icon" title="Zoom in" aria-label="Zoom in: ${title}" onClick=${() => stage.current.zoom(1.6)}><${Icon} name="plus" /></button>
      <button class="icon" title="Zoom out" aria-label="Zoom out: ${title}" onClick=${() => stage.current.zoom(1 / 1.6)}><${Icon} name="minus" /></button>
      <button class="icon" title="Show all" aria-label="Show all: ${title}" onClick=${() => stage.current.fit()}><${Icon} name="fit" /></button></div>
    <div class="stage ${waiting ? "waiting" : ""}">
      <canvas ref=${canvas} tabindex="0" role="application" onKeyDown=${nudge}
        aria-label="${title}. Click to set a point, drag to move, wheel to zoom; arrow keys move the selected point."></canvas>
      ${told && html`<p class="told" role="status">${told}</p>`}</div></section>`;
}

const Toggle = ({ what, children }) => html`<label class="check small">
  <input type="checkbox" checked=${model.shown[what]} onChange=${e => model.show(what, e.target.checked)} /><i class="swatch ${what}"></i>${children}</label>`;

export function Stages() {
  const { state } = model;
  const tools = get => html`<${Toggle} what="walls">walls<//><${Toggle} what="grid">1 m grid<//>
    ${state.from_stream && html`<button class="small" onClick=${() => get(true)}>Take a new picture</button>`}`;
  return html`<div class="stages">
    <${StagePanel} id="picture" title="Camera" place="px" size=${[state.width_px, state.height_px]}
      load=${server.getPicture} draw=${drawOnPicture} tools=${tools} />
    <${StagePanel} id="plan" title="Floor plan" place="plan_px" size=${[state.plan.width_px, state.plan.height_px]}
      load=${server.getPlan} draw=${drawOnPlan} /></div>`;
}
