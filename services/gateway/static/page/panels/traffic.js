// What the cameras and robots cost: offered, delivered, on the wire; per second and in all.
import { Chart } from "../chart.js";
import { bytes } from "../format.js";
import { NUMBERS, ratesOf } from "../rates.js";
import { entries, one, useStore } from "../store.js";
import { html, useEffect, useState } from "../ui.js";

const NAMES = { offered_bytes: "offered", delivered_bytes: "delivered", wire_sent_bytes: "on the wire" };
const CLASSES = { offered_bytes: "offered", delivered_bytes: "delivered", wire_sent_bytes: "wire" };
const LINKS = [["camera_bytes", "cameras"], ["robot_bytes", "robots"], ["server_bytes", "servers"]];
const FIRST = 12;
const perSecond = v => `${bytes(v)}/s`;
const seriesOf = id => NUMBERS.map(n => ({ name: CLASSES[n], values: ratesOf(id).map(p => p[n]) }));

/** The mean of the last seconds: a picture a second would flicker. */
function recent(id, number, seconds = 5) {
  const points = ratesOf(id).slice(-seconds);
  return points.reduce((sum, p) => sum + p[number], 0) / Math.max(points.length, 1);
}

export function TrafficPanel() {
  useStore();
  const [, tick] = useState(0), [source, setSource] = useState("total");
  useEffect(() => { const timer = setInterval(() => tick(n => n + 1), 1000); return () => clearInterval(timer); }, []);
  const total = one("traffic", "total"), rows = entries("traffic").filter(([id]) => id !== "total").sort(([a], [b]) => a.localeCompare(b, undefined, { numeric: true }));
  const shown = source === "total" || one("traffic", source) ? source : "total";
  return html`<section class="panel traffic" id="traffic" aria-labelledby="traffic-title">
    <div class="row head"><h2 id="traffic-title">Traffic</h2><span class="soft small">${shown === "total" ? "everything" : shown}</span><span class="grow"></span>
      <div class="key">${NUMBERS.map(n => html`<span><i class="dash ${CLASSES[n]}" aria-hidden="true"></i>${NAMES[n]} <b>${perSecond(recent(shown, n))}</b></span>`)}</div></div>
    <${Chart} series=${seriesOf(shown)} label="Bytes a second of ${shown} in the last five minutes" unit=${top => top ? perSecond(top) : ""} />
    ${total?.links && html`<p class="soft small links">offered on links: ${LINKS.map(([n, name], i) => html`${i ? ", " : ""}${name} <b>${bytes(total.links[n])}</b>`)}</p>`}
    ${total ? html`<div class="scroll"><table class="traffic"><thead><tr><th scope="col">source</th><th scope="col" class="spark">last 5 min</th>${NUMBERS.map(n => html`<th scope="col" class="n">${NAMES[n]}</th>`)}<th scope="col" class="n">for viewers</th></tr></thead>
      <tbody><${Row} id="total" sums=${total} chosen=${shown} choose=${setSource} />${rows.slice(0, FIRST).map(([id, sums]) => html`<${Row} key=${id} id=${id} sums=${sums} chosen=${shown} choose=${setSource} />`)}</tbody></table></div>`
      : html`<p class="empty">No node has told what it sent yet.</p>`}
    ${rows.length > FIRST && html`<p class="soft small">and ${rows.length - FIRST} more, by <a href="docs">REST</a> and for Prometheus</p>`}
  </section>`;
}

function Row({ id, sums, chosen, choose }) {
  return html`<tr class=${sums.stale ? "stale" : ""}><td><button class="quiet" aria-pressed=${chosen === id} onClick=${() => choose(id)}>${id === "total" ? "everything" : id.split("/")[1]}</button></td>
    <td class="spark"><${Chart} series=${seriesOf(id)} width=${120} height=${22} label="Bytes a second of ${id}" /></td>
    ${NUMBERS.map(n => html`<td class="n">${bytes(sums[n])}</td>`)}<td class="n">${sums.viewer_bytes == null ? "" : bytes(sums.viewer_bytes)}</td></tr>`;
}
