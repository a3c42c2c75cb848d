// The buttons that zoom, for who has no wheel.
import { Icon } from "../icons.js";
import { html } from "../ui.js";

export function Zoom({ zoom, fit }) {
  return html`<div class="zoom"><button aria-label="Zoom in" onClick=${() => zoom(1.3)}><${Icon} name="plus" /></button>
    <button aria-label="Zoom out" onClick=${() => zoom(0.77)}><${Icon} name="minus" /></button>
    <button aria-label="Show everything" title="Show everything (0)" onClick=${() => fit()}><${Icon} name="fit" /></button></div>`;
}
