// The page: connects, and draws. Where a key is needed and nobody is signed in, it is the form for that.
import { App } from "./app.js";
import { connect } from "./connection.js";
import { startRates } from "./rates.js";
import { isSignedIn } from "./session.js";
import { SignIn } from "./sign-in.js";
import { startTheme } from "./theme.js";
import { startTrails } from "./trails.js";
import { html, render } from "./ui.js";

startTheme();
const root = document.getElementById("page"), signedIn = await isSignedIn();
if (signedIn) {
  startTrails();
  startRates();
  connect();
}
root.replaceChildren();
render(signedIn ? html`<${App} />` : html`<${SignIn} />`, root);
