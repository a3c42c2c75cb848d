// The bar at the top: which building, whether a mission could run, the emergency stop.
import { post } from "./api.js";
import { useNow } from "./clock.js";
import { connectionState } from "./connection.js";
import { session, signOut } from "./session.js";
import { one, useStore } from "./store.js";
import { ThemeButton } from "./theme.js";
import { attempt } from "./toasts.js";
import { html } from "./ui.js";

const stop = () => attempt(() => post("robots/stop", { reason: "by hand, on the page" }), answer => answer.items.length ? `Stopped: ${answer.items.map(r => r.robot).join(", ")}. Missions are paused.` : "No robot is there.");

function readiness() {
  const state = connectionState(), told = one("readiness", "");
  if (state === "loading" || (!told && state === "live")) return ["soft", "connecting …"];
  if (state === "lost") return ["bad", "no connection"];
  return told.ready ? ["good", "ready"] : ["warn", `not ready: ${told.missing.join(", ")}`];
}

export function Header() {
  useStore();
  useNow(); // silence is no event
  const [kind, text] = readiness(), building = one("building", "");
  return html`<header class="bar">
    <h1><img src=${new URL("../icon.svg", import.meta.url)} alt="" width="24" height="24" /><span>SurveilNav</span></h1>
    ${building && html`<span class="building" title="the building">${building.id}</span>`}
    <span class="pill ${kind}" id="readiness"><i aria-hidden="true"></i>${text}</span>
    <span class="grow"></span>
    ${session.needed && html`<button class="quiet" onClick=${signOut} title="signed in as ${session.name} (${session.role})">Sign out</button>`}
    <a class="quiet" href="docs">REST</a>
    <${ThemeButton} />
    <button class="stop" onClick=${stop}>Emergency stop</button>
  </header>`;
}
