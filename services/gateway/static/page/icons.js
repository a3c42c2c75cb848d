// Small pictures on buttons, drawn here: fonts lack many signs.
import { html } from "./ui.js";

const PATHS = {
  pause: "M5 3h2.4v10H5zM8.6 3H11v10H8.6z", play: "M4.5 2.8l8 5.2-8 5.2z", close: "M4 3l9 9-1 1-9-9zM12 3l1 1-9 9-1-1z",
  sun: "M8 4.8a3.2 3.2 0 110 6.4 3.2 3.2 0 010-6.4zM7.3 1h1.4v2H7.3zM7.3 13h1.4v2H7.3zM1 7.3h2v1.4H1zM13 7.3h2v1.4h-2zM2.9 3.9l1-1 1.4 1.4-1 1zM10.7 11.7l1-1 1.4 1.4-1 1zM3.9 13.1l-1-1 1.4-1.4 1 1zM11.7 5.3l-1-1 1.4-1.4 1 1z",
  moon: "M9.8 1.6A6.6 6.6 0 1014.4 10 5.4 5.4 0 019.8 1.6z", fit: "M2 2h4v1.4H3.4V6H2zM10 2h4v4h-1.4V3.4H10zM2 10h1.4v2.6H6V14H2zM12.6 10H14v4h-4v-1.4h2.6z",
  plus: "M7.2 2.5h1.6v4.7h4.7v1.6H8.8v4.7H7.2V8.8H2.5V7.2h4.7z", minus: "M2.5 7.2h11v1.6h-11z",
  left: "M10.3 2.7l1 1L7 8l4.3 4.3-1 1L5 8z", erase: "M9.6 2.2l4.2 4.2-6.3 6.3H14V14H4.2L1.8 11.6a1 1 0 010-1.4zM6 6.2l-3.2 3.2 0 1.4 1.9 1.9h1.4l2.5-2.5z", right: "M5.7 2.7L11 8l-5.3 5.3-1-1L9 8 4.7 3.7z",
};

export const Icon = ({ name, size = 15 }) => html`<svg class="icon" viewBox="0 0 16 16" width=${size} height=${size} aria-hidden="true"><path fill="currentColor" d=${PATHS[name]} /></svg>`;
