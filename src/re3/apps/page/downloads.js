// What can be downloaded; a video with boxes takes a while to be written, and can be cancelled.

import { CANCELLED, download } from "./api.js";

const $ = (id) => document.getElementById(id);
const IN_FILE = {
  csv: "A table: frame, time, object, x, y, width, height in pixels, score, status",
  json: "What the table holds, for programs",
  otb: "x,y,width,height a line for each frame; a file for each object, in a ZIP",
  mot: "frame,object,x,y,width,height,score a line, counted from 1",
  coco: "images, annotations and categories, as COCO has them",
  mp4: "The video with boxes and names drawn in",
};

/** `on.say(text)` for a moment, `on.problem(text)` what is wrong. */
export class Downloads {
  constructor(kinds, model, on) {
    this.model = model;
    this.on = on;
    this.writing = null; // cancels the video being written
    $("writing-cancel").addEventListener("click", () => this.writing?.abort());
    for (const { kind, title } of kinds) {
      const item = document.createElement("li");
      const link = Object.assign(document.createElement("a"), { textContent: title, download: "" });
      link.dataset.kind = kind;
      link.title = IN_FILE[kind] ?? "";
      link.addEventListener("click", (event) => this.clicked(event, kind, link.href));
      item.append(link);
      $("exports").append(item);
    }
  }

  get links() {
    return $("exports").querySelectorAll("a");
  }

  /** Of the session with that id. */
  open(id) {
    for (const link of this.links) link.href = `/api/sessions/${id}/export/${link.dataset.kind}`;
  }

  /** Bring links and the note of what is missing up to the session. */
  update() {
    const { session, objects } = this.model;
    for (const link of this.links) {
      link.toggleAttribute("aria-disabled", false);
      if (!objects.length) link.setAttribute("aria-disabled", "true");
    }
    const lacking = session.untracked?.length > 0 && !session.playing && !session.catching_up;
    $("untracked").hidden = !lacking;
    if (lacking) $("untracked-text").textContent = `Not tracked: ${this.untracked}`;
  }

  get untracked() {
    return `${this.model.session.untracked.join("; ")}.`;
  }

  clicked(event, kind, path) {
    const tracked = this.model.objects.length > 0;
    if (!tracked || kind === "mp4") event.preventDefault();
    if (!tracked) this.on.say("Nothing is tracked yet. Draw a box first.");
    else if (kind === "mp4") this.write(path);
    else if (this.model.session.untracked.length) {
      this.on.say(`The file is not complete: ${this.untracked}`);
    }
  }

  /** Let the video be written, and download it. */
  async write(path) {
    if (this.writing) return;
    this.writing = new AbortController();
    this.progress(0);
    $("writing").hidden = false;
    try {
      const [name, content] = await download(path, this.writing.signal);
      const link = document.createElement("a");
      link.href = URL.createObjectURL(content);
      link.download = name;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
    } catch (error) {
      if (error.message !== CANCELLED) this.on.problem(error.message);
    } finally {
      this.writing = null;
      $("writing").hidden = true;
    }
  }

  /** How far the video is, 0 to 1; null where it is done. */
  progress(part) {
    if (part === null) return;
    $("writing-bar").value = part;
    $("writing-text").textContent = `Writing the video: ${Math.floor(100 * part)} %`
      + (this.model.session.untracked.length ? `. It is not complete: ${this.untracked}` : "");
  }
}
