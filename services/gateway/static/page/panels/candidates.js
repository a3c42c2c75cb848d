// What the planner weighed for its waypoint, and why it chose as it did.
import { metres, percent } from "../format.js";
import { highlight } from "../map/selection.js";
import { html } from "../ui.js";

const KINDS = { frontier: "frontier", candidate: "perhaps the target", object: "object", stairs: "stairs", second_look: "look around", target: "target" };
const MOST = 6;

/** Chosen first, then by utility. */
export const ranked = plan => [...plan.candidates].sort((a, b) => (b.chosen - a.chosen) || ((b.utility ?? -1) - (a.utility ?? -1)));

function Candidate({ place, best }) {
  const at = { x: place.x_m, y: place.y_m };
  return html`<li class=${place.chosen ? "chosen" : ""} onMouseEnter=${() => highlight(at)} onMouseLeave=${() => highlight(null)}>
    <span class="what">${KINDS[place.kind] ?? place.kind}${place.object_id == null ? "" : ` #${place.object_id}`}</span>
    <span class="worth"><span class="bar" aria-hidden="true"><i data-share=${share(place.utility, best)}></i></span>${worth(place)}</span>
    <span class="note">${place.note}</span></li>`;
}

const share = (utility, best) => utility == null || !(best > 0) ? 0 : Math.round(10 * Math.max(0, Math.min(1, utility / best)));
/** The chance and the way that make up its utility. */
const worth = place => place.chance == null || place.cost_m == null ? "" : `${percent(place.chance)} in ${place.cost_m.toFixed(1)} m`;

export function Candidates({ plan }) {
  const list = ranked(plan), best = Math.max(...list.map(c => c.utility ?? 0), 0);
  if (!list.length) return null;
  return html`<details class="candidates"><summary>${list.length === 1 ? "The one place weighed" : `${list.length} places weighed`}${plan.waypoint?.x_m != null ? `, next: ${metres(plan.waypoint.x_m)}, ${metres(plan.waypoint.y_m)}` : ""}</summary>
    <ol>${list.slice(0, MOST).map(c => html`<${Candidate} place=${c} best=${best} />`)}</ol>
    ${list.length > MOST && html`<p class="soft">and ${list.length - MOST} more</p>`}</details>`;
}
