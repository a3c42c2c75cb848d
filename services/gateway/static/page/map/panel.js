// The map with its switches: floor, layers, flat or in 3D.
import { all, one, useStore } from "../store.js";
import { toast } from "../toasts.js";
import { html, useState } from "../ui.js";
import { bars, middleOf, nameOfArea } from "./areas.js";
import { LAYERS, nameOf } from "./layers.js";
import { Legend } from "./legend.js";
import { chooseFloor, selection } from "./selection.js";
import { MapStage } from "./stage.js";

const SWITCHES = [...LAYERS.map(l => [l, nameOf(l)]), ["cones", "camera views"], ["objects", "objects"], ["areas", "zones and doors"]];

/** The floor that a person chose, else that of a robot with a mission, else of any robot. */
export function shownFloor() {
  const names = all("floor").map(f => f.id);
  if (names.includes(selection.floor)) return selection.floor;
  const robots = all("robot").filter(r => names.includes(r.floor));
  return (robots.find(r => r.mission) ?? robots.find(r => !r.stale) ?? robots[0])?.floor ?? names[0] ?? null;
}

/** The 3D view is loaded when it is first opened. */
function useCloud() {
  const [stage, setStage] = useState(null);
  const toggle = () => stage ? setStage(null) : import("../cloud/stage.js").then(m => setStage(() => m.CloudStage), () => toast("The 3D view can't be loaded.", "bad"));
  return [stage, toggle];
}

export function MapPanel() {
  useStore();
  const [shown, setShown] = useState(Object.fromEntries(SWITCHES.map(([k]) => [k, true]))), [layers, setLayers] = useState(null);
  const floor = shownFloor(), [Cloud, toggleCloud] = useCloud();
  return html`<section class="panel map" id="map" aria-labelledby="map-title">
    <div class="row head"><h2 id="map-title">Map</h2><${Floors} floor=${floor} /><span class="grow"></span><${MapNote} floor=${floor} />
      <button class="quiet" aria-pressed=${!!Cloud} onClick=${toggleCloud}>3D</button></div>
    ${!Cloud && html`<${Switches} shown=${shown} setShown=${setShown} />`}
    <div class="stage">${Cloud ? html`<${Cloud} floor=${floor} />` : html`<${MapStage} floor=${floor} shown=${shown} onLayers=${l => setLayers({ ...l })} />`}
      <${Empty} floor=${floor} /></div>
    ${!Cloud && html`<${Legend} range=${shown.value ? layers?.pictures?.value?.range : null} prior=${shown.occupancy && layers?.pictures?.occupancy?.canvas.hasPrior} problem=${shown.value ? layers?.problems?.value : null} areas=${shown.areas ? all("area").filter(a => a.floor === floor) : []} />`}
    <${Positions} floor=${floor} />
  </section>`;
}

function Switches({ shown, setShown }) {
  return html`<div class="row switches" role="group" aria-label="Layers">${SWITCHES.map(([key, name]) => html`
    <button class="switch show-${key}" aria-pressed=${shown[key]} onClick=${() => setShown({ ...shown, [key]: !shown[key] })}><i aria-hidden="true"></i>${name}</button>`)}</div>`;
}

function Floors({ floor }) {
  const floors = all("floor");
  if (floors.length < 2) return floors.length ? html`<span class="soft">floor ${floor}</span>` : null;
  return html`<div class="tabs" role="group" aria-label="Floor">${floors.map(f => html`
    <button aria-pressed=${f.id === floor} onClick=${() => chooseFloor(f.id)}>${f.id}${f.robots.length ? " •" : ""}</button>`)}</div>`;
}

function MapNote({ floor }) {
  const f = one("floor", floor);
  if (!f) return null;
  const text = f.stale ? "fusion is gone: an old map" : f.pending_views ? `${f.pending_views} views on their way` : f.revision == null ? "not mapped yet" : `revision ${f.revision}`;
  return html`<span class="${f.stale ? "bad-text" : "soft"} small">${text}</span>`;
}

function Empty({ floor }) {
  if (one("building", "") && floor == null) return html`<p class="over">Nothing is known of any floor yet. Start a robot or a camera.</p>`;
  return one("building", "") ? null : html`<p class="over">Waiting for the gateway …</p>`;
}

/** The map in words, for who can't see it. */
function Positions({ floor }) {
  const at = p => `at ${p[0].toFixed(1)}, ${p[1].toFixed(1)} metres`;
  return html`<ul class="unseen" aria-label="What is on the map">
    ${all("robot").filter(r => r.floor === floor).map(r => html`<li data-robot=${r.id}>Robot ${r.id}, ${r.state}, ${at(r.position_m)}${r.battery == null ? "" : `, battery ${Math.round(100 * r.battery)} %`}</li>`)}
    ${all("area").filter(a => a.floor === floor).map(a => html`<li data-area=${a.id}>${nameOfArea(a)}, ${at(middleOf(a))}${bars(a) ? ": no robot is sent there" : ""}</li>`)}
    ${all("camera").filter(c => c.floor === floor).map(c => html`<li>Camera ${c.id}, ${c.invoked ? "invoked" : "not invoked"}, ${at(c.position_m)}</li>`)}
  </ul>`;
}
