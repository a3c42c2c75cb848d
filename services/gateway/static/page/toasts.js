// Short news of what somebody just did, read out by screen readers.
import { html, useEffect, useState } from "./ui.js";

const SHOWN_MS = 6000;
const MOST = 3;
let toasts = [];
let draw = () => {};

/** Says something for a few seconds. `kind`: "good" or "bad". */
export function toast(text, kind = "good") {
  const entry = { text, kind };
  toasts = [...toasts, entry].slice(-MOST);
  draw();
  setTimeout(() => { toasts = toasts.filter(t => t !== entry); draw(); }, SHOWN_MS);
}

/** Runs what a person asked for, and says what came of it. */
export async function attempt(action, done) {
  try {
    const result = await action();
    if (done) toast(typeof done === "function" ? done(result) : done);
    return result;
  } catch (error) {
    toast(error.message, "bad");
    return undefined;
  }
}

export function Toasts() {
  const [, again] = useState(0);
  useEffect(() => { draw = () => again(n => n + 1); }, []);
  return html`<div class="toasts" role="status" aria-live="polite">
    ${toasts.map(t => html`<p class="toast ${t.kind}">${t.text}</p>`)}</div>`;
}
