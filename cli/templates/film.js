"use strict";
// The film strip of a report: shows the frame at which the scrubber stands. What it reads is made by cli/report/film.py.
(() => {
  const $ = (id) => document.getElementById(id);
  const { target, floors, frames, beliefs } = JSON.parse($("film-data").textContent);
  const KINDS = {
    target: "the confirmed target", candidate: "what may be the target", frontier: "an edge of what is known",
    stairs: "stairs", second_look: "a second look",
  };
  const SHADES = [[0, 0, 0, 0], [219, 231, 240, 255], [57, 66, 78, 255]];
  const scrubber = $("film-at"), canvas = $("film-map").querySelector("canvas"), svg = $("film-map").querySelector("svg");
  const film = { at: -1, shown: {}, timer: 0 };

  // --- the map: runs of changed cells, as cli/report/cell_changes.py writes them ---

  function change(cells, runs) {
    const bytes = Uint8Array.from(atob(runs), (c) => c.charCodeAt(0));
    let i = 0, at = 0;
    const number = () => {
      let n = 0, shift = 0;
      for (;;) {
        const byte = bytes[i++];
        n += (byte & 127) * 2 ** shift;
        shift += 7;
        if (byte < 128) return n;
      }
    };
    while (i < bytes.length) {
      at += number();
      const run = number(), length = Math.floor(run / 4);
      cells.fill(run % 4, at, at + length);
      at += length;
    }
  }

  function cellsAt(floor, k) {
    let known = film.shown[floor];
    if (!known || known.at > k) {
      known = film.shown[floor] = { at: -1, cells: new Uint8Array(floors[floor].rows * floors[floor].cols) };
    }
    for (let j = known.at + 1; j <= k; j++) {
      if (frames[j].m && frames[j].m[floor]) change(known.cells, frames[j].m[floor]);
    }
    known.at = k;
    return known.cells;
  }

  function drawCells(floor, cells) {
    const { rows, cols } = floors[floor];
    canvas.width = cols;
    canvas.height = rows;
    const picture = new ImageData(cols, rows);
    for (let row = 0; row < rows; row++) {
      for (let col = 0; col < cols; col++) {
        picture.data.set(SHADES[cells[row * cols + col]], 4 * ((rows - 1 - row) * cols + col));
      }
    }
    canvas.getContext("2d", { willReadFrequently: true }).putImageData(picture, 0, 0);
  }

  // --- what lies on the map, in units of cells ---

  function add(name, attributes, title) {
    const node = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    if (title) {
      const text = document.createElementNS("http://www.w3.org/2000/svg", "title");
      text.textContent = title;
      node.append(text);
    }
    svg.append(node);
  }

  function drawMarks(k, plan) {
    const frame = frames[k], { x, y, r, rows, cols, cameras } = floors[frame.f], unit = Math.max(rows, cols) / 100;
    const at = (px, py) => [(px - x) / r, rows - (py - y) / r];
    svg.setAttribute("viewBox", `0 0 ${cols} ${rows}`);
    svg.replaceChildren();
    for (const [name, cx, cy, used] of cameras) {
      const [u, v] = at(cx, cy);
      add("circle", { cx: u, cy: v, r: 1.1 * unit, fill: used ? "#6741d9" : "#868e96", stroke: "#fff", "stroke-width": unit / 3 }, `camera ${name}`);
    }
    const way = frames.slice(0, k + 1).filter((f) => f.f === frame.f).map((f) => at(f.x, f.y).map((c) => c.toFixed(1)).join(","));
    add("polyline", { points: way.join(" "), fill: "none", stroke: "#d6336c", "stroke-width": 0.8 * unit, "stroke-linejoin": "round" });
    if (plan) {
      const ahead = [];
      for (let i = 0; i + 1 < plan.p.length; i += 2) ahead.push(at(plan.p[i], plan.p[i + 1]).join(","));
      add("polyline", { points: ahead.join(" "), fill: "none", stroke: "#d6336c", "stroke-width": 0.5 * unit, "stroke-dasharray": `${unit} ${unit}` });
      for (const [kind, cx, cy, score, note, chosen] of plan.c) {
        if (chosen) continue;
        const [u, v] = at(cx, cy);
        add("circle", { cx: u, cy: v, r: 0.9 * unit, fill: "#f08c00", stroke: "#fff", "stroke-width": unit / 3 }, `${KINDS[kind] || kind}, ${score}: ${note}`);
      }
      if (plan.w) {
        const [u, v] = at(plan.w[1], plan.w[2]);
        add("circle", { cx: u, cy: v, r: 1.8 * unit, fill: "none", stroke: "#12805c", "stroke-width": 0.8 * unit }, `chosen: ${KINDS[plan.w[0]] || plan.w[0]}`);
      }
    }
    const [u, v] = at(frame.x, frame.y), degrees = (-frame.a * 180) / Math.PI;
    add("path", { d: "M3 0L-2 2L-1 0L-2 -2Z", fill: "#d6336c", stroke: "#fff", "stroke-width": 0.4, transform: `translate(${u} ${v}) rotate(${degrees}) scale(${unit})` });
  }

  // --- words ---

  const clock = (s) => `${Math.floor(s / 60)}:${String(Math.floor(s % 60)).padStart(2, "0")}`;

  function list(node, lines, none) {
    node.replaceChildren(...(lines.length ? lines : [[none, "soft"]]).map(([text, style]) => {
      const item = document.createElement("li");
      item.textContent = text;
      if (style) item.className = style;
      return item;
    }));
  }

  // The newest plan of a frame or of one before it.
  const planAt = (k) => {
    while (k > 0 && !frames[k].p) k--;
    return frames[k].p;
  };

  function believedAt(k) {
    const known = new Map();
    for (const b of beliefs) if (b[0] <= k) known.set(b[1], b);
    const first = (b) => 2 * (b[2] === target) + (b[4] === "confirmed");
    return [...known.values()].sort((a, b) => first(b) - first(a) || b[3] - a[3]).slice(0, 6);
  }

  function say(k, plan) {
    const frame = frames[k], step = `${frame.n} of ${frames[frames.length - 1].n}`;
    const why = plan ? plan.why || "no reason was told" : "Nothing was decided yet.";
    const toward = plan && plan.w ? ` It heads for ${KINDS[plan.w[0]] || plan.w[0]}${plan.w[4] ? `: ${plan.w[4]}` : ""}.` : "";
    $("film-when").textContent = `${step}, ${clock(frame.t)}, ${frame.d.toFixed(1)} m`;
    $("film-why").textContent = why.charAt(0).toUpperCase() + why.slice(1) + (/[.!?]$/.test(why) ? "" : ".") + toward;
    scrubber.setAttribute("aria-valuetext", `step ${step}, ${clock(frame.t)}: ${why}`);
    $("film-map").setAttribute("aria-label", `The map at step ${step}: the robot is at ${frame.x} m east, ${frame.y} m north on floor ${frame.f}.${toward}`);
    list($("film-weighed"), (plan ? plan.c : []).map(([kind, x, y, score, note, chosen]) =>
      [`${chosen ? "chosen: " : ""}${KINDS[kind] || kind} at (${x}, ${y}), worth ${score}${note ? ` – ${note}` : ""}`, chosen ? "chosen" : ""]),
    "Nothing: there was no choice to make.");
    list($("film-believed"), believedAt(k).map(([, id, label, score, status, sources]) =>
      [`#${id}: ${status} as ${label}, at best ${score.toFixed(2)}, seen by ${sources}`, label === target ? status : ""]),
    "Nothing so far.");
  }

  function show(k) {
    if (k === film.at) return;
    film.at = k;
    scrubber.value = k;
    const frame = frames[k], plan = planAt(k), view = $("film-view");
    let seen = k;
    while (seen > 0 && !frames[seen].v) seen--;
    view.hidden = !frames[seen].v;
    if (frames[seen].v) view.src = `data:image/webp;base64,${frames[seen].v}`;
    view.alt = `What the robot saw at step ${frames[seen].n}`;
    $("film-map").hidden = !floors[frame.f];
    if (floors[frame.f]) {
      drawCells(frame.f, cellsAt(frame.f, k));
      drawMarks(k, plan);
    }
    say(k, plan);
    for (const chapter of document.querySelectorAll(".chapters button")) {
      chapter.setAttribute("aria-current", String(Number(chapter.dataset.frame) === k));
    }
  }

  // --- hands ---

  function stop() {
    clearInterval(film.timer);
    film.timer = 0;
    $("film-play").textContent = "Play";
  }

  function play() {
    if (film.at === frames.length - 1) show(0);
    $("film-play").textContent = "Pause";
    film.timer = setInterval(() => (film.at < frames.length - 1 ? show(film.at + 1) : stop()), 200);
  }

  scrubber.max = frames.length - 1;
  scrubber.addEventListener("input", () => {
    stop();
    show(Number(scrubber.value));
  });
  $("film-play").addEventListener("click", () => (film.timer ? stop() : play()));
  for (const chapter of document.querySelectorAll(".chapters button")) {
    chapter.addEventListener("click", () => {
      stop();
      show(Number(chapter.dataset.frame));
    });
  }
  document.documentElement.classList.add("film");
  $("film").hidden = false;
  show(frames.length - 1);
})();
