// Points as they are drawn: numbered, each in its colour, with the middle left free so that one sees the pixel.

const COLOURS = ["#1f77d0", "#e8820c", "#2ba84a", "#a855f7", "#0fa3a3", "#d4a800", "#e0559f", "#7a5230", "#6b8e23", "#5566dd"];
const BAD = "#e11d1d";

export const colourOf = index => COLOURS[index % COLOURS.length];

/** Draws a marker at a place of the screen. `left`: whether its number stands there. */
export function drawMarker(c, [x, y], index, { selected, bad, left }) {
  const colour = colourOf(index), radius = selected ? 9 : 6.5;
  for (const [stroke, width] of [["#fff", 4], [colour, 2]]) {
    c.strokeStyle = stroke;
    c.lineWidth = width;
    c.beginPath();
    c.arc(x, y, radius, 0, 2 * Math.PI);
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      c.moveTo(x + dx * radius, y + dy * radius);
      c.lineTo(x + dx * 2.5, y + dy * 2.5);
    }
    c.stroke();
  }
  if (bad) {
    c.strokeStyle = BAD;
    c.lineWidth = 3;
    c.setLineDash([5, 3]);
    c.beginPath();
    c.arc(x, y, radius + 5, 0, 2 * Math.PI);
    c.stroke();
    c.setLineDash([]);
  }
  label(c, x + (left ? -1 : 1) * (radius + 3), y - radius - 3, left, `${index + 1}${bad ? " !" : ""}`, bad ? BAD : colour);
}

/** A line from where the pose puts a point to where it was clicked. */
export function drawResidual(c, from, to, bad) {
  for (const [stroke, width] of [["#fff", 4], [bad ? BAD : "#17703a", 2]]) {
    c.strokeStyle = stroke;
    c.lineWidth = width;
    c.beginPath();
    c.moveTo(...from);
    c.lineTo(...to);
    c.stroke();
  }
}

function label(c, edge, y, left, text, colour) {
  c.font = "600 11px system-ui, sans-serif";
  const width = c.measureText(text).width + 8, x = left ? edge - width : edge;
  c.fillStyle = colour;
  c.strokeStyle = "#fff";
  c.lineWidth = 1.5;
  c.beginPath();
  c.roundRect(x, y - 11, width, 15, 7);
  c.fill();
  c.stroke();
  c.fillStyle = "#fff";
  c.textBaseline = "middle";
  c.fillText(text, x + 4, y - 3);
}
