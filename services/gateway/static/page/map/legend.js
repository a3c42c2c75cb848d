// What the colours of the map mean.
import { html } from "../ui.js";

export function Legend({ range, problem, prior }) {
  return html`<div class="legend">
    ${range && html`<span>value <b>${range[0].toFixed(2)}</b> <span class="scale" aria-hidden="true"></span> <b>${range[1].toFixed(2)}</b></span>`}
    ${!range && problem && html`<span class="soft">value: ${problem.startsWith("the value layer belongs") ? "comes with the first mission" : problem}</span>`}
    ${prior && html`<span><i class="square prior" aria-hidden="true"></i>known from a map, not seen yet</span>`}
    <span><i class="dot confirmed" aria-hidden="true"></i>confirmed</span>
    <span><i class="dot candidate" aria-hidden="true"></i>candidate</span>
    <span><i class="dash plan" aria-hidden="true"></i>plan</span>
    <span><i class="dash robot" aria-hidden="true"></i>way so far</span>
  </div>`;
}
