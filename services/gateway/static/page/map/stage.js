// The flat map: a canvas, zoom, a hint beside the pointer.
import { percent } from "../format.js";
import { html, useEffect, useRef, useState } from "../ui.js";
import { MapCanvas } from "./canvas.js";
import { chooseCamera, chooseObject } from "./selection.js";
import { Zoom } from "./zoom.js";

/** `onLayers(layers)`: called when pictures came. */
export function MapStage({ floor, shown, onLayers }) {
  const canvas = useRef(), map = useRef(), [hint, setHint] = useState(null);
  useEffect(() => {
    const onHover = (found, u, v) => setHint(found && { text: describe(found), u, v });
    map.current = new MapCanvas(canvas.current, { onPick: pick, onHover, onLayers });
    return () => map.current.end();
  }, []);
  useEffect(() => map.current.show(floor, shown), [floor, shown]);
  return html`<canvas ref=${canvas} tabindex="0" role="application" aria-label="Map of floor ${floor ?? "?"}. Arrow keys move it, plus and minus zoom, 0 shows everything."></canvas>
    <${Zoom} zoom=${factor => map.current.zoom(factor)} fit=${() => map.current.fit()} />
    ${hint && html`<${Hint} ...${hint} />`}`;
}

function pick(found) {
  if (found?.kind === "object") chooseObject(`${found.thing.floor}/${found.thing.id}`);
  if (found?.kind === "camera") { chooseCamera(found.thing.id); document.getElementById(`camera-${found.thing.id}`)?.scrollIntoView({ block: "nearest" }); }
}

function describe({ kind, thing }) {
  if (kind === "object") return `${thing.label} #${thing.id}, ${thing.status} ${percent(thing.confidence)} (click for its history)`;
  if (kind === "camera") return `camera ${thing.id}${thing.stale ? ", gone" : thing.paused ? ", paused" : thing.invoked ? `, invoked: ${thing.views_processed} of ${thing.views.length} views` : ", not invoked"}`;
  if (kind === "place") return `${thing.kind}${thing.chosen ? ", chosen" : ""}: ${thing.note}`;
  return `robot ${thing.id}, ${thing.state}${thing.battery == null ? "" : `, battery ${Math.round(100 * thing.battery)} %`}${thing.message ? `: ${thing.message}` : ""}`;
}

function Hint({ text, u, v }) {
  const box = useRef();
  useEffect(() => { box.current.style.transform = `translate(${u + 14}px, ${v + 14}px)`; }, [u, v]);
  return html`<div class="hint" ref=${box}>${text}</div>`;
}
