// Where the cameras see something, without a robot: the question, and its answer.
import { post } from "../api.js";
import { clock, metres, percent } from "../format.js";
import { chooseFloor, chooseObject, highlight } from "../map/selection.js";
import { all } from "../store.js";
import { attempt } from "../toasts.js";
import { html, useState } from "../ui.js";

const MAX_SHOWN = 6;

/** A button that asks the cameras for what stands in the field `target`, and below it what they answered. */
export function AskCameras({ target }) {
  const [answer, setAnswer] = useState(null), [asking, setAsking] = useState(false);
  if (!all("camera").length) return null;

  async function ask() {
    const input = document.getElementById(target);
    if (asking || !input.reportValidity()) return;
    setAsking(true);
    const found = await attempt(() => post("sightings", { target: input.value }));
    setAsking(false);
    if (found) setAnswer(found);
  }

  return html`<p class="ask-cameras"><button type="button" disabled=${asking} onClick=${ask}>
      ${asking ? "The cameras look …" : "Only ask the cameras"}</button></p>
    ${answer && html`<${Answer} answer=${answer} close=${() => setAnswer(null)} />`}`;
}

function Answer({ answer, close }) {
  const { sightings } = answer, hidden = sightings.length - MAX_SHOWN;
  return html`<div class="sightings" role="region" aria-label="What the cameras see">
    <div class="row"><strong>${sightings.length ? `A ${answer.target} was seen here:` : `No camera sees a ${answer.target}.`}</strong>
      <button type="button" class="quiet" aria-label="Close" onClick=${close}>×</button></div>
    <ol>${sightings.slice(0, MAX_SHOWN).map(s => html`<${Sighting} key=${`${s.floor}/${s.object}`} sighting=${s} />`)}</ol>
    ${hidden > 0 && html`<p class="soft">and ${hidden} less certain ones</p>`}
    <${Unseen} answer=${answer} /></div>`;
}

function Sighting({ sighting: s }) {
  const [x, y] = s.position_m, place = `${metres(x)}, ${metres(y)}`;
  const by = s.sources.map(source => source.split("/").pop()).join(", ");
  const show = () => { chooseFloor(s.floor); chooseObject(`${s.floor}/${s.object}`); };
  return html`<li onMouseEnter=${() => x != null && highlight({ x, y })} onMouseLeave=${() => highlight(null)}>
    ${s.picture ? html`<img src=${s.picture} alt="what was seen" loading="lazy" />` : html`<span class="no-picture" />`}
    <button type="button" class="quiet" onClick=${show}>${s.room || place}</button>
    <span class="soft">${s.room ? `${place}, ` : ""}${s.position_sigma_m ? `± ${metres(s.position_sigma_m)}, ` : ""}floor ${s.floor}</span>
    <span class="soft">${s.status === "confirmed" ? "confirmed" : "perhaps"}${s.confidence == null ? "" : `, ${percent(s.confidence)}`}, ${clock(s.last_seen)} by ${by}</span></li>`;
}

/** What the answer doesn't cover: cameras that gave no pictures, rooms that nobody sees. */
function Unseen({ answer }) {
  const lacking = answer.cameras.filter(c => c.lacking), rooms = answer.rooms.filter(r => !r.in_view);
  return html`${rooms.length > 0 && html`<p class="soft">No camera sees ${rooms.map(r => r.name).join(", ")}.</p>`}
    ${lacking.map(c => html`<p class="soft">Camera ${c.id} wasn't looked at: ${c.lacking}.</p>`)}`;
}
