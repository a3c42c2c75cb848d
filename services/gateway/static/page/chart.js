// A chart of a few series over the last minutes: SVG, drawn anew with each sample.
import { html } from "./ui.js";

/** "M0 3L1 2..." of values from the left to the right, the newest at the right edge of `span` samples. */
export function line(values, span, top, width, height) {
  const step = width / (span - 1), first = width - step * (values.length - 1);
  return values.map((v, i) => `${i ? "L" : "M"}${(first + i * step).toFixed(1)} ${(height - (top > 0 ? v / top : 0) * height).toFixed(1)}`).join("");
}

/** The largest value, rounded up so that the scale doesn't jump about. */
export function roundTop(values) {
  const most = Math.max(0, ...values);
  if (most <= 0) return 0;
  const power = 10 ** Math.floor(Math.log10(most));
  return [1, 2, 5, 10].map(k => k * power).find(top => top >= most);
}

/** `series`: [{name, values}], named by their class; `label`: for who can't see it; `unit(v)`: the scale in words. */
export function Chart({ series, span = 300, width = 600, height = 120, label, unit }) {
  const top = roundTop(series.flatMap(s => s.values));
  return html`<figure class="chart"><svg viewBox="0 -4 ${width} ${height + 8}" preserveAspectRatio="none" role="img" aria-label=${label}>
      ${unit && [0.25, 0.5, 0.75, 1].map(s => html`<line class="rule" x1="0" x2=${width} y1=${height * (1 - s)} y2=${height * (1 - s)} />`)}
      <line class="base" x1="0" x2=${width} y1=${height} y2=${height} />
      ${series.map(s => html`<path class="series ${s.name}" d=${line(s.values, span, top, width, height)} />`)}
    </svg>${unit && html`<figcaption><span>${unit(top)}</span><span>5 min ago</span><span>now</span></figcaption>`}</figure>`;
}
