// The stream of the building's state, and whether it is alive.
import { address } from "./api.js";
import { KINDS, clear, put, redraw } from "./store.js";
import { listenTo } from "./stream.js";

/** The gateway says every 5 s that it lives; after so long without a word it is taken for silent. */
const SILENT_MS = 15000;

/** `begun`: anything was ever heard; `heardMs`: when last; `open`: the connection stands. */
export const connection = { begun: false, open: false, heardMs: 0 };

/** "loading", "live", or "lost": the connection is gone, or nothing comes over it. */
export function connectionState() {
  const now = Date.now();
  if (!connection.begun) return now - startedMs > SILENT_MS ? "lost" : "loading";
  return connection.open && now - connection.heardMs < SILENT_MS ? "live" : "lost";
}
const startedMs = Date.now();

function heard() {
  connection.begun = true;
  connection.heardMs = Date.now();
}

export function connect() {
  const on = { reset: () => { clear(); heard(); }, beat: heard };
  for (const kind of KINDS) on[kind] = ({ id, state }) => { heard(); put(kind, id, state); };
  document.addEventListener("visibilitychange", () => { if (!document.hidden) connection.heardMs = Math.max(connection.heardMs, Date.now() - SILENT_MS / 2); });
  return listenTo(address("live"), on, open => { connection.open = open; if (open) heard(); redraw(); });
}
