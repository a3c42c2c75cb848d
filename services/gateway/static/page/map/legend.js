// What the colours of the map mean.
import { html } from "../ui.js";

export function Legend({ range, problem, prior, areas }) {
  const zones = areas.some(a => a.kind === "keepout"), passages = areas.some(a => a.kind !== "keepout");
  return html`<div class="legend">
    ${range && html`<span>value <b>${range[0].toFixed(2)}</b> <span class="scale" aria-hidden="true"></span> <b>${range[1].toFixed(2)}</b></span>`}
    ${!range && problem && html`<span class="soft">value: ${problem.startsWith("the value layer belongs") ? "comes with the first mission" : problem}</span>`}
    ${prior && html`<span><i class="square prior" aria-hidden="true"></i>known from a map, not seen yet</span>`}
    ${zones && html`<span><i class="square barred" aria-hidden="true"></i>keepout zone</span>`}
    ${passages && html`<span><i class="square barred thick" aria-hidden="true"></i>closed door or lift</span><span><i class="square open" aria-hidden="true"></i>open</span>`}
    <span><i class="dot confirmed" aria-hidden="true"></i>confirmed</span>
    <span><i class="dot candidate" aria-hidden="true"></i>candidate</span>
    <span><i class="dash plan" aria-hidden="true"></i>plan</span>
    <span><i class="dash robot" aria-hidden="true"></i>way so far</span>
  </div>`;
}
