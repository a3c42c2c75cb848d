// What the planner weighed for its waypoint, and why it chose as it did.
import { metres } from "../format.js";
import { highlight } from "../map/selection.js";
import { html } from "../ui.js";

const KINDS = { frontier: "frontier", candidate: "perhaps the target", object: "object", stairs: "stairs", target: "target" };
const MOST = 6;

/** Chosen first, then by score. */
export const ranked = plan => [...plan.candidates].sort((a, b) => (b.chosen - a.chosen) || ((b.score ?? -1) - (a.score ?? -1)));

function Candidate({ place, best }) {
  const at = { x: place.x_m, y: place.y_m };
  return html`<li class=${place.chosen ? "chosen" : ""} onMouseEnter=${() => highlight(at)} onMouseLeave=${() => highlight(null)}>
    <span class="what">${KINDS[place.kind] ?? place.kind}${place.object_id == null ? "" : ` #${place.object_id}`}</span>
    <span class="score"><span class="bar" aria-hidden="true"><i data-share=${share(place.score, best)}></i></span>${place.score == null ? "" : place.score.toFixed(2)}</span>
    <span class="note">${place.note}</span></li>`;
}

const share = (score, best) => score == null || !(best > 0) ? 0 : Math.round(10 * Math.max(0, Math.min(1, score / best)));

export function Candidates({ plan }) {
  const list = ranked(plan), best = Math.max(...list.map(c => c.score ?? 0), 0);
  if (!list.length) return null;
  return html`<details class="candidates"><summary>${list.length === 1 ? "The one place weighed" : `${list.length} places weighed`}${plan.waypoint?.x_m != null ? `, next: ${metres(plan.waypoint.x_m)}, ${metres(plan.waypoint.y_m)}` : ""}</summary>
    <ol>${list.slice(0, MOST).map(c => html`<${Candidate} place=${c} best=${best} />`)}</ol>
    ${list.length > MOST && html`<p class="soft">and ${list.length - MOST} more</p>`}</details>`;
}
