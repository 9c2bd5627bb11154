// Which screen is shown, and the line that tells of trouble.

import { request } from "./api.js";
import { StartScreen } from "./start.js";
import { startTheme } from "./theme.js";
import { WorkScreen } from "./work.js";

const $ = (id) => document.getElementById(id);

function banner(text, button = "", act = null) {
  $("banner").hidden = !text;
  if ($("banner-text").textContent !== text) $("banner-text").textContent = text;
  $("banner-button").hidden = !button;
  $("banner-button").textContent = button;
  $("banner-button").onclick = act;
}

function show(session, camera, work) {
  $("start").hidden = true;
  $("work").hidden = false;
  document.title = `${session.title} – re3`;
  history.replaceState(null, "", `/s/${session.id}`);
  work.open(session, camera);
}

async function main() {
  startTheme($("theme"));
  const about = await request("GET", "/api/about");
  const work = new WorkScreen(about, banner);
  window.re3 = work; // for tests, and for the curious
  new StartScreen(about, {
    begin: (session, camera) => (work.stream ? location.assign(`/s/${session.id}`)
      : show(session, camera, work)),
    problem: banner,
  });
  $("new").addEventListener("click", () => location.assign("/"));
  const [, id] = location.pathname.match(/^\/s\/([^/]+)$/) ?? [];
  if (id) {
    try {
      show(await request("GET", `/api/sessions/${encodeURIComponent(id)}`), null, work);
    } catch (error) {
      history.replaceState(null, "", "/");
      banner(error.message);
    }
  }
}

main().catch((error) => banner(error.message));
