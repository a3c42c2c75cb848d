// Below the pictures: the points, the pose that follows from them, and what is done with it.
import { Icon } from "../page/icons.js";
import { html, useEffect, useRef, useState } from "../page/ui.js";
import { colourOf } from "./markers.js";
import { model, useModel } from "./model.js";
import * as server from "./server.js";

const HEIGHTS = [["Floor", 0], ["Door top", 2]];
const STEEP_DEG = -80; // from where yaw and roll can hardly be told apart

const fixed = (value, digits) => value.toFixed(digits).replace(/^-(0(\.0*)?)$/, "$1");

/** A coloured number, as on the marker. Styles in attributes are refused by the page's policy, so the colour is set here. */
const PointNumber = ({ index }) => html`<b class="number" ref=${e => { if (e) e.style.background = colourOf(index); }}>${index + 1}</b>`;

/** A field for a height in metres; what isn't one is ignored. An answer that arrives meanwhile doesn't replace what is being typed. */
function Height({ value, label, set, id }) {
  const [typed, setTyped] = useState(null);
  const take = e => {
    const z_m = Number(e.target.value);
    if (e.target.value.trim() && z_m >= -20 && z_m <= 50) set(z_m); else e.target.value = String(value);
    setTyped(null);
  };
  return html`<input type="number" class="height" id=${id} step="0.01" min="-20" max="50" value=${typed ?? value} aria-label=${label}
    onInput=${e => setTyped(e.target.value)} onChange=${take} onClick=${e => e.stopPropagation()} />`;
}

export function Points() {
  const { points, half, nextHeight, contradicting, solution, selected, undos } = useModel();
  return html`<section class="panel points" aria-label="Points">
    <div class="row head"><h2>Points</h2><span class="grow"></span>
      <span class="soft small">next at</span>
      <span class="tabs">${HEIGHTS.map(([name, z_m]) => html`<button aria-pressed=${nextHeight === z_m} title="${z_m} m above the floor"
        onClick=${() => model.setNextHeight(z_m)}>${name}</button>`)}</span>
      <${Height} id="next-height" value=${nextHeight} label="Height of the next point above the floor in metres" set=${z => model.setNextHeight(z)} /><span class="small">m</span>
      <button class="small" disabled=${!undos.length} onClick=${() => model.undo()} title="Ctrl+Z">Undo</button></div>
    <div class="scroll"><table id="points"><thead><tr><th></th><th>height [m]</th><th class="n">off [px]</th><th class="n">off [cm]</th><th></th><th></th></tr></thead>
      <tbody>${points.map((point, i) => html`<${Row} point=${point} index=${i} bad=${contradicting.has(i)} selected=${i === selected} off=${solution?.points[i]} />`)}
      ${half && html`<tr class="half"><td><${PointNumber} index=${points.length} /></td>
        <td colspan="4">${half.px ? "now the same place on the plan" : "now the same place in the picture"}</td>
        <td><button class="icon small" aria-label="Cancel this point" onClick=${() => model.remove(points.length)}><${Icon} name="close" size="12" /></button></td></tr>`}</tbody></table></div>
    ${!points.length && !half && html`<p class="soft small">Wheel: zoom. Drag: move the picture, or a point. Arrow keys: move the selected point by a pixel, with Shift by a quarter.
      Delete: remove it. Ctrl+Z: undo. Click in the picture first, then on the plan, or the other way round. For the top of a door, choose “Door top”, click it
      in the picture, and on the plan click the marker of its foot, or the same place.</p>`}
  </section>`;
}

function Row({ point, index, bad, selected, off }) {
  const row = useRef();
  useEffect(() => { if (selected) row.current.scrollIntoView({ block: "nearest" }); }, [selected]);
  return html`<tr ref=${row} class=${`${selected ? "selected" : ""} ${bad ? "bad" : ""}`} data-point=${index + 1} onClick=${() => model.select(index)}>
    <td><${PointNumber} index=${index} /></td>
    <td><${Height} value=${point.z_m} label="Height of point ${index + 1} in metres" set=${z => model.setHeight(index, z)} /></td>
    <td class="n">${off ? off.residual_px === null ? "out of sight" : fixed(off.residual_px, 1) : ""}</td>
    <td class="n">${off?.residual_m != null ? fixed(100 * off.residual_m, 1) : ""}</td>
    <td>${bad && html`<span class="badge bad" title="Left out: check that it is the same place in both pictures, and its height">contradicts the others</span>`}</td>
    <td class="n"><button class="icon small" title="Delete" aria-label="Delete point ${index + 1}" onClick=${e => { e.stopPropagation(); model.remove(index); }}><${Icon} name="close" size="12" /></button></td></tr>`;
}

const Fact = ({ name, value, sigma, unit, digits }) => html`<div><dt>${name}</dt><dd>${fixed(value, digits)}${unit}
  ${sigma > 0 && html`<small class="soft"> ± ${sigma < 10 ** -digits ? `< ${10 ** -digits}` : fixed(sigma, digits)}${unit}</small>`}</dd></div>`;

export function Pose() {
  const { solution: s, problem, state, points, fitHfov } = useModel();
  return html`<section class="panel pose" aria-label="Pose" aria-live="polite">
    <div class="row head"><h2>Where it hangs and looks</h2><span class="grow"></span>${s && html`<${Verdict} s=${s} />`}</div>
    ${s ? html`<${Facts} s=${s} />` : problem && points.length ? html`<p id="problem" class=${points.length < 4 ? "soft" : "bad-text"}>${sentence(problem.message)}</p>`
      : html`<p class="empty">Nothing is known yet.</p>`}
    ${s && html`<p class="small soft">Position ± ${fixed(s.position_sigma_m, 2)} m and direction ± ${fixed(s.angle_sigma_deg, 1)}° in all; searches need 0.05 m and 1°.
      ${s.pitch_deg < STEEP_DEG && " It looks straight down: yaw and roll turn the picture in the same way, so each alone may be uncertain."}</p>`}
    ${s?.warning && html`<p class="small warn-text">${s.warning}</p>`}
    <label><input type="checkbox" id="fit-hfov" checked=${fitHfov} disabled=${state.hfov_deg === null && !fitHfov} onChange=${e => model.setFitHfov(e.target.checked)} />
      Fit the field of view <span class="soft small">${state.hfov_deg === null ? "(the lens is calibrated)" : `(cameras.yaml: ${fixed(state.hfov_deg, 1)}°; six points, some off the floor)`}</span></label>
  </section>`;
}

const sentence = text => `${text[0].toUpperCase()}${text.slice(1)}${/[.!?]$/.test(text) ? "" : "."}`;

function Verdict({ s }) {
  const [kind, text] = s.warning ? ["bad", "too uncertain"] : s.is_good ? ["good", "good"] : ["warn", "usable"];
  return html`<span class="badge ${kind}" id="verdict">${text}</span>`;
}

function Facts({ s }) {
  const [x, y] = s.position_m, [sx, sy, sz] = s.position_sigmas_m, [yaw, pitch, roll] = s.angle_sigmas_deg;
  return html`<dl class="facts" id="pose">
    <${Fact} name="x" value=${x} sigma=${sx} unit=" m" digits=${2} /><${Fact} name="y" value=${y} sigma=${sy} unit=" m" digits=${2} />
    <${Fact} name="height above the floor" value=${s.height_m} sigma=${sz} unit=" m" digits=${2} />
    <${Fact} name="yaw" value=${s.yaw_deg} sigma=${yaw} unit="°" digits=${1} /><${Fact} name="pitch" value=${s.pitch_deg} sigma=${pitch} unit="°" digits=${1} />
    <${Fact} name="roll" value=${s.roll_deg} sigma=${roll} unit="°" digits=${1} />
    ${s.hfov_sigma_deg > 0 && html`<${Fact} name="field of view" value=${s.hfov_deg} sigma=${s.hfov_sigma_deg} unit="°" digits=${1} />`}</dl>`;
}

export function Save() {
  const { solution, solving, points, state } = useModel(), [said, setSaid] = useState(null), [busy, setBusy] = useState(false);
  const save = async (action) => {
    setBusy(true);
    try { setSaid({ kind: "good", text: (await action(model.pairs)).message }); } catch (error) { setSaid({ kind: "bad", text: error.message }); }
    setBusy(false);
  };
  return html`<section class="panel save" aria-label="Save">
    <div class="row head"><h2>Save</h2></div>
    <button class="primary" disabled=${!solution || solving || busy} onClick=${() => save(server.savePose)}>Save into ${basename(state.cameras_file)}</button>
    <p class="soft small">Running cameras follow in seconds.</p>
    <button disabled=${!points.length || busy} onClick=${() => save(server.saveClicks)}>Save the clicks</button>
    <p class="soft small">To ${basename(state.clicks_file)}</p>
    <p id="said" role="status" class=${`small ${said?.kind === "bad" ? "bad-text" : "good-text"}`}>${said?.text}</p>
  </section>`;
}

const basename = path => path.split(/[\\/]/).at(-1);
