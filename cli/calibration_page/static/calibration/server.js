// What the page asks of the command that serves it.

const GONE = "The command that serves this page has ended. Start it again, and open the address that it prints.";

async function asked(path, options) {
  let answer;
  try { answer = await fetch(path, options); } catch { throw new Error(GONE); }
  if (answer.ok) return answer;
  const told = await answer.json().catch(() => ({}));
  throw new Error(told.message ?? `The command answered ${answer.status}: its terminal says why.`);
}

const json = async (path, method, body) => (await asked(path, {
  method, ...(body && { body: JSON.stringify(body), headers: { "Content-Type": "application/json" } }),
})).json();

/** A picture as the browser draws it. */
async function image(path, method = "GET") {
  const url = URL.createObjectURL(await (await asked(path, { method })).blob());
  const loaded = new Image();
  loaded.src = url;
  try { await loaded.decode(); } finally { URL.revokeObjectURL(url); }
  return loaded;
}

export const getState = () => json("state", "GET");
export const getPlan = () => image("plan");
export const getPicture = fresh => image("picture", fresh ? "POST" : "GET");
export const solve = pairs => json("solution", "PUT", pairs);
/** Leaves the points with the command while the page is being closed or reloaded: the browser sends this even then. */
export const keep = pairs => fetch("solution", { method: "PUT", body: JSON.stringify(pairs), keepalive: true }).catch(() => {});
export const savePose = pairs => json("pose", "POST", pairs);
export const saveClicks = pairs => json("clicks", "POST", pairs);
