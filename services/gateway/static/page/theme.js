// Light or dark: as the system has it, or as a person chose.
import { Icon } from "./icons.js";
import { html, useState } from "./ui.js";

const KEY = "surveilnav-theme";
const dark = matchMedia("(prefers-color-scheme: dark)");
const changed = new Set();
let chosen = read();

function read() { try { return localStorage.getItem(KEY); } catch { return null; } }
function write(value) { try { localStorage.setItem(KEY, value); } catch { /* a private window: for now, then */ } }

export const isDark = () => chosen ? chosen === "dark" : dark.matches;

function apply() {
  document.documentElement.dataset.theme = isDark() ? "dark" : "light";
  for (const heard of changed) heard();
}

/** Calls `heard` whenever the colours change. */
export function onTheme(heard) {
  changed.add(heard);
  return () => changed.delete(heard);
}

/** The value of a colour of the style sheet. */
export const colour = name => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

export function startTheme() {
  dark.addEventListener("change", apply);
  apply();
}

export function ThemeButton() {
  const [, again] = useState(0);
  const toggle = () => { chosen = isDark() ? "light" : "dark"; write(chosen); apply(); again(n => n + 1); };
  const next = isDark() ? "light" : "dark";
  return html`<button class="icon" onClick=${toggle} aria-label="Switch to ${next} colours" title="Switch to ${next} colours">
    <${Icon} name=${isDark() ? "sun" : "moon"} /></button>`;
}
