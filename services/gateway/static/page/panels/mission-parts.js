// What cards and tables of missions share.
import { shortId } from "../format.js";
import { toast } from "../toasts.js";
import { html } from "../ui.js";

const KIND = { active: "live", confirming: "live", queued: "soft", paused: "warn", done: "good", failed: "bad", cancelled: "soft" };

/** `found` is what the planner believes: it says so. */
export function StateBadge({ mission: m }) {
  const done = m.state === "done";
  const text = done ? (m.found ? "found" : "ended") : m.state;
  return html`<span class="badge ${done && !m.found ? "soft" : KIND[m.state] ?? "soft"}" title=${done && m.found ? "The planner believes that the robot stands at its target." : m.error ?? ""}>${text}${done && m.found && html`<small> by its belief</small>`}</span>`;
}

/** A short id; the full one on hover, and copied on click. */
export function MissionId({ id }) {
  const copy = async () => {
    try { await navigator.clipboard.writeText(id); toast(`Copied ${id}.`); }
    catch { toast(id); }
  };
  return html`<button class="id" onClick=${copy} title="${id} (click to copy)" aria-label="Copy the id ${id}">${shortId(id)}</button>`;
}
