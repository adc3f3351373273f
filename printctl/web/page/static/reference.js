// The API's description as a page: what the server says of itself.
import { Fold, Loaded, Table, html, render, useGet } from "./ui.js";

function typed(schema) {
  if (!schema) return "";
  if (schema.$ref) return schema.$ref.split("/").pop();
  if (schema.anyOf) return schema.anyOf.map(typed).join(" or ");
  if (schema.enum) return schema.enum.map((one) => JSON.stringify(one)).join(" | ");
  if (schema.const !== undefined) return JSON.stringify(schema.const);
  if (schema.type === "array") return `list of ${typed(schema.items) || "anything"}`;
  return schema.format === "binary" ? "file" : (schema.type ?? "anything");
}

const Rows = ({ caption, names, rows }) => html`<${Table} caption=${caption} rows=${rows}
  columns=${names.map((name, at) => ({ name, of: (row) => row[at] }))} />`;
const needed = (yes) => (yes ? ", needed" : "");

function Operation({ method, path, of: one }) {
  const parameters = (one.parameters ?? []).map((p) => [
    `${p.name} (${p.in})`, typed(p.schema) + needed(p.required), p.description ?? p.schema?.description ?? "",
  ]);
  const answers = Object.entries(one.responses ?? {}).map(([status, { content, description }]) => [
    status, Object.values(content ?? {}).map((c) => typed(c.schema)).join(" or "), description ?? "",
  ]);
  return html`<${Fold} title=${html`<span><code>${method.toUpperCase()} ${path}</code> ${one.summary}</span>`}>
    <p>${one.description}</p>
    ${parameters.length > 0 && html`
      <${Rows} caption="Parameters" names=${["parameter", "type", "meaning"]} rows=${parameters} />`}
    ${Object.entries(one.requestBody?.content ?? {}).map(([kind, { schema }]) => html`
      <p>Body: ${kind}, ${typed(schema)}</p>`)}
    <${Rows} caption="Answers" names=${["status", "type", "meaning"]} rows=${answers} />
  </${Fold}>`;
}

const Type = ({ name, schema }) => html`<${Fold} title=${name}>${schema.properties
  ? html`<${Rows} caption=${name} names=${["field", "type", "meaning"]} rows=${Object.entries(schema.properties).map(
    ([field, one]) => [field, typed(one) + needed(schema.required?.includes(field)), one.description ?? ""])} />`
  : html`<p>${typed(schema)}</p>`}</${Fold}>`;

function Reference({ address }) {
  const said = useGet(address);
  return html`<${Loaded} of=${said} what="Reading the description">${({ paths, components }) => {
    const operations = Object.entries(paths).flatMap(([path, item]) => Object.entries(item).map(([method, of]) =>
      ({ method, path, of, tag: of.tags?.[0] ?? path.split("/")[3] ?? "server" })));
    return html`${Object.entries(Object.groupBy(operations, (one) => one.tag)).map(([tag, ones]) => html`
        <h2 key=${tag}>${tag}</h2>${ones.map((one) => html`<${Operation} ...${one} />`)}`)}
      <h2>Types</h2>
      ${Object.entries(components?.schemas ?? {}).map(([name, schema]) => html`
        <${Type} name=${name} schema=${schema} />`)}`;
  }}</${Loaded}>`;
}

const place = document.getElementById("api");
place.textContent = "";
render(html`<${Reference} address=${document.querySelector(".reference").dataset.api} />`, place);
