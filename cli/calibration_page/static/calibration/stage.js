// A picture on a canvas: the wheel zooms, dragging moves it or a marker, a click sets a point, a magnifier shows the pixel.
//
// Pixel (0, 0) of the picture is the centre of the top left one, so its edge is at -0.5.

const MOST = 40; // screen pixels for a pixel of the picture
const REACH = 12; // screen pixels from a marker's centre at which it is picked up
const STILL = 4; // movement in screen pixels up to which it is a click
const LENS = 150, LENS_PIXELS = 25; // the magnifier's size on the screen, and how many pixels of the picture it shows
const LENS_UNTIL = 4; // the scale from which nobody needs it

export class Stage {
  /** `owner`: `draw(context, stage)`, `markers()`: [{index, at}], `click(at)`, `pick(index)`, `grab()`, `move(index, at)`. */
  constructor(canvas, owner) {
    Object.assign(this, { canvas, owner, image: null, scale: 1, x: 0, y: 0, own: false, hover: null, drag: null });
    this.context = canvas.getContext("2d");
    const heard = {
      pointerdown: e => this.down(e), pointermove: e => this.moved(e), pointerup: e => this.up(e),
      pointercancel: () => { this.drag = null; }, pointerleave: () => { this.hover = null; this.draw(); },
    };
    for (const [name, take] of Object.entries(heard)) canvas.addEventListener(name, take);
    canvas.addEventListener("wheel", e => this.wheel(e), { passive: false });
    new ResizeObserver(() => this.resize()).observe(canvas);
  }

  show(image, width, height) {
    const same = this.width === width && this.height === height;
    Object.assign(this, { image, width, height });
    if (same) this.draw(); else this.fit();
  }

  /** Picture to screen, and back. */
  to([u, v]) { return [(u + 0.5) * this.scale + this.x, (v + 0.5) * this.scale + this.y]; }
  from([x, y]) { return [(x - this.x) / this.scale - 0.5, (y - this.y) / this.scale - 0.5]; }
  inside([u, v]) { return u >= -0.5 && v >= -0.5 && u <= this.width - 0.5 && v <= this.height - 0.5; }

  resize() {
    const ratio = devicePixelRatio || 1, { clientWidth, clientHeight } = this.canvas;
    Object.assign(this.canvas, { width: Math.round(clientWidth * ratio), height: Math.round(clientHeight * ratio) });
    if (this.own) this.draw(); else this.fit();
  }

  fit() {
    const { clientWidth: w, clientHeight: h } = this.canvas;
    if (!this.image || !w || !h) return;
    this.least = Math.min(w / this.width, h / this.height);
    this.scale = this.least;
    this.x = (w - this.width * this.scale) / 2;
    this.y = (h - this.height * this.scale) / 2;
    this.own = false;
    this.draw();
  }

  zoom(factor, at = [this.canvas.clientWidth / 2, this.canvas.clientHeight / 2]) {
    const before = this.from(at);
    this.own = true;
    this.scale = Math.min(MOST, Math.max(this.least / 2, this.scale * factor));
    this.x = at[0] - (before[0] + 0.5) * this.scale;
    this.y = at[1] - (before[1] + 0.5) * this.scale;
    this.draw();
  }

  /** Moves the picture so that a place can be seen. */
  reveal(at) {
    const [x, y] = this.to(at), { clientWidth: w, clientHeight: h } = this.canvas;
    if (x > 0 && y > 0 && x < w && y < h) return;
    this.own = true;
    this.x += w / 2 - x;
    this.y += h / 2 - y;
    this.draw();
  }

  screen(e) { const r = this.canvas.getBoundingClientRect(); return [e.clientX - r.left, e.clientY - r.top]; }

  nearest([x, y]) {
    let best = null, least = REACH;
    for (const marker of this.owner.markers()) {
      const [mx, my] = this.to(marker.at), distance = Math.hypot(mx - x, my - y);
      if (distance <= least) { best = marker; least = distance; }
    }
    return best;
  }

  down(e) {
    if (e.button !== 0 && e.button !== 1) return;
    this.canvas.setPointerCapture(e.pointerId);
    const from = this.screen(e), marker = e.button === 0 ? this.nearest(from) : null;
    this.drag = { from, last: from, marker, offset: marker && this.to(marker.at).map((c, i) => c - from[i]), going: false, click: e.button === 0 };
  }

  moved(e) {
    const now = this.screen(e), { drag } = this;
    this.hover = now;
    if (!drag) { this.canvas.classList.toggle("on-marker", Boolean(this.nearest(now))); return this.draw(); }
    if (!drag.going && Math.hypot(now[0] - drag.from[0], now[1] - drag.from[1]) < STILL) return undefined;
    if (!drag.going && drag.marker) this.owner.grab(drag.marker.index);
    drag.going = true;
    if (drag.marker) {
      this.owner.move(drag.marker.index, this.clamped(this.from(now.map((c, i) => c + drag.offset[i]))));
    } else {
      this.own = true;
      this.x += now[0] - drag.last[0];
      this.y += now[1] - drag.last[1];
    }
    drag.last = now;
    return this.draw();
  }

  up(e) {
    const { drag } = this;
    this.drag = null;
    if (!drag || drag.going || !drag.click || !this.image) return this.draw();
    if (drag.marker) return this.owner.pick(drag.marker.index, drag.marker.at);
    const at = this.from(this.screen(e));
    return this.inside(at) && this.owner.click(at);
  }

  clamped([u, v]) { return [Math.min(this.width - 0.5, Math.max(-0.5, u)), Math.min(this.height - 0.5, Math.max(-0.5, v))]; }

  wheel(e) {
    e.preventDefault();
    if (this.image) this.zoom(Math.exp(-e.deltaY * (e.deltaMode ? 0.05 : 0.0015)), this.screen(e));
  }

  draw() {
    const { context: c, canvas, scale } = this, ratio = canvas.width / (canvas.clientWidth || 1);
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
    if (!this.image) return;
    c.imageSmoothingEnabled = scale * ratio < 3;
    c.imageSmoothingQuality = "high";
    c.fillStyle = "#fff"; // where a plan is transparent
    c.fillRect(this.x, this.y, this.width * scale, this.height * scale);
    c.drawImage(this.image, this.x, this.y, this.width * scale, this.height * scale);
    this.owner.draw(c, this);
    this.magnify(c);
  }

  /** Lines (n, 2) of the picture as one path of the screen. */
  path(lines, closed = false) {
    const path = new Path2D();
    for (const line of lines) {
      line.forEach((at, i) => path[i ? "lineTo" : "moveTo"](...this.to(at)));
      if (closed) path.closePath();
    }
    return path;
  }

  magnify(c) {
    const { drag } = this, over = drag?.marker && drag.going ? drag.last.map((v, i) => v + drag.offset[i]) : this.hover;
    if (!over || (drag && !drag.marker) || this.scale >= LENS_UNTIL || !this.inside(this.from(over))) return;
    const w = this.canvas.clientWidth, pixel = LENS / LENS_PIXELS, [u, v] = this.from(over);
    const left = over[0] > w / 2 ? 8 : w - LENS - 8, top = 8;
    c.save();
    const frame = new Path2D();
    frame.roundRect(left, top, LENS, LENS, 8);
    c.clip(frame);
    c.fillStyle = "#777";
    c.fillRect(left, top, LENS, LENS);
    c.imageSmoothingEnabled = false;
    c.drawImage(this.image, left + LENS / 2 - (u + 0.5) * pixel, top + LENS / 2 - (v + 0.5) * pixel, this.width * pixel, this.height * pixel);
    for (const [colour, width] of [["#000", 3], ["#fff", 1]]) {
      c.strokeStyle = colour;
      c.lineWidth = width;
      c.beginPath();
      for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
        c.moveTo(left + LENS / 2 + dx * 6, top + LENS / 2 + dy * 6);
        c.lineTo(left + LENS / 2 + dx * 40, top + LENS / 2 + dy * 40);
      }
      c.stroke();
    }
    c.restore();
    c.strokeStyle = "#fff";
    c.lineWidth = 3;
    c.stroke(frame);
    c.strokeStyle = "#17202b";
    c.lineWidth = 1;
    c.stroke(frame);
  }
}
