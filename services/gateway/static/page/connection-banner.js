// Says when the gateway is gone, and how old is what is shown.
import { useNow } from "./clock.js";
import { connection, connectionState } from "./connection.js";
import { duration } from "./format.js";
import { html, useEffect } from "./ui.js";

export function Connection() {
  const now = useNow(), state = connectionState(now);
  useEffect(() => { document.documentElement.dataset.connection = state; }, [state]);
  if (state !== "lost") return null;
  const age = connection.begun ? `What you see is ${duration((now - connection.heardMs) / 1000)} old.` : "Nothing was heard of it yet.";
  return html`<div class="strip bad" role="alert"><b>The gateway doesn't answer.</b> ${age} This page connects again by itself.</div>`;
}
