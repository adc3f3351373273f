// Where everybody begins: what goes on, what was begun, and what one can begin with.
import { Card, Empty, Loaded, Page, html, useGet } from "../ui.js";

export default function Home() {
  const recipes = useGet("/recipes");
  return html`<${Page} title="Home">
    <${Card} title="Go on"><${Loaded} of=${recipes}>${(rows) =>
      rows.length ? html`<ul class="list">${rows.map((one) => html`<li key=${one.name}><a class="link-row" href=${`/project?name=${one.name}`}>${one.name}</a></li>`)}</ul>`
        : html`<${Empty}>Nothing yet.</${Empty}>`}</${Loaded}></${Card}>
  </${Page}>`;
}
