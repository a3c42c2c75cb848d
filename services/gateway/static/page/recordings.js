// The files of missions: which has one, asked again when a mission ended or a recorder came.
import { address, get, part } from "./api.js";
import { all, redraw } from "./store.js";

let byMission = new Map();
let asked = "";

/** Asks once for each change that may have brought a recording. */
function ask() {
  // A file is closed a moment after its mission's end: what recorders write counts, too.
  const now = [...all("recorder").map(r => `${r.id} ${r.recording}`), ...all("mission").map(m => m.finished ?? "")].join();
  if (!all("recorder").length || now === asked) return;
  asked = now;
  get("recordings?limit=100").then(answer => { byMission = new Map(answer.items.map(r => [r.mission, r])); redraw(); }, () => { asked = ""; });
}

/** {address, bytes} of the file of a mission; null: there is none, or it isn't complete. */
export function recordingOf(mission) {
  ask();
  const found = byMission.get(mission);
  return found && found.state !== "recording" ? { address: address(`recordings/${part(found.id)}/file`), bytes: found.n_bytes } : null;
}
