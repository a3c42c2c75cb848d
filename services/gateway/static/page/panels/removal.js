// Taking what a camera or a robot has contributed out of the maps again: asked for in a dialog, told of when it is done.
import { part, post } from "../api.js";
import { Icon } from "../icons.js";
import { all, listen, one, redraw, useStore } from "../store.js";
import { attempt, toast } from "../toasts.js";
import { html, useEffect, useRef, useState } from "../ui.js";

let asked = null; // the source that the dialog is open for

/** Opens the dialog for "camera/c1" or "robot/r1". */
export function askRemoval(source) {
  asked = source;
  redraw();
}

/** The dialog, while somebody asks for a removal. */
export function RemovalDialog() {
  useStore();
  return asked && html`<${Dialog} key=${asked} first=${asked} />`;
}

function Dialog({ first }) {
  const dialog = useRef(), [source, setSource] = useState(first), [since, setSince] = useState(""), [until, setUntil] = useState(""), [pause, setPause] = useState(true);
  useEffect(() => { dialog.current.showModal(); }, []);
  const close = () => askRemoval(null);
  const [kind, id] = [source.slice(0, source.indexOf("/")), source.slice(source.indexOf("/") + 1)];
  const camera = kind === "camera" ? one("camera", id) : null, looks = camera && !camera.stale && !camera.paused;
  const submit = async event => {
    event.preventDefault();
    const body = { source, since: since ? new Date(since).toISOString() : null, until: until ? new Date(until).toISOString() : null };
    const begun = await attempt(async () => {
      if (looks && pause) await post(`cameras/${part(id)}/pause`);
      return post("removals", body);
    });
    if (begun) dialog.current.close();
  };
  return html`<dialog ref=${dialog} class="removal" onClose=${close} aria-labelledby="removal-title">
    <form onSubmit=${submit}>
      <div class="row head"><h2 id="removal-title">Take out of the maps</h2><span class="grow"></span>
        <button type="button" class="icon" aria-label="Close" onClick=${() => dialog.current.close()}><${Icon} name="close" /></button></div>
      <label>What was contributed by <select value=${source} onChange=${e => setSource(e.target.value)}>${sources(first).map(s => html`<option value=${s}>${s}</option>`)}</select></label>
      <div class="row spans"><label>from <input type="datetime-local" step="1" value=${since} onInput=${e => setSince(e.target.value)} /></label>
        <label>to <input type="datetime-local" step="1" value=${until} min=${since} onInput=${e => setUntil(e.target.value)} /></label><span class="soft small">empty: always</span></div>
      ${looks && html`<label class="check"><input type="checkbox" checked=${pause} onChange=${e => setPause(e.target.checked)} /> Pause the camera first. Else what it sees from now on enters the maps again.</label>`}
      <p>Maps and objects become what they would be had it never been there. Missions go on. <b>This can't be undone.</b></p>
      <div class="row"><span class="grow"></span><button type="button" onClick=${() => dialog.current.close()}>Cancel</button><button class="danger">Take it out</button></div>
    </form>
  </dialog>`;
}

function sources(first) {
  const known = [...all("camera").map(c => `camera/${c.id}`), ...all("robot").map(r => `robot/${r.id}`)];
  return known.includes(first) ? known : [first, ...known];
}

const running = new Set();

/** Says what came of removals that this page has seen running. */
listen((kind, id, removal) => {
  if (kind !== "removal" || !removal) return;
  if (removal.state === "running") running.add(id);
  else if (running.delete(id)) toast(`${removal.source}: ${removal.state === "done" ? `taken out of the maps by ${removal.way}; ` : "still in the maps: "}${removal.message}.`, removal.state === "done" ? "good" : "bad");
});
