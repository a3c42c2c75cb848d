// The form that stands in place of the page until a key is given.
import { signIn } from "./session.js";
import { html, useState } from "./ui.js";

export function SignIn() {
  const [problem, setProblem] = useState(""), [sending, setSending] = useState(false);

  async function submit(event) {
    event.preventDefault();
    if (sending) return;
    setSending(true);
    setProblem("");
    try {
      await signIn(new FormData(event.target).get("key"));
      location.reload();
    } catch (error) {
      setProblem(error.message);
      setSending(false);
    }
  }

  return html`<main class="sign-in"><form onSubmit=${submit}>
    <h1>SurveilNav</h1>
    <p class="soft">This gateway answers only with a key. Who runs it makes one by <code>surveilnav security key add</code>.</p>
    <label for="key">Key</label>
    <div class="row">
      <input id="key" name="key" type="password" required maxlength="200" autocomplete="current-password" autofocus />
      <button class="primary" disabled=${sending}>${sending ? "Signing in …" : "Sign in"}</button>
    </div>
    <p class="bad-text" role="alert">${problem}</p>
  </form></main>`;
}
