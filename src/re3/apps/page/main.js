// Which screen is shown, and the line that tells of trouble.

import { request } from "./api.js";
import { StartScreen } from "./start.js";
import { startTheme } from "./theme.js";
import { WorkScreen } from "./work.js";

const $ = (id) => document.getElementById(id);

function banner(told, button = "", act = null) {
  const text = told.replace(/^[a-z]+(?=[ ,;])/, (word) => word[0].toUpperCase() + word.slice(1));
  $("banner").hidden = !text;
  $("banner-close").onclick = () => banner("");
  if ($("banner-text").textContent !== text) $("banner-text").textContent = text;
  $("banner-button").hidden = !button;
  $("banner-button").textContent = button;
  $("banner-button").onclick = act;
}

function show(session, camera, work) {
  $("start").hidden = true;
  $("work").hidden = false;
  document.title = `${session.title} – re3`;
  const address = `/s/${session.id}`;
  // So that the browser's Back goes to the first screen.
  if (location.pathname !== address) history.pushState(null, "", address);
  work.open(session, camera);
}

async function main() {
  startTheme($("theme"));
  addEventListener("popstate", () => location.reload());
  const about = await request("GET", "/api/about");
  const work = new WorkScreen(about, banner);
  window.re3 = work; // for tests, and for the curious
  new StartScreen(about, {
    begin: (session, camera) => (work.stream ? location.assign(`/s/${session.id}`)
      : show(session, camera, work)),
    problem: banner,
  });
  $("new").addEventListener("click", () => work.end());
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
