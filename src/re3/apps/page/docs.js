// The OpenAPI description as a page; the usual viewers load their scripts from elsewhere.

import { request } from "./api.js";
import { startTheme } from "./theme.js";

function add(parent, tag, text = "", className = "") {
  const element = document.createElement(tag);
  element.textContent = text;
  if (className) element.className = className;
  parent.append(element);
  return element;
}

function nameOf(schema) {
  if (!schema) return "";
  if (schema.$ref) return schema.$ref.split("/").at(-1);
  if (schema.anyOf) return schema.anyOf.map(nameOf).filter((name) => name !== "null").join(" or ");
  if (schema.enum) return schema.enum.join(" | ");
  if (schema.type === "array") return `list of ${nameOf(schema.items)}`;
  return schema.format ?? schema.type ?? "anything";
}

function table(parent, heading, rows) {
  if (!rows.length) return;
  const grid = add(parent, "table");
  const head = add(add(grid, "thead"), "tr");
  for (const text of heading) add(head, "th", text).scope = "col";
  const body = add(grid, "tbody");
  for (const row of rows) {
    const line = add(body, "tr");
    for (const text of row) add(line, "td", text);
  }
}

function operation(parent, method, path, told) {
  const article = add(parent, "article");
  const title = add(article, "h3");
  add(title, "span", `${method.toUpperCase()} `, "method");
  title.append(path);
  add(article, "p", told.description ?? told.summary ?? "");
  table(article, ["parameter", "kind", "meaning"], (told.parameters ?? []).map((each) =>
    [each.name, `${each.in}, ${nameOf(each.schema)}`, each.description ?? ""]));
  for (const [type, { schema }] of Object.entries(told.requestBody?.content ?? {})) {
    add(article, "p", `Takes ${type}: ${nameOf(schema)}`);
  }
  for (const [status, answer] of Object.entries(told.responses ?? {})) {
    if (!status.startsWith("2")) continue;
    const kinds = Object.entries(answer.content ?? {}).map(([type, { schema }]) => nameOf(schema) || type);
    add(article, "p", `Gives ${status}${kinds.length ? `: ${kinds.join(", ")}` : ""}`);
  }
}

async function main() {
  startTheme(document.getElementById("theme"));
  const api = await request("GET", "/openapi.json");
  document.getElementById("about").textContent = api.info.description;
  const parent = document.getElementById("operations");
  const byTag = new Map();
  for (const [path, methods] of Object.entries(api.paths)) {
    for (const [method, told] of Object.entries(methods)) {
      const tag = told.tags?.[0] ?? "other";
      if (!byTag.has(tag)) {
        byTag.set(tag, add(parent, "section"));
        add(byTag.get(tag), "h2", tag);
      }
      operation(byTag.get(tag), method, path, told);
    }
  }
  const models = add(parent, "section");
  add(models, "h2", "what is taken and given");
  for (const [name, schema] of Object.entries(api.components.schemas)) {
    const article = add(models, "article");
    add(article, "h3", name);
    add(article, "p", schema.description ?? "");
    const needed = new Set(schema.required ?? []);
    table(article, ["field", "kind", "meaning"], Object.entries(schema.properties ?? {}).map(
      ([field, each]) => [field, `${nameOf(each)}${needed.has(field) ? "" : ", optional"}`,
        each.description ?? ""]));
  }
}

main();
