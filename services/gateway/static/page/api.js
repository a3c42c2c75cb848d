// REST, at addresses relative to the page: a proxy may have the gateway below a path.

import { learnTime } from "./clock.js";

const ROOT = "api/v1";
export const address = path => `${ROOT}/${path}`;
export const part = encodeURIComponent;

/** The answer; an Error whose message says what to do (RFC 9457) if it is no success. */
export async function ask(path, options) {
  let answer;
  try { answer = await fetch(address(path), options); }
  catch { throw new Error("The gateway doesn't answer. Is it running?"); }
  learnTime(answer.headers.get("date"));
  if (answer.ok) return answer;
  if (answer.status === 401) dispatchEvent(new Event("signed-out"));
  const problem = await answer.json().catch(() => ({}));
  throw Object.assign(new Error(problem.detail || problem.title || `HTTP ${answer.status}`), {
    status: answer.status, name: (problem.type || "").split(":").pop() || "http",
  });
}

export const get = async path => (await ask(path)).json();

async function send(method, path, body, headers = {}, signal = undefined) {
  const answer = await ask(path, {
    method, signal, headers: { "content-type": "application/json", ...headers }, body: body === undefined ? undefined : JSON.stringify(body),
  });
  return answer.json();
}

export const post = (path, body, headers) => send("POST", path, body, headers);
export const patch = (path, body, signal) => send("PATCH", path, body, {}, signal);

export const remove = path => ask(path, { method: "DELETE" });
