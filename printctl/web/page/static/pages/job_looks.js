// Looks at an observed print: the one that holds it with what was expected and found, what is asked,
// and the last ones.
import { part, url } from "../api.js";
import { Act, Card, Fold, html, sentence, useGet } from "../ui.js";

const LAST = 12;
const [SMALL_PX, LARGE_PX, WHOLE_PX] = [240, 1280, 4096];

// All looks at a print, and the one that holds it: { all, held, reload }.
export function useLooks(job, { print_id: id, state, look }) {
  const key = `${id} ${state} ${look?.number} ${look?.decision}`;
  const { value, reload } = useGet(`/prints/${part(job)}/looks`, { key });
  const holds = ["looking", "paused"].includes(state);
  return { all: value ?? [], held: holds && value?.find((one) => one.number === look?.number), reload };
}

// The look that holds a print, or is being made; nothing for a print that nobody observes.
export function HeldLook({ job, print, looks: { held, reload } }) {
  const { look, state } = print;
  if (held) {
    return html`<${Card} title=${`Look ${held.number} at the ${held.mark}`} tone=${held.waits ? "warn" : ""}>
      <${Judged} job=${job} look=${held} paused=${state === "paused"} answered=${reload} /></${Card}>`;
  }
  return state === "looking" && look
    ? html`<${Card} title=${`Look ${look.number} at the ${look.mark}: a picture is taken and judged`} />` : null;
}

export const LastLooks = ({ job, looks }) => looks.length > 0 && html`
  <${Fold} title=${`Last looks (${looks.length})`}><${Strip} job=${job} looks=${looks} /></${Fold}>`;

function Judged({ job, look, paused, answered }) {
  const answers = { post: `/prints/${part(job)}/looks/${look.number}/answer`, work: answered };
  return html`<div class="job-look">
    ${look.pictured > 0 && html`<img src=${picture(job, look, LARGE_PX)}
      alt=${`Look ${look.number}: what was expected and what was found`} />`}
    <div class="stack">
      <p>${sentence(look.why)}</p>
      ${look.seen && html`<p class="hint">${look.seen}</p>`}
      ${paused && html`<p role="status">${wordOf(look)}</p>`}
      ${look.waits && html`<div class="row">
        <${Act} kind="main" ...${answers} body=${{ answer: "approve" }}>Approve</${Act}>
        <${Act} ...${answers} body=${{ answer: "go_on" }}>Go on without</${Act}>
      </div>`}
    </div>
  </div>`;
}

// What is proposed, or what comes of the answer.
function wordOf({ waits, proposed, answer }) {
  if (waits) return `Proposed: ${proposed}. The print waits for your word.`;
  if (answer === "approve") {
    return "Approved. If the print is still paused in a minute, it can't be done from here: resume without it, "
      + "or cancel.";
  }
  return answer ? "Answered; the print goes on in a moment."
    : "Nothing is proposed: see to the cause, then resume or cancel.";
}

const Strip = ({ job, looks }) => html`
  <ul class="job-strip" aria-label="Last looks">${looks.slice(-LAST).reverse().map((one) => html`
  <li key=${one.number}>
    ${one.pictured > 0 && html`<a href=${picture(job, one, WHOLE_PX)} target="_blank"
        aria-label=${`Look ${one.number}, whole picture`}>
      <img src=${picture(job, one, SMALL_PX)} alt="" loading="lazy" /></a>`}
    <p>${one.number}: ${one.outcome}</p>
    <p class="hint">${one.seen || "nothing seen"}</p>
  </li>`)}</ul>`;

const picture = (job, { number, pictured }, width) =>
  url(`/prints/${part(job)}/looks/${number}/picture?width=${width}&at=${pictured.toFixed(3)}`);
