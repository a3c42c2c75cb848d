// A camera that goes round a place: angles, distance, and the matrix from the world to the screen.

const LEAST_M = 1, MOST_M = 400, FIELD = 0.9; // radians, upright

export class Orbit {
  constructor() { Object.assign(this, { x: 0, y: 0, z: 0.8, azimuth: -Math.PI / 2, height: 0.95, distance: 15, width: 1, heightPx: 1, own: false }); }

  resize(width, height) { this.width = width; this.heightPx = height; }

  turn(du, dv) {
    this.own = true;
    this.azimuth -= 0.006 * du;
    this.height = Math.min(1.55, Math.max(0.05, this.height + 0.006 * dv));
  }

  pan(du, dv) { // like the map's: what is grabbed stays under the pointer, more or less
    this.own = true;
    const s = this.distance * Math.tan(FIELD / 2) * 2 / this.heightPx, [c, d] = [Math.cos(this.azimuth), Math.sin(this.azimuth)];
    this.x += s * (du * d - dv * c * 1);
    this.y -= s * (du * c + dv * d * 1);
  }

  zoom(factor) { this.own = true; this.distance = Math.min(MOST_M, Math.max(LEAST_M, this.distance / factor)); }

  /** Shows a box [x0, y0, x1, y1] of the floor whole. */
  fit([x0, y0, x1, y1]) {
    this.x = (x0 + x1) / 2;
    this.y = (y0 + y1) / 2;
    this.distance = Math.max(4, Math.max((x1 - x0) * this.heightPx / this.width, (y1 - y0) * 0.85) / (2 * Math.tan(FIELD / 2)) * 1.3);
    this.own = false;
  }

  get eye() {
    const level = Math.cos(this.height) * this.distance;
    return [this.x + level * Math.cos(this.azimuth), this.y + level * Math.sin(this.azimuth), this.z + Math.sin(this.height) * this.distance];
  }

  /** 16 numbers, column by column: from the world to clip space. */
  matrix() {
    const eye = this.eye, f = unit([this.x - eye[0], this.y - eye[1], this.z - eye[2]]), s = unit(cross(f, [0, 0, 1])), u = cross(s, f);
    const t = 1 / Math.tan(FIELD / 2), a = t * this.heightPx / this.width, near = 0.1, far = this.distance + 500;
    const zz = (far + near) / (near - far), zw = 2 * far * near / (near - far);
    const rows = [s.map(v => v * a), u.map(v => v * t), f.map(v => -v * zz), f];
    const at = [-dot(s, eye) * a, -dot(u, eye) * t, dot(f, eye) * zz + zw, -dot(f, eye)];
    return new Float32Array([0, 1, 2].flatMap(k => rows.map(r => r[k])).concat(at));
  }

  /** The pixel of a place, or null if it lies behind. */
  to([x, y, z], m = this.matrix()) {
    const at = k => m[k] * x + m[4 + k] * y + m[8 + k] * z + m[12 + k], w = at(3);
    return w <= 0.05 ? null : [(at(0) / w + 1) / 2 * this.width, (1 - at(1) / w) / 2 * this.heightPx];
  }
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
function unit(a) { const n = Math.hypot(...a) || 1; return a.map(v => v / n); }
