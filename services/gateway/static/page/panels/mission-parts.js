// What cards and tables of missions share.
import { shortId } from "../format.js";
import { toast } from "../toasts.js";
import { html } from "../ui.js";

const KIND = { active: "live", confirming: "live", queued: "soft", paused: "warn", done: "good", failed: "bad", cancelled: "soft" };

/** `found` is what the planner believes: it says so. Where the building is simulated, the simulator has judged it. */
export function StateBadge({ mission: m }) {
  const found = m.state === "done" && m.found;
  const text = m.state !== "done" ? m.state : found ? "found" : "ended";
  const kind = m.state === "done" && !m.found ? "soft" : found && m.judged === false ? "bad" : KIND[m.state] ?? "soft";
  return html`<span class="badge ${kind}" title=${found ? WHO[m.judged] ?? WHO.nobody : m.error ?? ""}>${text}${found && html`<small>${SAID[m.judged] ?? SAID.nobody}</small>`}</span>`;
}
const SAID = { true: ", and right", false: ", but wrong", nobody: " by its belief" };
const WHO = {
  true: "The planner believes that the robot stands at its target, and the simulator agrees.",
  false: "The planner believes that the robot stands at its target. The simulator says that it doesn't.",
  nobody: "The planner believes that the robot stands at its target. Nobody has checked.",
};

/** A short id; the full one on hover, and copied on click. */
export function MissionId({ id }) {
  const copy = async () => {
    try { await navigator.clipboard.writeText(id); toast(`Copied ${id}.`); }
    catch { toast(id); }
  };
  return html`<button class="id" onClick=${copy} title="${id} (click to copy)" aria-label="Copy the id ${id}">${shortId(id)}</button>`;
}
