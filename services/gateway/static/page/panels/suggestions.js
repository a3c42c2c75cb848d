// Words for the form: what is known to be there first, then what was asked for, then what perception knows.
import { get } from "../api.js";
import { all, redraw } from "../store.js";

let known = [];
let asked = "";

/** Asks what perception knows, again when other workers are there. */
function ask() {
  const workers = all("worker").filter(w => !w.stale && w.ready).map(w => `${w.id} ${w.backend}`).join();
  if (!workers || workers === asked) return;
  asked = workers;
  get("targets").then(answer => { known = answer.items.map(t => t.name); redraw(); }, () => { asked = ""; });
}

export function suggestions() {
  ask();
  const score = new Map();
  for (const o of all("object")) if (o.status !== "rejected") score.set(o.label, Math.max(score.get(o.label) ?? 0, (o.status === "confirmed" ? 1 : 0) + (o.confidence ?? 0)));
  const there = [...score].sort((a, b) => b[1] - a[1]).map(([label]) => label);
  return [...new Set([...there, ...all("mission").map(m => m.target), ...known])];
}
