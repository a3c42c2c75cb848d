// What isn't as it should be, and since when.
import { post } from "./api.js";
import { useNow } from "./clock.js";
import { ago, clock, secondsSince } from "./format.js";
import { all, one, useStore } from "./store.js";
import { attempt } from "./toasts.js";
import { html } from "./ui.js";

/** A camera that was heard of a moment ago may come back at once: until then it is stale, then offline. */
export const OFFLINE_AFTER_S = 10;
const noticed = new Map(); // what has no time of its own: when this page first saw it

/** "live", "paused", "stale" or "offline"; of a camera also what its stream is doing, such as "frozen". */
export function presence(thing, now) {
  if (thing.stale) return secondsSince(thing.last_seen, now) < OFFLINE_AFTER_S ? "stale" : "offline";
  if (thing.paused) return "paused";
  return thing.stream?.state ?? "live";
}

/** [{key, kind, text, since}] of the store as it is. */
function found(now) {
  const list = [];
  const add = (key, kind, text, since) => list.push({ key, kind, text, since });
  const halted = all("robot").filter(r => r.state === "halted" && !r.stale);
  if (halted.length) add("halted", "halted", `${names(halted)} stopped by hand, and won't move until released. Missions stay paused after that.`, null);
  for (const r of all("robot")) if (r.stale) add(`robot ${r.id}`, "bad", `Robot ${r.id} is silent`, r.last_seen);
  for (const c of all("camera")) if (c.stale) add(`camera ${c.id}`, "bad", `Camera ${c.id} is ${presence(c, now)}`, c.last_seen);
    else if (!["live", "connecting"].includes(c.stream.state)) add(`stream ${c.id}`, "bad", `The stream of camera ${c.id} is ${c.stream.state.replace("_", " ")}: ${c.stream.reason}`, c.stream.since);
  for (const c of all("camera")) if (c.quarantine && !c.stale) add(`quarantine ${c.id}`, "bad", `Camera ${c.id} isn't believed until it is calibrated anew: ${c.quarantine}`, null);
  for (const r of all("robot")) if (r.frame_problem && !r.stale) add(`frame ${r.id}`, "bad", capital(r.frame_problem), null);
  const workers = all("worker");
  for (const w of workers) if (w.stale && workers.length > 1) add(`worker ${w.id}`, "warn", `Perception worker ${w.id} is gone`, w.last_seen);
  for (const kind of one("readiness", "")?.missing ?? []) if (kind !== "robot") add(`missing ${kind}`, "bad", MISSING[kind] ?? `${kind} is missing`, lastOf(kind));
  for (const s of all("service")) if (s.given_up) add(`service ${s.id}`, "bad", `${s.id} ended too often (${s.why ?? "no reason known"}) and isn't started any more`, s.restarted);
  for (const r of all("recorder")) if (r.problem && !r.stale) add(`recorder ${r.id}`, "warn", `Not everything is recorded: ${r.problem}`, null);
  for (const f of all("floor")) if (f.perception_ok === false && !f.stale) add(`floor ${f.id}`, "warn", f.message || `Perception doesn't answer for floor ${f.id}`, null);
  for (const r of all("removal")) if (r.state === "running") add(`removal ${r.id}`, "warn", `${r.source} is being taken out of the maps${r.views_total ? `: ${r.views_done} of ${r.views_total} views` : ""}. The old maps serve meanwhile`, r.requested);
  return list;
}

const MISSING = {
  perception: "Perception is down: new pictures aren't looked at", fusion: "Fusion is down: the maps don't change",
  planner: "The planner is down: no mission can run", router: "The router is down: nothing is heard",
};
const capital = text => text[0].toUpperCase() + text.slice(1);
const names = robots => robots.length === 1 ? `Robot ${robots[0].id} is` : `${robots.length} robots are`;

function lastOf(kind) {
  const times = kind === "perception" ? all("worker").map(w => w.last_seen) : [];
  return times.sort().at(-1) ?? null;
}

/** With a time for each: its own, or when this page noticed. */
function alerts(now) {
  const list = found(now), keys = new Set(list.map(a => a.key));
  for (const key of noticed.keys()) if (!keys.has(key)) noticed.delete(key);
  for (const a of list) if (!noticed.has(a.key)) noticed.set(a.key, new Date(now).toISOString());
  return list.map(a => ({ ...a, since: a.since ?? noticed.get(a.key) }));
}

const release = () => attempt(() => post("robots/release"), "Released. Missions stay paused until you resume them.");

function Alert({ alert, now }) {
  return html`<div class="strip ${alert.kind === "halted" ? "bad" : alert.kind}" data-alert=${alert.key}>
    <span>${alert.text}</span>
    <span class="since" aria-live="off">since ${clock(alert.since)}, ${ago(alert.since, now)}</span>
    ${alert.kind === "halted" && html`<button onClick=${release}>Release robots</button>`}
  </div>`;
}

export function Alerts() {
  useStore();
  const now = useNow();
  return html`<div role="region" aria-label="Alerts" aria-live="polite">
    ${alerts(now).map(a => html`<${Alert} key=${a.key} alert=${a} now=${now} />`)}</div>`;
}
