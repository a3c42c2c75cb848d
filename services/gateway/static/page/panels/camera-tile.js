// One camera: its picture while the tile is on the screen, its state, its views.
import { part, post, remove } from "../api.js";
import { presence } from "../alerts.js";
import { useNow } from "../clock.js";
import { ago, percent } from "../format.js";
import { Icon } from "../icons.js";
import { chooseCamera, selection } from "../map/selection.js";
import { all } from "../store.js";
import { tileOf, wantTile } from "../tiles.js";
import { attempt } from "../toasts.js";
import { askRemoval } from "./removal.js";
import { html, useEffect, useRef, useState } from "../ui.js";

/** Whether an element is on the screen. */
function useVisible(ref) {
  const [visible, setVisible] = useState(false);
  useEffect(() => {
    const seen = new IntersectionObserver(([entry]) => setVisible(entry.isIntersecting));
    seen.observe(ref.current);
    return () => seen.disconnect();
  }, []);
  return visible;
}

export function CameraTile({ camera: c, pictures }) {
  const box = useRef(), visible = useVisible(box), [view, setView] = useState(0);
  const now = useNow(), state = presence(c, now), id = `${c.id}/${c.views[view]?.view ?? 0}`;
  const looks = pictures && visible && state === "live";
  useEffect(() => looks ? wantTile(id) : undefined, [looks, id]);
  const turn = by => setView((view + by + c.views.length) % c.views.length);
  return html`<article class="tile ${state} ${c.invoked && !c.stale ? "invoked" : ""}" id="camera-${c.id}" data-camera=${c.id} data-state=${state} ref=${box}
      aria-label="Camera ${c.id}, ${state}" onMouseEnter=${() => chooseCamera(c.id)} onMouseLeave=${() => selection.camera === c.id && chooseCamera(null)}>
    <${Picture} camera=${c} tile=${looks ? tileOf(id) : {}} state=${state} now=${now} wanted=${pictures} />
    <div class="row turn"><button aria-label="View before, camera ${c.id}" onClick=${() => turn(-1)}><${Icon} name="left" size="11" /></button>
      <span class="small">${direction(c.views[view])}</span><button aria-label="Next view, camera ${c.id}" onClick=${() => turn(1)}><${Icon} name="right" size="11" /></button></div>
    <div class="row foot"><b>${c.id}</b><span class="grow"></span><${State} camera=${c} state=${state} /><${Buttons} camera=${c} state=${state} /></div>
    <p class="saw">${seen(c) || html`<span class="soft">nothing on the map yet</span>`}</p>
  </article>`;
}

function direction(view) {
  if (!view) return "–";
  return view.yaw_rad == null ? "straight down" : `${COMPASS[Math.round(((Math.PI / 2 - view.yaw_rad) / (Math.PI / 4) + 8)) % 8]} ${view.view}`;
}
const COMPASS = ["N", "NE", "E", "SE", "S", "SW", "W", "NW"];

/** What the map holds of its pictures, the surest first; else what the camera itself last saw. */
function seen(c) {
  const objects = all("object").filter(o => o.status === "confirmed" && o.sources.includes(`camera/${c.id}`)).sort((a, b) => b.confidence - a.confidence);
  const names = objects.length ? objects.map(o => o.label) : Object.entries(c.labels).sort((a, b) => b[1] - a[1]).map(([name, p]) => `${name} ${percent(p)}`);
  return [...new Set(names)].slice(0, 4).join(", ");
}

function Picture({ camera: c, tile, state, now, wanted }) {
  const text = { paused: "paused", stale: `no news, ${ago(c.last_seen, now)}`, offline: `offline, ${ago(c.last_seen, now)}` }[state] ?? (state === "live" ? undefined : c.stream.reason || state);
  return html`<div class="picture">
    ${tile.url ? html`<img src=${tile.url} alt="What camera ${c.id} sees" />` : html`<span class="soft">${text ?? (wanted ? tile.problem ?? "…" : "no picture")}</span>`}
  </div>`;
}

function State({ camera: c, state }) {
  if (state !== "live") return html`<span class="badge ${state === "paused" || state === "connecting" ? "warn" : "bad"}" title=${c.stream.reason}>${state.replace("_", " ")}</span>`;
  return c.invoked ? html`<span class="badge live" title="invoked: the maps hold ${c.views_processed} of its ${c.views.length} views">${c.views_processed}/${c.views.length} views</span>` : html`<span class="badge soft">idle</span>`;
}

function Buttons({ camera: c, state }) {
  const drop = () => attempt(() => remove(`cameras/${part(c.id)}`), `Camera ${c.id} isn't listed any more. The maps keep what it saw.`);
  const pause = () => attempt(() => post(`cameras/${part(c.id)}/${c.paused ? "resume" : "pause"}`), `Camera ${c.id} ${c.paused ? "looks again" : "is paused"}.`);
  const erase = html`<button class="icon small" onClick=${() => askRemoval(`camera/${c.id}`)} title="Take out of the maps" aria-label="Take camera ${c.id} out of the maps"><${Icon} name="erase" size="13" /></button>`;
  if (c.stale) return html`${erase}<button class="icon small" onClick=${drop} disabled=${state === "stale"} title="Remove from the list" aria-label="Remove camera ${c.id}"><${Icon} name="close" size="13" /></button>`;
  const name = c.paused ? "Resume" : "Pause";
  return html`${erase}<button class="icon small" onClick=${pause} title=${name} aria-label="${name} camera ${c.id}"><${Icon} name=${c.paused ? "play" : "pause"} size="13" /></button>`;
}
