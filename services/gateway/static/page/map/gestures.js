// Mouse, touch and keys on the map: drag, wheel, pinch, arrows, + and -, 0.

const STEP_PX = 60;

/** Listens on a canvas. `changed`: the view moved; `click(u, v)`, `hover(u, v)`: pixels; `fit()`: show everything. */
export function gestures(canvas, view, { changed, click, hover, fit }) {
  const pointers = new Map();
  let moved = 0, spread = 0;
  const at = e => { const r = canvas.getBoundingClientRect(); return [e.clientX - r.left, e.clientY - r.top]; };

  function down(e) {
    canvas.setPointerCapture(e.pointerId);
    pointers.set(e.pointerId, at(e));
    moved = 0;
    spread = spreadOf(pointers);
  }
  function move(e) {
    const now = at(e), before = pointers.get(e.pointerId);
    if (!before) return hover(...now);
    pointers.set(e.pointerId, now);
    moved += Math.abs(now[0] - before[0]) + Math.abs(now[1] - before[1]);
    if (moved < 4) return;
    if (pointers.size === 2) pinch(); else view.pan(now[0] - before[0], now[1] - before[1]);
    changed();
  }
  function pinch() {
    const [a, b] = [...pointers.values()], next = spreadOf(pointers);
    if (spread > 0) view.zoom(next / spread, (a[0] + b[0]) / 2, (a[1] + b[1]) / 2);
    spread = next;
  }
  function up(e) {
    if (pointers.delete(e.pointerId) && moved < 4 && e.type === "pointerup") click(...at(e));
  }
  function wheel(e) {
    e.preventDefault();
    view.zoom(Math.exp(-e.deltaY * (e.deltaMode ? 0.05 : 0.0015)), ...at(e));
    changed();
  }
  function key(e) {
    const act = {
      ArrowLeft: () => view.pan(STEP_PX, 0), ArrowRight: () => view.pan(-STEP_PX, 0), ArrowUp: () => view.pan(0, STEP_PX),
      ArrowDown: () => view.pan(0, -STEP_PX), "+": () => view.zoom(1.25), "=": () => view.zoom(1.25), "-": () => view.zoom(0.8), 0: fit,
    }[e.key];
    if (!act || e.ctrlKey || e.metaKey || e.altKey) return;
    e.preventDefault();
    act();
    changed();
  }

  const heard = { pointerdown: down, pointermove: move, pointerup: up, pointercancel: up, pointerleave: () => hover(null), keydown: key };
  for (const [name, take] of Object.entries(heard)) canvas.addEventListener(name, take);
  canvas.addEventListener("wheel", wheel, { passive: false });
  return () => {
    for (const [name, take] of Object.entries(heard)) canvas.removeEventListener(name, take);
    canvas.removeEventListener("wheel", wheel);
  };
}

function spreadOf(pointers) {
  const [a, b] = [...pointers.values()];
  return b ? Math.hypot(a[0] - b[0], a[1] - b[1]) : 0;
}
