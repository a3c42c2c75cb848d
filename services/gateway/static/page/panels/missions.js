// Missions: a form, what is under way, and what was.
import { all, useStore } from "../store.js";
import { html } from "../ui.js";
import { MissionCard } from "./mission-card.js";
import { MissionForm } from "./mission-form.js";
import { MissionTable } from "./mission-table.js";

export const FINISHED = ["done", "failed", "cancelled"];
export const underWay = m => !FINISHED.includes(m.state);

/** Newest first. */
export const missions = () => all("mission").sort((a, b) => String(b.started ?? "9").localeCompare(String(a.started ?? "9")));

export function MissionPanel() {
  useStore();
  const list = missions(), active = list.filter(underWay);
  return html`<section class="panel" id="missions" aria-labelledby="missions-title">
      <h2 id="missions-title">Search</h2>
      <${MissionForm} />
      ${active.map(m => html`<${MissionCard} key=${m.id} mission=${m} />`)}
    </section>
    <section class="panel" id="missions-past" aria-labelledby="history-title">
      <h2 id="history-title">Missions</h2>
      <${MissionTable} missions=${list} />
    </section>`;
}
