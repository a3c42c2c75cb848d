// The present second by the gateway's clock, for ages that grow: a phone's own may be minutes off.
import { useEffect, useState } from "./ui.js";

/** A difference that is less comes from the way of the answer. */
const LEAST_MS = 2000;
let aheadMs = 0;

/** Milliseconds since the epoch, where the gateway is. */
export const gatewayNow = () => Date.now() + aheadMs;

/** Takes the `Date` of an answer: what time it is there. */
export function learnTime(date) {
  const differenceMs = Date.parse(date) - Date.now();
  if (isFinite(differenceMs)) aheadMs = Math.abs(differenceMs) < LEAST_MS ? 0 : differenceMs;
}

export function useNow(everyMs = 1000) {
  const [now, tick] = useState(gatewayNow());
  useEffect(() => {
    const timer = setInterval(() => tick(gatewayNow()), everyMs);
    return () => clearInterval(timer);
  }, [everyMs]);
  return now;
}
