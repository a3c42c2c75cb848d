// Numbers and times as people read them.

export const metres = v => v == null ? "–" : `${v.toFixed(1)} m`;
export const percent = v => v == null ? "–" : `${Math.round(100 * v)} %`;
export const shortId = id => id.length > 10 ? `${id.slice(0, 8)}…` : id;

/** Bytes with three digits: 1.23 MB. */
export function bytes(n) {
  if (n == null) return "–";
  for (const unit of ["B", "kB", "MB", "GB"]) {
    if (n < 1000 || unit === "GB") return `${unit === "B" || n >= 100 ? n.toFixed(0) : n >= 10 ? n.toFixed(1) : n.toFixed(2)} ${unit}`;
    n /= 1000;
  }
}

/** A span of time: 8 s, 3 min 05 s, 2 h 10 min. */
export function duration(seconds) {
  if (seconds == null || !isFinite(seconds)) return "–";
  const s = Math.max(0, Math.round(seconds));
  if (s < 60) return `${s} s`;
  if (s < 3600) return `${Math.floor(s / 60)} min ${String(s % 60).padStart(2, "0")} s`;
  if (s < 86400) return `${Math.floor(s / 3600)} h ${String(Math.floor(s / 60) % 60).padStart(2, "0")} min`;
  return `${Math.floor(s / 86400)} d ${Math.floor(s / 3600) % 24} h`;
}

/** The same in little room: 0:08, 3:05, 2:10:00. */
export function timer(seconds) {
  if (seconds == null || !isFinite(seconds)) return "–";
  const s = Math.max(0, Math.round(seconds)), two = n => String(n).padStart(2, "0"), h = Math.floor(s / 3600);
  return `${h ? `${h}:${two(Math.floor(s / 60) % 60)}` : Math.floor(s / 60)}:${two(s % 60)}`;
}

export const secondsSince = (time, now) => time ? (now - new Date(time)) / 1000 : null;
export const ago = (time, now) => time ? `${duration(secondsSince(time, now))} ago` : "never";
export const clock = time => time ? new Date(time).toLocaleTimeString([], { hour: "2-digit", minute: "2-digit", second: "2-digit", hour12: false }) : "–";
