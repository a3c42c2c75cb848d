// The present second, for ages that grow.
import { useEffect, useState } from "./ui.js";

export function useNow(everyMs = 1000) {
  const [now, tick] = useState(Date.now());
  useEffect(() => {
    const timer = setInterval(() => tick(Date.now()), everyMs);
    return () => clearInterval(timer);
  }, [everyMs]);
  return now;
}
