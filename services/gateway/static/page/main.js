// The page: connects, and draws.
import { App } from "./app.js";
import { connect } from "./connection.js";
import { startRates } from "./rates.js";
import { startTheme } from "./theme.js";
import { startTrails } from "./trails.js";
import { html, render } from "./ui.js";

startTheme();
startTrails();
startRates();
connect();
const root = document.getElementById("page");
root.replaceChildren();
render(html`<${App} />`, root);
