// A recording that is shown again: which moment, and going elsewhere.
import { patch } from "./api.js";
import { useNow } from "./clock.js";
import { timer } from "./format.js";
import { Icon } from "./icons.js";
import { listen, one, useStore } from "./store.js";
import { attempt } from "./toasts.js";
import { html, useState } from "./ui.js";

const SPEEDS = [0.5, 1, 2, 4, 8, 16];
const ANSWERS_MS = 10_000; // a change without an answer keeps the next one waiting for so long
const SETTLES_MS = 700; // until the stream tells of a jump
let settling = 0; // the timer until the slider is let go of
let grips = 0; // how often a person moved it
let heardMs = 0; // when the newest state came, for the moment since then
listen(kind => { if (kind === "replay") heardMs = performance.now(); });

/** Calls `jumped()` whenever a replay goes elsewhere: what was drawn before may lie in its future. */
export function onJump(jumped) {
  let jumps = null;
  return listen((kind, _, state) => {
    if (kind !== "replay" || !state) return;
    if (jumps !== null && jumps !== state.jumps) jumped();
    jumps = state.jumps;
  });
}

let wishes = {}; // what is wanted and not yet sent
let sending = null;

/** Has it changed, one change after the other: two at once arrive in any order. Of the wishes meanwhile the newest counts. */
function change(wanted) {
  Object.assign(wishes, wanted);
  return sending ??= send().finally(() => { sending = null; });
}

async function send() {
  while (Object.keys(wishes).length) {
    const now = wishes;
    wishes = {};
    await attempt(() => patch("replay", now, AbortSignal.timeout(ANSWERS_MS)));
  }
}

/** The moment that is shown now [s]: it goes on between two states. */
const momentOf = r => Math.min(r.duration_s, r.at_s + (r.playing ? r.speed * (performance.now() - heardMs) / 1000 : 0));

export function Replay() {
  useStore();
  useNow(250);
  const [held, hold] = useState(null); // where a person holds the slider
  const replay = one("replay", "");
  if (!replay) return null;
  const at = held ?? momentOf(replay);
  const take = event => { clearTimeout(settling); grips++; hold(+event.target.value); };
  const letGo = () => { clearTimeout(settling); settling = setTimeout(() => hold(null), SETTLES_MS); };
  const go = async event => {
    clearTimeout(settling);
    const grip = grips;
    await change({ at_s: +event.target.value });
    if (grip === grips) letGo(); // else a person holds it again
  };
  const stay = () => { if (!sending) letGo(); }; // put back where it was, which is no change
  const speeds = SPEEDS.includes(replay.speed) ? SPEEDS : [...SPEEDS, replay.speed].sort((a, b) => a - b);
  return html`<section class="strip replay" aria-label="Replay">
    <b>Recording</b>
    <button class="icon" aria-label=${replay.playing ? "Pause" : "Play"} onClick=${() => change({ playing: !replay.playing })}>
      <${Icon} name=${replay.playing ? "pause" : "play"} /></button>
    <input type="range" id="moment" aria-label="Moment of the recording" aria-valuetext="${timer(at)} of ${timer(replay.duration_s)}"
      min="0" max=${replay.duration_s} step="0.1" value=${at} onInput=${take} onChange=${go} onPointerUp=${stay} onBlur=${stay} />
    <span class="n">${timer(at)} / ${timer(replay.duration_s)}</span>
    <select aria-label="Speed" value=${replay.speed} onChange=${event => change({ speed: +event.target.value })}>
      ${speeds.map(s => html`<option value=${s} selected=${s === replay.speed}>${s} ×</option>`)}</select>
    <span class="soft small">“${replay.target}”, ${replay.began ? new Date(replay.began).toLocaleString() : "time unknown"}</span>
  </section>`;
}
