// A stream of Server-Sent Events that comes back by itself, sleeps while nobody looks, and notices silence.

import { signInAgain } from "./session.js";

const AGAIN_MS = 2000;

/**
 * Listens at `path` while the page is visible.
 * `on`: by event, what to do with its data. `onState(alive)`: whether it is connected. Returns what ends it.
 */
export function listenTo(path, on, onState = () => {}) {
  let source = null, timer = 0, ended = false;

  function open() {
    clearTimeout(timer);
    if (ended || source || document.hidden) return;
    source = new EventSource(path);
    source.onopen = () => onState(true);
    source.onerror = () => {
      onState(false);
      if (source?.readyState === EventSource.CLOSED) { // refused: it wouldn't try again
        close();
        signInAgain();
        timer = setTimeout(open, AGAIN_MS);
      }
    };
    for (const [kind, take] of Object.entries(on)) source.addEventListener(kind, event => take(JSON.parse(event.data)));
  }
  function close() {
    source?.close();
    source = null;
  }
  function look() { document.hidden ? close() : open(); }

  document.addEventListener("visibilitychange", look);
  open();
  return () => {
    ended = true;
    clearTimeout(timer);
    document.removeEventListener("visibilitychange", look);
    close();
  };
}
