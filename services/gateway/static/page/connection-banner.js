// Says when the gateway is gone, and how old is what is shown.
import { useNow } from "./clock.js";
import { connection, connectionState } from "./connection.js";
import { duration } from "./format.js";
import { html, useEffect } from "./ui.js";

export function Connection() {
  const state = connectionState();
  useNow(); // the age grows
  useEffect(() => { document.documentElement.dataset.connection = state; }, [state]);
  if (state !== "lost") return null;
  const age = connection.begun ? `What you see is ${duration((Date.now() - connection.heardMs) / 1000)} old.` : "Nothing was heard of it yet.";
  return html`<div class="strip bad" role="alert"><b>The gateway doesn't answer.</b> <span aria-hidden="true">${age}</span> This page connects again by itself.</div>`;
}
