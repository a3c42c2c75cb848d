// The whole picture of a floor, from the bottom to the top.
import { all } from "../store.js";
import { colour } from "../theme.js";
import { trailOf } from "../trails.js";
import { areaMark, areaNames } from "./areas.js";
import { conesOf } from "./cones.js";
import { metreGrid, northArrow, scaleBar } from "./furniture.js";
import { LAYERS, opacityOf } from "./layers.js";
import { selection } from "./selection.js";
import * as symbols from "./symbols.js";

const COLOURS = ["paper", "ink", "soft", "line", "accent", "bad", "stale", "quiet", "camera", "robot", "plan", "object", "target"];
const MOST_LABELS = 60;

/** The theme's colours for the canvas. */
export function palette() {
  const t = Object.fromEntries(COLOURS.map(name => [name, colour(`map-${name}`) || colour(name)]));
  return { ...t, font: getComputedStyle(document.body).fontFamily };
}

/** Draws a floor. `shown`: switches by name; `poses`: of robots, as they glide; `came`: called when more is there to draw. */
export function drawScene(c, view, t, { floor, layers, shown, poses, came }) {
  const here = kind => all(kind).filter(thing => thing.floor === floor);
  metreGrid(c, view, t);
  drawLayers(c, view, layers, shown);
  const cameras = here("camera");
  const tints = { ...t, coneAlpha: shown.value && layers?.pictures.value ? 0.18 : 0.34 }; // two tints at once would hide each other
  if (shown.cones) drawCones(c, view, cameras, layers, tints, came);
  const plans = here("plan"), areas = shown.areas ? here("area") : [];
  for (const area of areas) areaMark(c, view, area, t);
  for (const robot of here("robot")) symbols.trail(c, view, trailOf(robot.id).filter(p => p.floor === floor), t);
  for (const plan of plans) drawPlan(c, view, plan, t);
  const taken = cameras.map(camera => symbols.cameraBox(view, camera));
  areaNames(c, view, areas, t, taken);
  if (shown.objects) drawObjects(c, view, here("object"), t, taken);
  for (const camera of cameras) symbols.cameraMark(c, view, camera, t, selection.camera === camera.id);
  for (const plan of plans) symbols.waypoint(c, view, plan.waypoint, t);
  for (const robot of here("robot")) symbols.robotMark(c, view, robot, poses.of(robot), t);
  if (selection.point) symbols.pointer(c, view, selection.point, t);
  northArrow(c, view, t);
  scaleBar(c, view, t);
}

function place(c, view, { canvas, box }) {
  const [u, v] = view.to(box[0], box[3]);
  c.drawImage(canvas, u, v, (box[2] - box[0]) * view.scale, (box[3] - box[1]) * view.scale);
}

function drawLayers(c, view, layers, shown) {
  c.imageSmoothingEnabled = view.scale < 30;
  for (const layer of LAYERS) {
    const picture = layers?.pictures[layer];
    if (!picture || !shown[layer]) continue;
    c.globalAlpha = opacityOf(layer);
    place(c, view, picture);
  }
  c.globalAlpha = 1;
}

/** Cones end where nothing is explored: most of the time that is a wall. */
function drawCones(c, view, cameras, layers, t, came) {
  const ratio = c.canvas.width / view.width, sheet = new OffscreenCanvas(c.canvas.width, c.canvas.height), s = sheet.getContext("2d");
  s.scale(ratio, ratio);
  for (const camera of cameras) symbols.cameraCone(s, view, camera, conesOf(camera, came), t);
  if (layers?.pictures.explored) {
    s.globalCompositeOperation = "destination-in";
    place(s, view, layers.pictures.explored);
  }
  c.drawImage(sheet, 0, 0, view.width, view.height);
}

function drawPlan(c, view, plan, t) {
  symbols.planPath(c, view, plan.path_m, t);
  for (const candidate of plan.candidates) symbols.candidateMark(c, view, candidate, t);
}

const rank = o => (o.status === "confirmed" ? 2 : 0) + (o.confidence ?? 0);

function drawObjects(c, view, objects, t, taken) {
  const targets = new Set(all("plan").map(p => all("mission").find(m => m.id === p.mission)?.target));
  const list = objects.filter(o => o.status !== "rejected" && o.center_m[0] != null).sort((a, b) => rank(a) - rank(b));
  const state = o => ({ wanted: targets.has(o.label), chosen: selection.object === `${o.floor}/${o.id}` });
  for (const o of list) symbols.objectMark(c, view, o, t, state(o));
  labels(c, view, list.reverse().filter(o => o.status === "confirmed" || state(o).wanted || state(o).chosen).slice(0, MOST_LABELS), t, taken);
}

/** Names where there is room for them, the surest first. */
function labels(c, view, objects, t, taken) {
  c.font = `500 12px ${t.font}`;
  for (const o of objects) {
    const [u, v] = view.to(o.center_m[0], o.center_m[1]), text = `${o.label} ${Math.round(100 * (o.confidence ?? 0))}%`;
    const width = c.measureText(text).width, left = u + 10 + width > view.width ? u - 10 - width : u + 10;
    const box = [left, v - 7, left + width, v + 7];
    if (taken.some(b => b[0] < box[2] && box[0] < b[2] && b[1] < box[3] && box[1] < b[3])) continue;
    taken.push(box);
    symbols.label(c, text, box[0], v + 4, t);
  }
}
