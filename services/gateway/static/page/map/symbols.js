// How single things look on the map. `c`: the canvas's context, `view`: from world to screen, `t`: the theme's colours.

export function cameraCone(c, view, camera, outlines, t) {
  const [u, v] = view.to(...camera.position_m);
  const reach = 4 * view.scale, glow = c.createRadialGradient(u, v, 0, u, v, reach);
  const tint = camera.stale ? t.stale : camera.invoked ? t.camera : t.quiet;
  glow.addColorStop(0, withAlpha(tint, camera.invoked && !camera.stale ? t.coneAlpha : t.coneAlpha / 3));
  glow.addColorStop(1, withAlpha(tint, 0));
  c.fillStyle = glow;
  c.beginPath();
  for (const outline of outlines) outline.forEach(([x, y], i) => { const p = view.to(x, y); i ? c.lineTo(...p) : c.moveTo(...p); });
  c.fill("nonzero");
}

export function cameraMark(c, view, camera, t, chosen) {
  const [u, v] = view.to(...camera.position_m), r = 7;
  c.lineWidth = 2;
  c.strokeStyle = t.paper;
  c.fillStyle = camera.stale ? t.stale : camera.invoked ? t.camera : t.quiet;
  c.beginPath();
  c.roundRect(u - r, v - r, 2 * r, 2 * r, 4);
  c.fill();
  c.stroke();
  c.fillStyle = t.paper;
  c.beginPath();
  c.arc(u, v, 2.6, 0, 7);
  c.fill();
  if (camera.invoked && !camera.stale) ring(c, u, v, r + 4, camera.views_processed / camera.views.length, t.camera);
  if (chosen) ring(c, u, v, r + 8, 1, t.accent);
  label(c, camera.id + (camera.stale ? " (gone)" : camera.paused ? " (paused)" : ""), u + r + 5, v - r - 2, t, t.soft);
}

/** How much of something is done. */
function ring(c, u, v, r, share, colour) {
  c.strokeStyle = colour;
  c.lineWidth = 2.5;
  c.beginPath();
  c.arc(u, v, r, -Math.PI / 2, -Math.PI / 2 + 2 * Math.PI * Math.min(1, share));
  c.stroke();
}

/** Where a camera's symbol and name are: no other name goes there. */
export const cameraBox = (view, camera) => { const [u, v] = view.to(...camera.position_m); return [u - 10, v - 20, u + 44, v + 10]; };

export function robotMark(c, view, robot, pose, t) {
  const [u, v] = view.to(pose.x, pose.y), r = Math.max(9, 0.17 * view.scale);
  c.save();
  c.translate(u, v);
  c.fillStyle = withAlpha(t.robot, robot.stale ? 0 : 0.18);
  c.beginPath(); c.arc(0, 0, r * 1.9, 0, 7); c.fill();
  c.rotate(-pose.yaw);
  c.fillStyle = robot.stale ? t.stale : robot.state === "halted" ? t.bad : t.robot;
  c.strokeStyle = t.paper;
  c.lineWidth = 2;
  c.beginPath();
  c.moveTo(r * 1.35, 0); c.lineTo(-r * 0.9, r); c.lineTo(-r * 0.45, 0); c.lineTo(-r * 0.9, -r); c.closePath();
  c.fill(); c.stroke();
  c.restore();
  label(c, robot.id + (robot.stale ? " (silent)" : robot.state === "halted" ? " (stopped)" : ""), u + r * 1.5, v - r * 1.3, t, t.ink, 600);
}

export function objectMark(c, view, object, t, { wanted, chosen }) {
  const [u, v] = view.to(object.center_m[0], object.center_m[1]), sure = object.status === "confirmed";
  const r = wanted ? (sure ? 7 : 3.5 + 4 * (object.confidence ?? 0)) : sure ? 5 : 3.5;
  if (object.position_sigma_m) { // it is within two standard deviations of there
    c.beginPath();
    c.arc(u, v, 2 * object.position_sigma_m * view.scale, 0, 7);
    c.fillStyle = withAlpha(wanted ? t.target : t.object, 0.12);
    c.fill();
  }
  c.beginPath();
  c.arc(u, v, r, 0, 7);
  c.lineWidth = 1.8;
  c.fillStyle = sure ? (wanted ? t.target : t.object) : t.paper;
  c.strokeStyle = sure ? t.paper : wanted ? t.target : t.object;
  c.globalAlpha = sure || wanted ? 1 : 0.45 + 0.5 * (object.confidence ?? 0);
  c.fill(); c.stroke();
  c.globalAlpha = 1;
  if (wanted || chosen) ring(c, u, v, r + 4, 1, chosen ? t.accent : t.target);
}

export function trail(c, view, points, t) {
  if (points.length < 2) return;
  c.lineJoin = c.lineCap = "round";
  c.lineWidth = Math.max(2.5, 0.05 * view.scale);
  const chunks = 12, size = Math.ceil(points.length / chunks);
  for (let i = 0; i < points.length - 1; i += size) {
    c.strokeStyle = withAlpha(t.robot, 0.15 + 0.6 * (i / points.length));
    c.beginPath();
    points.slice(i, i + size + 1).forEach((p, k) => { const q = view.to(p.x, p.y); k ? c.lineTo(...q) : c.moveTo(...q); });
    c.stroke();
  }
}

export function planPath(c, view, points, t) {
  c.setLineDash([7, 6]);
  c.lineWidth = 2.5;
  c.strokeStyle = t.plan;
  c.beginPath();
  points.filter(p => p[0] != null && p[1] != null).forEach(([x, y], i) => { const q = view.to(x, y); i ? c.lineTo(...q) : c.moveTo(...q); });
  c.stroke();
  c.setLineDash([]);
}

export function waypoint(c, view, place, t) {
  if (place?.x_m == null || place.y_m == null) return;
  const [u, v] = view.to(place.x_m, place.y_m);
  c.fillStyle = t.plan;
  c.strokeStyle = t.paper;
  c.lineWidth = 2;
  c.beginPath();
  c.moveTo(u, v);
  c.bezierCurveTo(u - 3, v - 7, u - 9, v - 10, u - 9, v - 17);
  c.arc(u, v - 17, 9, Math.PI, 0);
  c.bezierCurveTo(u + 9, v - 10, u + 3, v - 7, u, v);
  c.fill(); c.stroke();
  c.fillStyle = t.paper;
  c.beginPath(); c.arc(u, v - 17, 3.4, 0, 7); c.fill();
}

export function candidateMark(c, view, place, t) {
  if (place.x_m == null || place.y_m == null || place.chosen) return;
  const [u, v] = view.to(place.x_m, place.y_m), r = 4.5;
  c.fillStyle = t.paper;
  c.strokeStyle = t.plan;
  c.lineWidth = 1.6;
  c.beginPath();
  c.moveTo(u, v - r); c.lineTo(u + r, v); c.lineTo(u, v + r); c.lineTo(u - r, v); c.closePath();
  c.fill(); c.stroke();
}

export function pointer(c, view, point, t) {
  const [u, v] = view.to(point.x, point.y);
  for (const r of [10, 16]) { c.strokeStyle = withAlpha(t.accent, r === 10 ? 1 : 0.4); c.lineWidth = 2.5; c.beginPath(); c.arc(u, v, r, 0, 7); c.stroke(); }
}

/** Text with a halo, so that it can be read on anything. */
export function label(c, text, u, v, t, ink = t.ink, weight = 500) {
  c.font = `${weight} 12px ${t.font}`;
  c.lineJoin = "round";
  c.lineWidth = 3.5;
  c.strokeStyle = t.paper;
  c.strokeText(text, u, v);
  c.fillStyle = ink;
  c.fillText(text, u, v);
}

/** A colour of the style sheet (#rrggbb) that lets through. */
export const withAlpha = (hex, alpha) => `${hex}${Math.round(255 * alpha).toString(16).padStart(2, "0")}`;
