// What the parts of the page are made with: Preact and its templates, from one vendored file.
export {
  html, render, useEffect, useLayoutEffect, useMemo, useRef, useState, useCallback,
} from "../vendor/htm-preact-standalone.module.js";
