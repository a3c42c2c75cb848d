// The map with its switches: floor, layers, zoom; a hint beside the pointer.
import { percent } from "../format.js";
import { Icon } from "../icons.js";
import { all, one, useStore } from "../store.js";
import { html, useEffect, useRef, useState } from "../ui.js";
import { MapCanvas } from "./canvas.js";
import { LAYERS, nameOf } from "./layers.js";
import { Legend } from "./legend.js";
import { chooseCamera, chooseFloor, chooseObject, selection } from "./selection.js";

const SWITCHES = [...LAYERS.map(l => [l, nameOf(l)]), ["cones", "camera views"], ["objects", "objects"]];

/** The floor that a person chose, else that of a robot with a mission, else of any robot. */
export function shownFloor() {
  const names = all("floor").map(f => f.id);
  if (names.includes(selection.floor)) return selection.floor;
  const robots = all("robot").filter(r => names.includes(r.floor));
  return (robots.find(r => r.mission) ?? robots.find(r => !r.stale) ?? robots[0])?.floor ?? names[0] ?? null;
}

export function MapPanel() {
  useStore();
  const canvas = useRef(), map = useRef(), [shown, setShown] = useState(Object.fromEntries(SWITCHES.map(([k]) => [k, true])));
  const [hint, setHint] = useState(null), [layers, setLayers] = useState(null), floor = shownFloor();
  useEffect(() => {
    map.current = new MapCanvas(canvas.current, {
      onPick: found => pick(found), onLayers: l => setLayers({ ...l }),
      onHover: (found, u, v) => setHint(found && { text: describe(found), u, v }),
    });
    return () => map.current.end();
  }, []);
  useEffect(() => map.current.show(floor, shown), [floor, shown]);

  return html`<section class="panel map" id="map" aria-labelledby="map-title">
    <div class="row head"><h2 id="map-title">Map</h2><${Floors} floor=${floor} />
      <span class="grow"></span><${MapNote} floor=${floor} /></div>
    <div class="row switches" role="group" aria-label="Layers">${SWITCHES.map(([key, name]) => html`
      <button class="switch show-${key}" aria-pressed=${shown[key]} onClick=${() => setShown({ ...shown, [key]: !shown[key] })}><i aria-hidden="true"></i>${name}</button>`)}</div>
    <div class="stage">
      <canvas ref=${canvas} tabindex="0" role="application" aria-label="Map of floor ${floor ?? "?"}. Arrow keys move it, plus and minus zoom, 0 shows everything."></canvas>
      <div class="zoom"><button aria-label="Zoom in" onClick=${() => map.current.zoom(1.3)}><${Icon} name="plus" /></button><button aria-label="Zoom out" onClick=${() => map.current.zoom(0.77)}><${Icon} name="minus" /></button>
        <button aria-label="Show everything" title="Show everything (0)" onClick=${() => map.current.fit()}><${Icon} name="fit" /></button></div>
      ${hint && html`<${Hint} ...${hint} />`}
      <${Empty} floor=${floor} />
    </div>
    <${Legend} range=${shown.value ? layers?.pictures?.value?.range : null} problem=${shown.value ? layers?.problems?.value : null} />
    <${Positions} floor=${floor} />
  </section>`;
}

function pick(found) {
  if (found?.kind === "object") chooseObject(`${found.thing.floor}/${found.thing.id}`);
  if (found?.kind === "camera") { chooseCamera(found.thing.id); document.getElementById(`camera-${found.thing.id}`)?.scrollIntoView({ block: "nearest" }); }
}

function describe({ kind, thing }) {
  if (kind === "object") return `${thing.label} #${thing.id}, ${thing.status} ${percent(thing.confidence)} (click for its history)`;
  if (kind === "camera") return `camera ${thing.id}${thing.stale ? ", gone" : thing.paused ? ", paused" : thing.invoked ? `, invoked: ${thing.views_processed} of ${thing.views.length} views` : ", not invoked"}`;
  if (kind === "place") return `${thing.kind}${thing.chosen ? ", chosen" : ""}: ${thing.note}`;
  return `robot ${thing.id}, ${thing.state}${thing.message ? `: ${thing.message}` : ""}`;
}

function Hint({ text, u, v }) {
  const box = useRef();
  useEffect(() => { box.current.style.transform = `translate(${u + 14}px, ${v + 14}px)`; }, [u, v]);
  return html`<div class="hint" ref=${box}>${text}</div>`;
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
    ${all("robot").filter(r => r.floor === floor).map(r => html`<li data-robot=${r.id}>Robot ${r.id}, ${r.state}, ${at(r.position_m)}</li>`)}
    ${all("camera").filter(c => c.floor === floor).map(c => html`<li>Camera ${c.id}, ${c.invoked ? "invoked" : "not invoked"}, ${at(c.position_m)}</li>`)}
  </ul>`;
}
