// Looks at an observed print: the one that holds it with what was expected and found, what is asked,
// and the last ones.
import { part, send, url } from "../api.js";
import { Act, Button, Card, Fold, html, useGet } from "../ui.js";

const LAST = 12;
const [SMALL_PX, LARGE_PX, WHOLE_PX] = [240, 1280, 4096];

// Nothing for a print that nobody observes.
export function Looks({ job, print, cancel }) {
  const { look } = print;
  const looks = useGet(`/prints/${part(job)}/looks`, { key: `${print.print_id} ${print.state} ${look?.number} ${look?.decision}` });
  const known = looks.value ?? [];
  const held = ["looking", "paused"].includes(print.state);
  const shown = held ? known.find((one) => one.number === look?.number) : undefined;
  if (!known.length && print.state !== "looking") return null;
  const head = shown ? `Look ${shown.number} at the ${shown.mark}`
    : print.state === "looking" && look ? `Look ${look.number} at the ${look.mark}: a picture is taken and judged` : "";
  return html`
    ${head && html`<${Card} title=${head} tone=${shown?.waits ? "warn" : ""}>
      ${shown && html`<${Held} job=${job} look=${shown} paused=${print.state === "paused"} cancel=${cancel} answered=${looks.reload} />`}
    </${Card}>`}
    ${known.length > 0 && html`<${Fold} title=${`Last looks (${known.length})`}><${Strip} job=${job} looks=${known} /></${Fold}>`}`;
}

function Held({ job, look, paused, cancel, answered }) {
  const answer = (word) => async () => {
    await send("POST", `/prints/${part(job)}/looks/${look.number}/answer`, { answer: word });
    answered();
  };
  return html`<div class="job-look">
    ${look.pictured > 0 && html`<img src=${picture(job, look, LARGE_PX)} alt=${`Look ${look.number}: what was expected and what was found`} />`}
    <div class="stack">
      <p>${sentence(look.why)}</p>
      ${look.seen && html`<p class="hint">${look.seen}</p>`}
      ${paused && html`<p role="status">${wordOf(look)}</p>`}
      ${look.waits && html`<div class="row">
        <${Act} kind="main" work=${answer("approve")}>Approve</${Act}>
        <${Act} work=${answer("go_on")}>Go on without</${Act}>
        <${Button} kind="danger" onClick=${cancel}>Cancel print</${Button}>
      </div>`}
    </div>
  </div>`;
}

// What is proposed, or what comes of the answer.
function wordOf({ waits, proposed, answer }) {
  if (waits) return `Proposed: ${proposed}. The print waits for your word.`;
  if (answer === "approve") {
    return "Approved. If the print is still paused in a minute, it can't be done from here: resume without it, or cancel.";
  }
  return answer ? "Answered; the print goes on in a moment."
    : "Nothing is proposed: see to the cause, then resume or cancel.";
}

const Strip = ({ job, looks }) => html`<ul class="job-strip" aria-label="Last looks">${looks.slice(-LAST).reverse().map((one) => html`
  <li key=${one.number}>
    ${one.pictured > 0 && html`<a href=${picture(job, one, WHOLE_PX)} target="_blank" aria-label=${`Look ${one.number}, whole picture`}>
      <img src=${picture(job, one, SMALL_PX)} alt="" loading="lazy" /></a>`}
    <p>${one.number}: ${one.outcome}</p>
    <p class="hint">${one.seen || "nothing seen"}</p>
  </li>`)}</ul>`;

const picture = (job, { number, pictured }, width) =>
  url(`/prints/${part(job)}/looks/${number}/picture?width=${width}&at=${pictured.toFixed(3)}`);
const sentence = (text) => text.slice(0, 1).toUpperCase() + text.slice(1);
