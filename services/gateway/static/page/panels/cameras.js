// Cameras as tiles: a small picture, what they do, what a person can have them do.
import { bytes } from "../format.js";
import { shownFloor } from "../map/panel.js";
import { all, useStore } from "../store.js";
import { html, useState } from "../ui.js";
import { CameraTile } from "./camera-tile.js";

const FIRST = 12;

export function CameraPanel() {
  useStore();
  const [everywhere, setEverywhere] = useState(false), [whole, setWhole] = useState(false), [pictures, setPictures] = useState(true);
  const floors = all("floor").length, list = all("camera").filter(c => everywhere || c.floor === shownFloor());
  const shown = whole ? list : list.slice(0, FIRST);
  return html`<section class="panel" id="cameras" aria-labelledby="cameras-title">
    <div class="row head"><h2 id="cameras-title">Cameras</h2><span class="soft small">${summary(list)}</span><span class="grow"></span>
      ${floors > 1 && html`<button class="quiet" aria-pressed=${everywhere} onClick=${() => setEverywhere(!everywhere)}>all floors</button>`}
      <button class="quiet" aria-pressed=${pictures} onClick=${() => setPictures(!pictures)}>pictures</button></div>
    ${list.length ? html`<div class="tiles">${shown.map(c => html`<${CameraTile} key=${c.id} camera=${c} pictures=${pictures} />`)}</div>`
      : html`<p class="empty">${all("camera").length ? "No camera on this floor." : "No camera has announced itself. Robots search by themselves meanwhile."}</p>`}
    ${list.length > FIRST && html`<button class="quiet" onClick=${() => setWhole(!whole)}>${whole ? "Fewer" : `All ${list.length}`}</button>`}
    ${pictures && list.length > 0 && html`<p class="soft small">Pictures are traffic for people: ${bytes(viewerBytes(list))} so far. They invoke no camera.</p>`}
  </section>`;
}

function summary(list) {
  const invoked = list.filter(c => c.invoked && !c.stale).length, gone = list.filter(c => c.stale).length;
  return [`${list.length}`, invoked && `${invoked} invoked`, gone && `${gone} gone`].filter(Boolean).join(" · ");
}

function viewerBytes(list) {
  const ids = new Set(list.map(c => c.id));
  return all("traffic").filter(t => ids.has(t.id) && t.viewer_bytes).reduce((sum, t) => sum + t.viewer_bytes, 0);
}
