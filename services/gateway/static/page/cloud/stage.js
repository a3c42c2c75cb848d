// The 3D view in the map's place.
import { html, useEffect, useRef, useState } from "../ui.js";
import { Zoom } from "../map/zoom.js";
import { CloudView } from "./view.js";

export function CloudStage({ floor }) {
  const points = useRef(), names = useRef(), view = useRef(), [said, say] = useState("Loading the cloud …"), [cut, setCut] = useState(2);
  useEffect(() => {
    try { view.current = new CloudView(points.current, names.current, say); view.current.show(floor); } catch (error) { say(error.message); }
    return () => view.current?.end();
  }, []);
  useEffect(() => view.current?.show(floor), [floor]);
  useEffect(() => view.current?.setCut(cut), [cut]);
  return html`<canvas ref=${points} aria-hidden="true"></canvas>
    <canvas ref=${names} class="names" tabindex="0" role="application" aria-label="The joint cloud of floor ${floor} in 3D. Arrow keys turn it, plus and minus zoom, 0 shows everything."></canvas>
    <${Zoom} zoom=${factor => view.current?.zoom(factor)} fit=${() => view.current?.fit()} />
    <div class="cut"><label>up to <b>${cut.toFixed(1)} m</b> <input type="range" min="0.2" max="4" step="0.1" value=${cut} onInput=${e => setCut(Number(e.target.value))} /></label><span class="soft">${said}</span></div>`;
}
