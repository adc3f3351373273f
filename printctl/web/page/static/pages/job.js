// A job: before its print, while it goes on, and after it. A print is told by its own identity.
import { get, last, listen, part } from "../api.js";
import {
  Badge, Button, Loaded, Page, html, nameOf, useCallback, useEffect, useRef, useState, useStyle,
} from "../ui.js";
import After from "./job_after.js";
import Before from "./job_before.js";
import Running, { Ending } from "./job_running.js";

export default function Job({ job: asked = "", again, other }) {
  useStyle("pages/job.css");
  const { print, loading, problem, reload } = usePrint(asked);
  const missing = (loading || (problem && !print)) && { value: null, loading, problem, reload };
  if (missing) return html`<${Page} title="Job"><${Loaded} of=${missing} what="Asking for the print" /></${Page}>`;
  const job = asked || (other ? "" : (print?.job ?? ""));
  const mine = job && print?.job === job ? print : null;
  const goesOn = mine && !mine.ended;
  const over = mine && mine.ended && again !== mine.print_id; // which is to be printed again
  const tools = job && html`${mine?.simulated && html`<${Badge}>simulated</${Badge}>`}
    <${Button} href="/job?other=1">Other jobs</${Button}>`;
  return html`<${Page} title=${job ? nameOf(job) : "Job"} tools=${tools}>
    ${goesOn && html`<${Running} job=${job} print=${mine} />`}
    ${over && html`<${Ending} key=${mine.print_id} job=${job} print=${mine} reload=${reload} />
      <${After} job=${job} print=${mine} reload=${reload} />`}
    ${!goesOn && !over && html`<${Before} key=${job} job=${job} print=${mine} reload=${reload} />`}
  </${Page}>`;
}

// The last print of a job as it stands, without one the print that goes on: asked for once, then as
// the server tells of it.
function usePrint(asked) {
  const ours = (one, old) => (asked ? one.job === asked : !one.ended || !old || one.job === old.job);
  const [state, setState] = useState(() => {
    const known = last("print");
    return known && asked && known.job === asked ? { print: known } : { print: null, loading: true };
  });
  const turn = useRef(0);
  const reload = useCallback(() => {
    const mine = (turn.current += 1);
    get(`/prints/current?job=${part(asked)}`).then(
      (print) => mine === turn.current && setState({ print }),
      (problem) => mine === turn.current && setState((old) => ({ ...old, loading: false, problem })),
    );
  }, [asked]);
  useEffect(reload, [reload]);
  useEffect(() => listen((one) => {
    if (one.event === "lost" && !one.lost) reload(); // for what was missed
    if (one.event !== "print") return;
    setState((old) => {
      const earlier = one.print_id !== old.print?.print_id && one.started < old.print?.started;
      if (!ours(one, old.print) || (one.job === old.print?.job && earlier)) return old;
      turn.current += 1; // a question that is under way would be answered by what is older
      return { print: one };
    });
  }), [asked]);
  return { ...state, reload };
}
