// An object with all that ever happened to it: who said what, and what came of it.
import { address, get, part } from "../api.js";
import { clock, metres, percent } from "../format.js";
import { Icon } from "../icons.js";
import { chooseObject, highlight } from "../map/selection.js";
import { one, useStore } from "../store.js";
import { html, useEffect, useRef, useState } from "../ui.js";

const FIRST = 30;
/** So many of the newest events are shown with what they saw: fusion keeps no older pictures. */
const PICTURES = 20;

/** The object with its history, read again when the map knows more of it. */
function useObject(id) {
  useStore();
  const [state, setState] = useState({}), brief = one("object", id), [floor, number] = id.split("/");
  const version = brief && `${brief.n_detections} ${brief.status}`;
  useEffect(() => {
    let ended = false;
    get(`floors/${part(floor)}/objects/${number}`).then(object => ended || setState({ object }), error => ended || setState({ problem: error.message }));
    return () => { ended = true; };
  }, [id, version]);
  return state;
}

export function ObjectHistory({ id }) {
  const dialog = useRef(), { object: o, problem } = useObject(id);
  useEffect(() => { dialog.current.showModal(); }, []);
  const close = () => { chooseObject(null); highlight(null); };
  return html`<dialog ref=${dialog} onClose=${close} onClick=${e => e.target === dialog.current && dialog.current.close()} aria-labelledby="object-title">
    <div class="row head"><h2 id="object-title">${o ? `${o.label} #${o.id}` : `Object #${id.split("/")[1]}`}</h2><span class="grow"></span>
      <button class="icon" aria-label="Close" onClick=${() => dialog.current.close()}><${Icon} name="close" /></button></div>
    ${problem && html`<p class="bad-text">${problem}</p>`}
    ${!o && !problem && html`<p class="soft">Loading its history …</p>`}
    ${o && html`<${Facts} object=${o} /><${History} id=${id} events=${o.history} />`}
  </dialog>`;
}

function Facts({ object: o }) {
  const facts = [
    ["status", `${o.status}${o.reason ? ` (${o.reason})` : ""}`], ["confidence", percent(o.confidence)],
    ["by robots", `${percent(o.confidence_robot)} ${o.label_robot}`], ["by cameras", `${percent(o.confidence_surveillance)} ${o.label_surveillance}`],
    ["where", `${metres(o.center_m[0])}, ${metres(o.center_m[1])}${o.position_sigma_m ? ` ± ${metres(o.position_sigma_m)}` : ""}, floor ${o.floor}`], ["size", o.size_m.map(v => v?.toFixed(1)).join(" × ") + " m"],
    ["detections", o.n_detections], ["first seen", clock(o.first_seen)],
  ];
  return html`<dl class="facts wide">${facts.map(([name, value]) => html`<div><dt>${name}</dt><dd>${value}</dd></div>`)}</dl>`;
}

/** What an event saw, if fusion keeps it still. */
function Picture({ id, number, event: e }) {
  const [gone, setGone] = useState(false), [floor, object] = id.split("/");
  if (gone) return null;
  return html`<img class="seen" loading="lazy" src=${address(`floors/${part(floor)}/objects/${object}/history/${number}.jpg`)}
    alt="What ${e.source} saw: ${e.label}" onError=${() => setGone(true)} />`;
}

function History({ id, events }) {
  const [whole, setWhole] = useState(false), list = [...events].reverse(), shown = whole ? list : list.slice(0, FIRST);
  return html`<h3>History</h3><ol class="history">${shown.map((e, i) => html`<li class=${e.what} key=${events.length - i}>
      <time>${clock(e.time)}</time><span class="what">${e.what}</span>
      <span>${e.label && `${e.label} ${percent(e.score)}`} <span class="soft">${e.source}${e.source ? `, view ${e.view}` : ""}</span>${e.note && html`<br /><span class="soft">${e.note}</span>`}</span>
      ${e.box_px && i < PICTURES && html`<${Picture} id=${id} number=${events.length - 1 - i} event=${e} />`}</li>`)}</ol>
    ${list.length > FIRST && html`<button class="quiet" onClick=${() => setWhole(!whole)}>${whole ? "Fewer" : `All ${list.length}`}</button>`}`;
}
