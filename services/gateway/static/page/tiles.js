// Small pictures of the cameras on the screen, over one connection. What isn't looked at isn't asked for.
import { address, part } from "./api.js";
import { redraw } from "./store.js";
import { listenTo } from "./stream.js";

const MOST = 32;
const SETTLE_MS = 400;
const wanted = new Map(); // "camera/view" -> how many parts of the page show it
const pictures = new Map(); // "camera/view" -> {url, problem, atMs}
let end = null, timer = 0, open = "";

export const tileOf = id => pictures.get(id) ?? {};

/** Shows a view from now on; returns what ends that. */
export function wantTile(id) {
  wanted.set(id, (wanted.get(id) ?? 0) + 1);
  settle();
  return () => {
    const left = wanted.get(id) - 1;
    left ? wanted.set(id, left) : wanted.delete(id);
    settle();
  };
}

/** Connects anew once nothing more comes or goes for a moment. */
function settle() {
  clearTimeout(timer);
  timer = setTimeout(() => {
    const ids = [...wanted.keys()].sort().slice(0, MOST), path = `tiles?${ids.map(id => `of=${part(id)}`).join("&")}`;
    if (path === open) return;
    open = path;
    end?.();
    end = ids.length ? listenTo(address(path), { tile: take }) : null;
    for (const id of pictures.keys()) if (!wanted.has(id)) drop(id);
  }, SETTLE_MS);
}

function drop(id) {
  const url = pictures.get(id)?.url;
  if (url) URL.revokeObjectURL(url);
  pictures.delete(id);
}

function take({ id, state }) {
  if (!state) return drop(id);
  const before = pictures.get(id);
  if (state.jpeg) {
    if (before?.url) URL.revokeObjectURL(before.url);
    pictures.set(id, { url: URL.createObjectURL(new Blob([bytesOf(state.jpeg)], { type: "image/jpeg" })), atMs: Date.now() });
  } else pictures.set(id, { ...before, problem: state.detail });
  redraw();
}

const bytesOf = base64 => Uint8Array.from(atob(base64), c => c.charCodeAt(0));
