// All missions, newest first.
import { bytes, clock, metres, timer } from "../format.js";
import { recordingOf } from "../recordings.js";
import { one } from "../store.js";
import { html, useState } from "../ui.js";
import { MissionId, StateBadge } from "./mission-parts.js";

const FIRST = 8;

/** Its recording, to be downloaded. */
function File({ mission }) {
  const file = recordingOf(mission);
  return file && html`<a class="small" href=${file.address} download title="MCAP, ${bytes(file.bytes)}: for Foxglove, Lichtblick and surveilnav replay">recording</a>`;
}

function Row({ mission: m }) {
  return html`<tr class=${m.stale ? "stale" : ""} data-mission=${m.id}>
    <td><b>${m.target}</b><div class="soft">${clock(m.started)} <${MissionId} id=${m.id} /></div></td>
    <td><${StateBadge} mission=${m} />${m.message && html`<div class="soft clamp" title=${m.message}>${m.message}</div>`}<${File} mission=${m.id} /></td>
    <td class="n">${metres(m.path_m)}<div class="soft">${timer(m.elapsed_s)}</div>${one("cost", m.id) && html`<div class="soft" title="sent by cameras and robots while it ran">${bytes(one("cost", m.id).offered_bytes)}</div>`}</td></tr>`;
}

export function MissionTable({ missions }) {
  const [whole, setWhole] = useState(false);
  if (!missions.length) return html`<p class="empty">No mission yet. Say above what to find, and a robot goes looking.</p>`;
  const shown = whole ? missions : missions.slice(0, FIRST);
  return html`<table class="missions">
      <thead><tr><th scope="col">target</th><th scope="col">state</th><th scope="col" class="n">way, time</th></tr></thead>
      <tbody>${shown.map(m => html`<${Row} key=${m.id} mission=${m} />`)}</tbody></table>
    ${missions.length > FIRST && html`<button class="quiet" onClick=${() => setWhole(!whole)}>${whole ? "Fewer" : `All ${missions.length}`}</button>`}`;
}
