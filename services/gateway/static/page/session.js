// Who is signed in. Where the gateway needs a key, it is exchanged for a session, which scripts don't see: the key isn't kept here.
import { address } from "./api.js";

/** `needed`: the gateway answers only with a key. `name`, `role`: of the session's key. */
export const session = { needed: false, name: "", role: null };

/** Asks who is signed in; true: the page may be shown. Where nothing answers, the page itself says so. */
export async function isSignedIn() {
  const answer = await fetch(address("session")).catch(() => null);
  if (answer?.ok) Object.assign(session, await answer.json());
  return !session.needed || Boolean(session.name);
}

/** Shows the form to sign in if the session has ended. */
export async function signInAgain() {
  if (!await isSignedIn()) location.reload();
}

addEventListener("signed-out", signInAgain);

/** Opens a session; an Error whose message says why not. */
export async function signIn(key) {
  const answer = await fetch(address("session"), {
    method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify({ key }),
  }).catch(() => { throw new Error("The gateway doesn't answer. Is it running?"); });
  if (!answer.ok) throw new Error((await answer.json().catch(() => ({}))).detail || `HTTP ${answer.status}`);
}

export async function signOut() {
  await fetch(address("session"), { method: "DELETE" }).catch(() => null);
  location.reload();
}
