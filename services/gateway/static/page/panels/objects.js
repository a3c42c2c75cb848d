// Objects of the joint map: filtered, surest first; one of them with its history.
import { percent } from "../format.js";
import { highlight, chooseObject, selection } from "../map/selection.js";
import { all, useStore } from "../store.js";
import { html, useState } from "../ui.js";
import { ObjectHistory } from "./object-history.js";

const FIRST = 12;
const STATUSES = ["confirmed", "candidate", "rejected"];

function chosen(filter, status) {
  const words = filter.trim().toLowerCase();
  return all("object").filter(o => o.status === status && (!words || o.label.toLowerCase().includes(words)))
    .sort((a, b) => (b.confidence ?? 0) - (a.confidence ?? 0));
}

export function ObjectPanel() {
  useStore();
  const [filter, setFilter] = useState(""), [status, setStatus] = useState("confirmed"), [whole, setWhole] = useState(false);
  const list = chosen(filter, status), shown = whole ? list : list.slice(0, FIRST);
  return html`<section class="panel" id="objects" aria-labelledby="objects-title">
    <div class="row head"><h2 id="objects-title">Objects</h2><span class="grow"></span>
      <input type="search" aria-label="Filter objects by name" placeholder="filter" value=${filter} onInput=${e => setFilter(e.target.value)} /></div>
    <div class="tabs" role="group" aria-label="Status">${STATUSES.map(s => html`
      <button aria-pressed=${s === status} onClick=${() => setStatus(s)}>${s} <span class="count">${all("object").filter(o => o.status === s).length}</span></button>`)}</div>
    ${list.length ? html`<ul class="objects">${shown.map(o => html`<${Row} key=${`${o.floor}/${o.id}`} object=${o} />`)}</ul>` : html`<p class="empty">${empty(filter, status)}</p>`}
    ${list.length > FIRST && html`<button class="quiet" onClick=${() => setWhole(!whole)}>${whole ? "Fewer" : `All ${list.length}`}</button>`}
    ${selection.object && html`<${ObjectHistory} key=${selection.object} id=${selection.object} />`}
  </section>`;
}

function empty(filter, status) {
  if (filter) return `No ${status} object is called like “${filter}”.`;
  return { confirmed: "Nothing is confirmed yet. Objects appear as robots and cameras see them.", candidate: "No candidates now.", rejected: "Nothing was rejected." }[status];
}

function Row({ object: o }) {
  const key = `${o.floor}/${o.id}`, at = { x: o.center_m[0], y: o.center_m[1] };
  return html`<li><button class="object" data-object=${key} onClick=${() => chooseObject(key)} onMouseEnter=${() => highlight(at)} onMouseLeave=${() => highlight(null)}>
    <span class="name">${o.label}</span><span class="soft">#${o.id}${all("floor").length > 1 ? `, floor ${o.floor}` : ""}</span><span class="grow"></span>
    <span class="soft small">${seenBy(o)}</span>
    <meter min="0" max="1" value=${o.confidence ?? 0} aria-hidden="true"></meter><span class="n">${percent(o.confidence)}</span></button></li>`;
}

/** Which kinds of eyes saw it. */
const seenBy = o => [o.sources.some(s => s.startsWith("robot/")) && "robot", o.sources.some(s => s.startsWith("camera/")) && "camera"].filter(Boolean).join(" + ");
