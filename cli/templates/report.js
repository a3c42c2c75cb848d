// The report of a search: the page's own map, objects and candidates, fed with what was recorded instead of by a gateway.
import { metres, timer } from "./format.js";
import { FloorLayers } from "./map/layers.js";
import { MapPanel } from "./map/panel.js";
import { Poses } from "./map/poses.js";
import { drawScene, palette } from "./map/scene.js";
import { chooseFloor } from "./map/selection.js";
import { View, boxOf } from "./map/view.js";
import { Candidates } from "./panels/candidates.js";
import { ObjectPanel } from "./panels/objects.js";
import { all, one, put } from "./store.js";
import { startTheme } from "./theme.js";
import { startTrails } from "./trails.js";
import { html, render, useEffect, useRef, useState } from "./ui.js";

const data = JSON.parse(document.getElementById("film-data").textContent);
const { frames, maps, moments, robot } = data, LAST = frames.length - 1;
const MISSION = "recorded", FRAME_MS = 200;
const STILL_LAYERS = ["explored", "occupancy"];
let at = -1; // the frame that the store holds

// --- what the gateway would answer ---

/** The newest map of a floor at a frame: its number and its layers. The last frame has the layers of the end, value and frontiers too. */
function mapAt(floor, k) {
  if (k === LAST && data.layers[floor]) return { revision: maps.length + 1, layers: data.layers[floor] };
  const number = maps.findLastIndex(map => map.floor === floor && map.frame <= k);
  return { revision: number + 1, layers: maps[number]?.layers ?? {} };
}

const bytesOf = base64 => Uint8Array.from(atob(base64), c => c.charCodeAt(0));

/** A layer as REST serves it; one that isn't recorded for this moment is empty, so that nothing of another moment stays. */
async function layerOf(floor, name) {
  const { revision, layers } = mapAt(floor, at), layer = layers[name], headers = { "x-surveilnav-revision": revision };
  if (!layer) {
    const empty = new OffscreenCanvas(1, 1);
    empty.getContext("2d");
    return new Response(await empty.convertToBlob(), { headers: { ...headers, "x-surveilnav-grid": "0 0 0.01 1 1" } });
  }
  if (layer.range) headers["x-surveilnav-range"] = layer.range.join(" ");
  return new Response(bytesOf(layer.png), { headers: { ...headers, "x-surveilnav-grid": layer.grid.join(" ") } });
}

const json = value => new Response(JSON.stringify(value), { headers: { "content-type": "application/json" } });

window.fetch = async path => {
  const [kind, id, what, name] = path.split("/").slice(2).map(decodeURIComponent);
  if (kind === "floors" && what === "layers") return layerOf(id, name.replace(".png", ""));
  if (kind === "floors" && what === "objects") return json(data.objects.find(o => o.floor === id && String(o.id) === name));
  if (kind === "cameras" && what === "cones") return json({ items: data.cameras.find(c => c.id === id).cones });
  return new Response(null, { status: 404 });
};

// --- the state of a frame ---

function planAt(k) {
  while (k > 0 && !frames[k].plan) k--;
  return frames[k].plan;
}

function putRobot(k) {
  const { floor, position_m, yaw_rad } = frames[k];
  put("robot", robot, { id: robot, floor, position_m, yaw_rad, mission: MISSION, state: k === LAST ? "stopped" : "driving" });
}

/** Brings the store to frame `k`. Going back, the robot's way is gone once more from the start. */
function goTo(k) {
  if (k < at) put("robot", robot, null);
  for (let i = k < at ? 0 : at + 1; i <= k; i++) putRobot(i);
  at = k;
  for (const { id } of all("floor")) {
    put("floor", id, { id, revision: mapAt(id, k).revision, last_seen: "recorded", robots: frames[k].floor === id ? [robot] : [] });
  }
  const plan = planAt(k);
  put("plan", MISSION, plan ? { ...plan, id: MISSION, mission: MISSION, robot, floor: frames[k].floor } : null);
  const known = new Map();
  for (const [frame, number, status, label, confidence, sources] of data.sightings) {
    if (frame <= k) known.set(number, { status, label, confidence, sources });
  }
  data.objects.forEach((object, number) => {
    put("object", `${object.floor}/${object.id}`, known.has(number) ? { ...object, ...known.get(number) } : null);
  });
}

function start() {
  put("building", "", { name: data.building });
  put("mission", MISSION, { id: MISSION, target: data.target });
  for (const id of new Set([...Object.keys(data.layers), ...frames.map(f => f.floor)])) put("floor", id, { id, revision: 0, robots: [] });
  for (const camera of data.cameras) put("camera", camera.id, camera);
}

// --- the film ---

const sentence = text => text && text[0].toUpperCase() + text.slice(1) + (/[.!?]$/.test(text) ? "" : ".");

/** The newest picture of the robot up to frame `k`. */
function pictureAt(k) {
  while (k > 0 && !frames[k].picture) k--;
  return frames[k].picture;
}

function Scrubber({ k, go }) {
  const [playing, setPlaying] = useState(false), frame = frames[k];
  useEffect(() => {
    if (!playing) return undefined;
    const next = setTimeout(() => k < LAST ? go(k + 1) : setPlaying(false), FRAME_MS);
    return () => clearTimeout(next);
  }, [playing, k]);
  const jump = to => { setPlaying(false); go(to); };
  const toggle = () => { if (!playing && k === LAST) go(0); setPlaying(!playing); };
  const when = `${frame.step} of ${frames[LAST].step}, ${timer(frame.t_s)}, ${metres(frame.path_m)}`;
  return html`<div class="scrub"><button id="film-play" onClick=${toggle}>${playing ? "Pause" : "Play"}</button>
      <label for="film-at">Step</label>
      <input type="range" id="film-at" min="0" max=${LAST} value=${k} aria-valuetext="step ${when}" onInput=${e => jump(+e.target.value)} />
      <output id="film-when" for="film-at">${when}</output></div>
    <div class="chapters" role="group" aria-label="Key moments">${moments.map(([frame, title]) => html`
      <button aria-current=${String(frame === k)} onClick=${() => jump(frame)}>${title}</button>`)}</div>`;
}

function Weighed({ plan }) {
  const box = useRef();
  useEffect(() => { for (const details of box.current.querySelectorAll("details")) details.open = true; });
  return html`<div id="film-weighed" ref=${box}>${plan?.candidates.length ? html`<${Candidates} plan=${plan} />` : html`<p class="soft">There was no choice to make.</p>`}</div>`;
}

function Film() {
  const [k, setK] = useState(LAST), plan = planAt(k), picture = pictureAt(k);
  const go = to => { chooseFloor(null); goTo(to); setK(to); };
  const aim = plan?.waypoint?.note;
  return html`<section class="panel"><h2>Step by step</h2><${Scrubber} k=${k} go=${go} />
      <p id="film-why">${plan ? sentence(plan.why || "no reason was told") : "Nothing was decided yet."} ${aim && aim !== plan.why ? sentence(aim) : ""}</p></section>
    <div class="screens"><${MapPanel} />
      <div class="column"><section class="panel"><h2>What the robot saw</h2>
          ${picture ? html`<img id="film-view" src="data:image/webp;base64,${picture}" alt="What the robot saw at step ${frames[k].step}" />` : html`<p class="soft">No picture is kept.</p>`}
          <${Weighed} plan=${plan} /></section>
        <${ObjectPanel} /></div></div>`;
}

// --- the key moments, for paper ---

/** Draws the map of a frame on a canvas, once its layers came. */
function drawStill(canvas, k) {
  goTo(k);
  const floor = frames[k].floor, view = new View();
  return new Promise(done => {
    const layers = new FloorLayers(floor, () => {
      view.resize(canvas.width, canvas.height);
      view.fit(boxOf([layers.box], frames.slice(0, k + 1).filter(f => f.floor === floor).map(f => f.position_m)));
      const shown = Object.fromEntries(STILL_LAYERS.map(name => [name, true]));
      drawScene(canvas.getContext("2d"), view, palette(), { floor, layers, shown, poses: new Poses(), came: () => {} });
      layers.end();
      done();
    });
    layers.update(STILL_LAYERS);
  });
}

async function main() {
  startTrails();
  start();
  for (const canvas of document.querySelectorAll("canvas[data-frame]")) await drawStill(canvas, +canvas.dataset.frame);
  startTheme();
  addEventListener("beforeprint", () => { document.documentElement.dataset.theme = "light"; });
  addEventListener("afterprint", startTheme);
  goTo(LAST);
  document.documentElement.classList.add("film");
  render(html`<${Film} />`, document.getElementById("film"));
}

main();
