// A mission under way: how far it is, what it does and why, and what a person can do about it.
import { part, post } from "../api.js";
import { useNow } from "../clock.js";
import { bytes, metres, secondsSince, timer } from "../format.js";
import { one } from "../store.js";
import { attempt } from "../toasts.js";
import { html } from "../ui.js";
import { Candidates } from "./candidates.js";
import { MissionId, StateBadge } from "./mission-parts.js";

const act = (mission, what, body) => attempt(() => post(`missions/${part(mission.id)}/${what}`, body), `Mission for ${mission.target}: ${what === "cancel" ? "cancelled" : `${what}d`}.`);

function Fact({ name, value }) {
  return html`<div><dt>${name}</dt><dd>${value}</dd></div>`;
}

function Progress({ mission }) {
  if (!mission.max_steps) return null;
  return html`<div class="progress">
    <progress max=${mission.max_steps} value=${mission.step} aria-label="steps used"></progress>
    <span>${mission.step} of ${mission.max_steps} steps</span></div>`;
}

/** What it has cost, and what it may come to. */
function Cost({ mission: m }) {
  const cost = one("cost", m.id);
  if (!cost) return null;
  const forecast = cost.at_most_bytes != null && html`, at most <b>${bytes(cost.at_most_bytes)}</b> if it uses all its steps`;
  return html`<p class="cost small"><b>${bytes(cost.offered_bytes)}</b> sent by cameras and robots${cost.alone ? "" : " (shared with other missions)"}${forecast}</p>`;
}

function Actions({ mission }) {
  const paused = mission.state === "paused", queued = mission.state === "queued";
  return html`<div class="row actions">
    ${!queued && html`<button onClick=${() => act(mission, paused ? "resume" : "pause", paused ? undefined : { reason: "by hand, on the page" })}>${paused ? "Resume" : "Pause"}</button>`}
    <button class="danger" onClick=${() => act(mission, "cancel", { reason: "by hand, on the page" })}>Cancel</button>
  </div>`;
}

export function MissionCard({ mission: m }) {
  const now = useNow(), plan = one("plan", m.id);
  const elapsed = m.state === "paused" || m.stale || one("replay", "") ? m.elapsed_s : secondsSince(m.started, now);
  return html`<article class="card ${m.stale ? "stale" : ""}" data-mission=${m.id} aria-label="Mission for ${m.target}">
    <div class="row head"><h3>${m.target}</h3><${StateBadge} mission=${m} /><span class="grow"></span><${MissionId} id=${m.id} /></div>
    ${m.asked && html`<p class="soft">asked for as “${m.asked}”</p>`}
    ${m.stale && html`<p class="warn-text">The planner is gone: this is how it was.</p>`}
    <p class="why">${plan?.why || m.message || m.phase}</p>
    <${Progress} mission=${m} />
    <dl class="facts">
      <${Fact} name="waypoint in" value=${metres(m.distance_remaining_m)} />
      <${Fact} name="there in" value=${timer(m.time_remaining_s)} />
      <${Fact} name="driven" value=${metres(m.path_m)} />
      <${Fact} name="since" value=${timer(elapsed)} />
    </dl>
    <${Cost} mission=${m} />
    <${Actions} mission=${m} />
    ${plan && html`<${Candidates} plan=${plan} />`}
  </article>`;
}
