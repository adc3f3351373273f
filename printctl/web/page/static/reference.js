// The API's description as a page, without any library: what the server says of itself.
(() => {
  "use strict";
  const main = document.querySelector(".reference");
  const place = document.getElementById("api");

  function made(tag, text, kind) {
    const element = document.createElement(tag);
    if (text) element.textContent = text;
    if (kind) element.className = kind;
    return element;
  }

  function typed(schema) {
    if (!schema) return "";
    if (schema.$ref) return schema.$ref.split("/").pop();
    if (schema.anyOf) return schema.anyOf.map(typed).join(" or ");
    if (schema.enum) return schema.enum.map((one) => JSON.stringify(one)).join(" | ");
    if (schema.const !== undefined) return JSON.stringify(schema.const);
    if (schema.type === "array") return `list of ${typed(schema.items) || "anything"}`;
    return schema.format === "binary" ? "file" : (schema.type ?? "anything");
  }

  function table(head, rows) {
    const whole = made("table");
    const first = made("tr");
    head.forEach((one) => first.append(made("th", one)));
    whole.append(first);
    for (const row of rows) {
      const line = made("tr");
      row.forEach((one) => line.append(made("td", one)));
      whole.append(line);
    }
    return whole;
  }

  function fields(schema) {
    const needed = new Set(schema.required ?? []);
    const rows = Object.entries(schema.properties ?? {}).map(([name, one]) => [
      name,
      typed(one) + (needed.has(name) ? ", needed" : ""),
      one.description ?? "",
    ]);
    return rows.length ? table(["field", "type", "meaning"], rows) : made("p", typed(schema));
  }

  function operation(method, path, one) {
    const part = made("details");
    const summary = made("summary");
    summary.append(made("code", `${method.toUpperCase()} ${path}`), ` ${one.summary ?? ""}`);
    part.append(summary);
    if (one.description) part.append(made("p", one.description));
    if (one.parameters?.length) {
      const rows = one.parameters.map((p) => [
        `${p.name} (${p.in})`,
        typed(p.schema) + (p.required ? ", needed" : ""),
        p.description ?? p.schema?.description ?? "",
      ]);
      part.append(made("h4", "Parameters"), table(["name", "type", "meaning"], rows));
    }
    for (const [kind, body] of Object.entries(one.requestBody?.content ?? {})) {
      part.append(made("h4", "Body"), made("p", `${kind}: ${typed(body.schema)}`));
    }
    const answers = Object.entries(one.responses ?? {}).map(([status, answer]) => [
      status,
      Object.values(answer.content ?? {}).map((c) => typed(c.schema)).join(" or "),
      answer.description ?? "",
    ]);
    part.append(made("h4", "Answers"), table(["status", "type", "meaning"], answers));
    return part;
  }

  function show(description) {
    place.textContent = "";
    const groups = new Map();
    for (const [path, item] of Object.entries(description.paths)) {
      for (const [method, one] of Object.entries(item)) {
        const tag = one.tags?.[0] ?? path.split("/")[3] ?? "server";
        if (!groups.has(tag)) groups.set(tag, []);
        groups.get(tag).push(operation(method, path, one));
      }
    }
    for (const [tag, parts] of groups) {
      place.append(made("h2", tag));
      place.append(...parts);
    }
    place.append(made("h2", "Types"));
    for (const [name, schema] of Object.entries(description.components?.schemas ?? {})) {
      const part = made("details");
      part.append(made("summary", name), fields(schema));
      place.append(part);
    }
  }

  fetch(main.dataset.api)
    .then((answer) => (answer.ok ? answer.json() : Promise.reject(new Error(answer.status))))
    .then(show)
    .catch((problem) => {
      place.textContent = `The description can't be read (${problem.message}).`;
    });
})();
