// The page as a whole: what stands where.
import { Alerts } from "./alerts.js";
import { Connection } from "./connection-banner.js";
import { Header } from "./header.js";
import { MapPanel } from "./map/panel.js";
import { CameraPanel } from "./panels/cameras.js";
import { MissionPanel } from "./panels/missions.js";
import { ObjectPanel } from "./panels/objects.js";
import { RemovalDialog } from "./panels/removal.js";
import { TrafficPanel } from "./panels/traffic.js";
import { Replay } from "./replay.js";
import { Toasts } from "./toasts.js";
import { html } from "./ui.js";

const SECTIONS = [["map", "Map"], ["missions", "Missions"], ["cameras", "Cameras"], ["objects", "Objects"], ["traffic", "Traffic"]];

function Jumps() {
  return html`<nav class="jumps" aria-label="Sections">${SECTIONS.map(([id, name]) => html`<a href="#${id}">${name}</a>`)}</nav>`;
}

export function App() {
  return html`
    <${Header} />
    <div class="strips"><${Connection} /><${Replay} /><${Alerts} /></div>
    <main>
      <div class="column left"><${MissionPanel} /></div>
      <div class="column centre"><${MapPanel} /><${TrafficPanel} /></div>
      <div class="column right"><${CameraPanel} /><${ObjectPanel} /></div>
    </main>
    <${Jumps} />
    <${RemovalDialog} />
    <${Toasts} />`;
}
