// Pages of the server (networks, layers, reports), shut in a frame.
import { url } from "./api.js";
import { Failed, Loading, html, useEffect, useRef, useState, useTheme } from "./ui.js";

const LEAST_PX = 320;

// A page at an address of the API, as tall as the window leaves if that is much, or with `whole` nearly as
// tall as the window; `hear` gets what it tells.
export function Frame({ src, title, hear = null, tall = true, whole = false }) {
  const theme = useTheme();
  const [ready, setReady] = useState({ here: false, problem: null });
  const [height, setHeight] = useState(LEAST_PX);
  const box = useRef(null);
  const told = useRef(hear);
  told.current = hear;
  useEffect(() => { // it may take minutes to be made, and a frame can't say why it isn't
    const ended = new AbortController();
    fetch(url(src), { signal: ended.signal }).then(async (answer) => {
      const why = answer.ok ? null : await answer.json().catch(() => ({ message: `refused (${answer.status})` }));
      setReady({ here: answer.ok, problem: why });
      ended.abort();
    }, (why) => ended.signal.aborted || setReady({ here: false, problem: why }));
    return () => ended.abort();
  }, [src]);
  useEffect(() => {
    const fit = () => {
      const top = (box.current?.getBoundingClientRect().top ?? 0) + window.scrollY;
      const left = window.innerHeight - top - 34; // below it lie the card's and the page's edge
      if (whole) setHeight(Math.max(LEAST_PX, window.innerHeight - 110)); // the header stays above it
      else setHeight(tall && left > LEAST_PX ? left : Math.max(LEAST_PX, 0.55 * window.innerHeight));
    };
    const observer = new ResizeObserver(fit);
    [document.documentElement, document.getElementById("content")].forEach((one) => observer.observe(one));
    window.addEventListener("resize", fit);
    return () => {
      observer.disconnect();
      window.removeEventListener("resize", fit);
    };
  }, [ready.here]);
  useEffect(() => {
    const listen = (event) => event.source === box.current?.contentWindow && told.current?.(event.data ?? {});
    window.addEventListener("message", listen);
    return () => window.removeEventListener("message", listen);
  }, []);
  if (ready.problem) return html`<${Failed} problem=${ready.problem} />`;
  if (!ready.here) return html`<${Loading} what="The view is being made" />`;
  return html`<iframe class="frame" ref=${box} title=${title} src=${`${url(src)}?theme=${theme}`}
    sandbox="allow-scripts allow-downloads" style=${{ height: `${Math.round(height)}px` }}></iframe>`;
}
