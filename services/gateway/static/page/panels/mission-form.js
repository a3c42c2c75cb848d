// What shall be found, by which robot, in how many steps.
import { post } from "../api.js";
import { all, one, useStore } from "../store.js";
import { attempt } from "../toasts.js";
import { html, useRef, useState } from "../ui.js";
import { AskCameras } from "./sightings.js";
import { suggestions } from "./suggestions.js";

/** One key per form filled in: a second click, also after an answer that was lost, sends the same mission, not another. */
const newKey = () => (crypto.randomUUID?.() ?? String(Math.random()).slice(2));

export function MissionForm() {
  useStore();
  const key = useRef(newKey()), sent = useRef(""), [sending, setSending] = useState(false);

  async function submit(event) {
    event.preventDefault();
    if (sending) return;
    const form = new FormData(event.target), said = JSON.stringify([...form]);
    if (said !== sent.current) key.current = newKey();
    sent.current = said;
    setSending(true);
    const mission = await attempt(() => send(form, key.current), m => `Searching for ${m.target}: mission ${m.id} is ${m.state}.`);
    setSending(false);
    if (!mission) return;
    sent.current = "";
    event.target.reset();
  }

  const robots = all("robot").filter(r => !r.stale);
  return html`<form class="mission-form" onSubmit=${submit}>
    <label for="target">What to find</label>
    <div class="row">
      <input id="target" name="target" list="targets" required maxlength="200" placeholder="potted plant" autocomplete="off" />
      <button class="primary" disabled=${sending}>${sending ? "Sending …" : "Search"}</button>
    </div>
    <datalist id="targets">${suggestions().map(t => html`<option value=${t} />`)}</datalist>
    <${Known} />
    <${AskCameras} target="target" />
    <details>
      <summary>Robot and limits</summary>
      <div class="row options">
        <label>Robot <select name="robot"><option value="">any free one</option>${robots.map(r => html`<option value=${r.id}>${r.id}</option>`)}</select></label>
        <label>Steps at most <input name="max_steps" type="number" min="1" max="100000" value="500" /></label>
        <label class="check"><input name="queue" type="checkbox" /> wait for a robot if none is free</label>
      </div>
    </details>
  </form>`;
}

/** A row of what is on the map already: one click fills the form. */
function Known() {
  const names = suggestions().slice(0, 6);
  if (!names.length) return null;
  const fill = name => { const input = document.getElementById("target"); input.value = name; input.focus(); };
  return html`<p class="chips" aria-label="Suggestions">${names.map(n => html`<button type="button" class="chip" onClick=${() => fill(n)}>${n}</button>`)}</p>`;
}

function send(form, key) {
  const goal = {
    target: form.get("target"), robot: form.get("robot") || null, max_steps: Number(form.get("max_steps") || 500), queue: form.has("queue"),
  };
  if (one("readiness", "")?.ready === false && !goal.queue) throw new Error(`Not ready: ${one("readiness", "").missing.join(", ")} is missing.`);
  return post("missions", goal, { "idempotency-key": key });
}
