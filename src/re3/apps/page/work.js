// The second screen: the video, its objects, and what is done with them.

import { Stream, request } from "./api.js";
import { Chart } from "./chart.js";
import { Downloads } from "./downloads.js";
import { hint } from "./hints.js";
import { Model } from "./model.js";
import { ObjectList } from "./objects.js";
import { Stage } from "./stage.js";

const $ = (id) => document.getElementById(id);
const WHY_GONE = {
  expired: "This session has ended: nobody has used it for too long.",
  ended: "This session has been ended.",
  stopped: "The server has been stopped, and this session with it.",
  unknown: "This session has ended, or the server was started anew.",
  refused: "This session has ended: its video could not be used.",
};
export class WorkScreen {
  /** `banner(text, button, act)` tells of trouble. */
  constructor(about, banner) {
    this.about = about;
    this.banner = banner;
    const model = this.model = new Model();
    this.camera = null;
    this.stream = null;
    this.times = [];
    this.goOn = false;
    this.connected = true;
    this.said = "";
    this.turn = this.lastTurn = 0; // of pictures: decoding may change their order
    this.looking = this.lookNext = null; // frames looked at while the chart is dragged
    this.stage = new Stage($("stage"), model, {
      hold: () => this.hold(),
      release: () => this.release(),
      drawn: (box) => this.drawn(box),
      changed: (id, box) => this.change(id, { box_xywh: box }, true),
      select: (id) => this.select(id),
      draft: () => {
        this.said = "";
        this.updateHint();
      },
      say: (text) => this.say(text),
      zoomed: () => this.zoomed(),
    });
    this.chart = new Chart($("chart"), model, (frame) => this.command({ do: "seek", frame }),
      (frame) => this.look(frame));
    this.list = new ObjectList($("objects"), $("no-objects"), model, {
      rename: (id, name) => this.change(id, { name }),
      recolour: (id, colour) => this.change(id, { colour }),
      redraw: (id) => this.redraw(id),
      end: (id) => this.ask("POST", `/objects/${id}/end`),
      remove: (id) => this.remove(id),
      select: (id) => this.select(id),
    });
    this.downloads = new Downloads(about.exports, model, {
      say: (text) => this.say(text),
      problem: (text) => banner(text),
    });
    this.wire();
  }

  wire() {
    $("play").addEventListener("click", () => this.toggle());
    $("back").addEventListener("click", () => this.step(-1));
    $("forward").addEventListener("click", () => this.step(1));
    $("speed").addEventListener("change", () => this.model.session?.playing && this.play());
    // A click of the keyboard has no detail.
    $("add").addEventListener("click", (event) => (event.detail ? this.add() : this.stage.beginDraft()));
    $("undo").addEventListener("click", () => this.command({ do: "undo" }));
    $("redo").addEventListener("click", () => this.command({ do: "redo" }));
    $("again-stop").addEventListener("click", () => this.command({ do: "pause" }));
    $("track-rest").addEventListener("click", () => this.command({ do: "track" }));
    $("zoom-in").addEventListener("click", () => this.stage.zoomBy(1.5));
    $("zoom-out").addEventListener("click", () => this.stage.zoomBy(1 / 1.5));
    $("zoom-fit").addEventListener("click", () => this.stage.fit());
    $("copy").addEventListener("click", () => this.copyLink());
    $("done").addEventListener("click", () => this.handOver());
    $("idle").textContent = this.about.limits.idle_minutes;
    document.addEventListener("keydown", (event) => this.key(event));
    // After a click with the mouse the keys are for the video again, not for the button clicked.
    $("work").addEventListener("click", (event) => {
      if (event.detail && event.target.closest("button, a")) $("stage").focus({ preventScroll: true });
    });
  }

  open(session, camera) {
    this.id = session.id;
    this.camera = camera;
    $("title").textContent = session.title;
    $("work").dataset.source = session.source;
    this.downloads.open(session.id);
    this.stream = new Stream(session.id, {
      message: (head, picture) => this.message(head, picture),
      lost: () => {
        this.connected = false;
        this.banner("The connection to the server is lost; trying again. If it was stopped, start "
          + "re3 serve again: its sessions are gone then.");
        this.updateControls();
        this.updateHint();
      },
      back: () => {
        this.connected = true;
        this.banner("");
        this.camera?.restart();
      },
    });
    this.update(session);
    this.camera?.start((blob) => this.stream.send(blob), () => {
      this.camera.running = false;
      this.updateControls();
      this.banner("The camera gives no pictures any more. What was tracked stays.");
    });
    this.updateControls();
    $("stage").focus({ preventScroll: true });
  }

  // From the server

  message(head, picture) {
    const handle = {
      state: () => this.update(head.session),
      boxes: () => head.frames.forEach((frame) => this.model.setFrame(frame)),
      frame: () => this.frame(head, picture),
      export: () => this.downloads.progress(head.done),
      dropped: () => this.camera?.answered(head.number),
      refused: () => {
        this.camera?.answered(head.number);
        if (this.camera && head.limit) this.camera.running = false;
        this.banner(head.error);
        this.updateControls();
      },
      error: () => this.banner(head.error),
      gone: () => this.gone(head.why),
    }[head.type];
    handle?.();
  }

  async frame(head, picture) {
    const { model } = this;
    model.setFrame(head);
    model.position = head.index;
    this.looked();
    const own = head.number === undefined ? null : this.camera?.answered(head.number);
    if (picture) {
      const turn = ++this.turn;
      const image = await createImageBitmap(picture);
      await nextPaint();
      this.stream.send({ do: "shown" });
      if (turn > this.lastTurn) {
        this.lastTurn = turn;
        this.stage.show(image);
        this.shown(head);
      }
      image.close();
    } else if (own) {
      this.stage.setSize(own.image.width, own.image.height);
      this.stage.show(own.image);
      this.shown({ ...head, latency: own.ms });
    } else if (head.index === model.shown) {
      this.refresh(head);
    }
    this.chart.update();
  }

  shown(head) {
    this.model.shown = head.index;
    this.sharp = false;
    this.sharpen();
    this.times.push(performance.now());
    if (this.times.length > 20) this.times.shift();
    this.refresh(head);
  }

  refresh(head) {
    this.stage.draw();
    this.list.updateScores();
    $("play").textContent = this.playLabel;
    this.figures(head);
    this.updateHint();
  }

  figures(head) {
    const { model, times } = this;
    const count = model.live ? "" : ` / ${model.frameCount - 1}`;
    $("back").disabled = model.position === 0;
    $("counter").textContent = `${model.shown}${count}`;
    if (head.tracking_fps) $("tracking-fps").textContent = `${head.tracking_fps.toFixed(0)} FPS`;
    const ms = head.latency ?? head.tracking_ms;
    if (ms) $("latency").textContent = `${ms.toFixed(0)} ms`;
    const seconds = (times.at(-1) - times[0]) / 1000;
    $("shown-fps").textContent = this.running && seconds > 0 ? `${((times.length - 1) / seconds).toFixed(0)} FPS` : "–";
  }

  update(session) {
    this.model.setSession(session);
    if (session.ready) this.stage.setSize(session.width, session.height);
    if (!session.playing) this.times = [];
    this.list.update();
    this.stage.draw();
    this.chart.update();
    this.updateControls();
    this.updateHint();
  }

  /** What is being tracked again, and what is not tracked at all. */
  updateProgress() {
    const { session } = this.model;
    const left = session.catching_up ?? 0;
    const text = left ? `Tracking again after a change: ${left} ${left > 1 ? "frames" : "frame"} to go.` : "";
    if ($("again-text").textContent !== text) $("again-text").textContent = text;
    $("again-stop").hidden = !left;
    for (const [name, title] of [["undo", "Undo"], ["redo", "Redo"]]) {
      $(name).disabled = !session.ready || !session[name];
      $(name).title = session[name] ? `${title}: ${session[name]}` : title;
    }
  }

  gone(why) {
    this.stream.close();
    this.camera?.stop();
    this.model.session = { ...this.model.session, ready: false, playing: false };
    this.updateControls();
    this.updateHint();
    this.banner(WHY_GONE[why] ?? WHY_GONE.unknown, "Start again", () => location.assign("/"));
  }

  updateControls() {
    const { model } = this;
    const { ready, source } = model.session;
    const tracked = model.objects.length > 0;
    $("play").textContent = this.playLabel;
    if (!this.running) $("shown-fps").textContent = "–";
    $("play").disabled = (!ready && !this.camera) || !this.connected;
    $("back").disabled = !ready || model.position === 0 || !this.connected;
    $("forward").disabled = !ready || !this.connected;
    $("add").disabled = !ready;
    this.updateProgress();
    const select = source === "select";
    $("select-box").hidden = !select;
    $("results-box").hidden = select;
    $("chart-box").hidden = select;
    $("done").disabled = !tracked || !ready;
    $("speed-label").hidden = Boolean(this.camera);
    this.downloads.update();
  }

  get running() {
    return this.model.session.playing || Boolean(this.camera?.running);
  }

  get playLabel() {
    const { session, position, objects } = this.model;
    if (this.running) return "Pause";
    if (this.camera) return "Go on";
    if (session.ended) return "Play again";
    const behind = position >= session.tracked_until || this.model.unknown.length > 0;
    return objects.length && behind ? "Track" : "Play";
  }

  updateHint() {
    const text = this.connected && this.model.ready && this.said || hint(this);
    if (text !== $("hint").textContent) $("hint").textContent = text;
  }

  /** For a moment, in place of the hint; screen readers read it as well. */
  say(text) {
    this.said = text;
    clearTimeout(this.saying);
    this.saying = setTimeout(() => {
      this.said = "";
      this.updateHint();
    }, 4000);
    this.updateHint();
  }

  // To the server

  command(command) {
    this.banner("");
    this.said = "";
    this.stream.send(command);
  }

  play() {
    this.model.redrawing = null;
    this.model.adding = false;
    const { ended, start } = this.model.session;
    if (ended) this.command({ do: "seek", frame: start ?? 0 });
    this.command({ do: "play", speed: Number($("speed").value) });
  }

  toggle() {
    if (this.camera) {
      this.camera.running = !this.camera.running && this.camera.media.active;
      this.updateControls();
      this.updateHint();
    } else if (this.model.session.playing) this.command({ do: "pause" });
    else this.play();
  }

  step(by) {
    if (this.camera) this.camera.running = false;
    this.command({ do: "step", by });
    this.updateControls();
  }

  /** Show a frame without tracking: one request at a time, the newest wish next. */
  look(frame) {
    if (this.camera) this.camera.running = false;
    this.lookNext = frame;
    if (this.looking === null) this.lookOn();
  }

  lookOn() {
    const frame = this.lookNext;
    [this.looking, this.lookNext] = [null, null];
    if (frame === null || frame === this.model.position) return;
    this.looking = frame;
    this.command({ do: "look", frame });
  }

  /** A frame came: the next one can be asked for. */
  looked() {
    if (this.looking !== null) this.lookOn();
  }

  zoomed() {
    $("zoom-fit").textContent = `${Math.round(100 * this.stage.zoom)} %`;
    this.sharpen();
  }

  /** Where it is zoomed in, the frame in all its pixels, once it stands still. */
  sharpen() {
    clearTimeout(this.sharpening);
    const { model, stage } = this;
    const small = stage.picture.width < stage.size[0];
    if (stage.zoom === 1 || !small || this.sharp || !model.ready || model.session.playing) return;
    this.sharpening = setTimeout(async () => {
      const answer = await fetch(`/api/sessions/${this.id}/frame.jpg?whole=true`).catch(() => null);
      if (!answer?.ok) return;
      const image = await createImageBitmap(await answer.blob());
      if (Number(answer.headers.get("Re3-Frame")) === model.shown) {
        stage.show(image);
        this.sharp = true;
      }
      image.close();
    }, 250);
  }

  /** End the session, so that another has its place. */
  async end() {
    const { session, objects } = this.model;
    if (session?.ready && objects.length
      && !confirm("End this session? Its boxes are forgotten: download them first.")) return;
    this.stream?.close();
    this.camera?.stop();
    await request("DELETE", `/api/sessions/${this.id}`).catch(() => {});
    location.assign("/");
  }

  /** The picture stands still while a box is drawn. */
  hold() {
    if (this.camera) {
      this.goOn = this.goOn || this.camera.running;
      this.camera.running = false;
    } else if (this.model.session.playing) this.command({ do: "pause" });
  }

  release() {
    if (this.camera && this.goOn) this.camera.running = this.camera.media.active;
    this.goOn = false;
    this.updateControls();
  }

  /** A request about the session; what is wrong, or null. */
  async ask(method, path, body) {
    try {
      const told = await request(method, `/api/sessions/${this.id}${path}`, body);
      this.banner("");
      this.answer = told;
      return null;
    } catch (error) {
      if (error.status === 404 && /no such session/.test(error.message)) this.gone("unknown");
      else this.banner(error.message);
      return error.message;
    }
  }

  async drawn(box) {
    const { redrawing } = this.model;
    if (redrawing !== null) {
      await this.change(redrawing, { box_xywh: box }, true);
      return;
    }
    if (await this.ask("POST", "/objects", { box_xywh: box }) === null) {
      this.select(this.answer.id);
    }
    this.release();
  }

  /** The next box is a new object's, wherever it is begun. */
  add() {
    this.hold();
    this.select(null);
    this.model.redrawing = null;
    this.model.adding = true;
    this.updateHint();
  }

  /** Forget an object; boxes of more than a frame or two not without asking. */
  remove(id) {
    const frames = this.model.count(id);
    const { name } = this.model.object(id);
    if (frames > 2 && !confirm(`Remove ${name} and its boxes in ${frames} frames?`)) return;
    this.ask("DELETE", `/objects/${id}`);
  }

  async change(id, changes, drawn = false) {
    if (drawn) this.model.redrawing = null;
    const wrong = await this.ask("PATCH", `/objects/${id}`, changes);
    if (drawn) {
      this.select(id);
      this.release();
    }
    return wrong;
  }

  select(id) {
    this.model.selected = id;
    this.model.adding = false;
    this.list.update();
    this.stage.draw();
    this.updateHint();
  }

  redraw(id) {
    this.hold();
    this.model.redrawing = id;
    this.select(id);
    this.said = "";
    this.updateHint();
    $("stage").focus({ preventScroll: false });
  }

  async handOver() {
    if (await this.ask("POST", "/done") !== null) return;
    this.stream.close();
    this.model.session = { ...this.model.session, ready: false };
    this.updateControls();
    $("hint").textContent = "Tracking goes on in the terminal. You may close this page.";
  }

  async copyLink() {
    const link = new URL(`/s/${this.id}`, location.href).href;
    try {
      await navigator.clipboard.writeText(link);
      $("copy").textContent = "Copied";
      setTimeout(() => { $("copy").textContent = "Copy link"; }, 2000);
    } catch {
      prompt("The link of this session", link);
    }
  }

  // Keys

  undoKey(event) {
    const kind = undoKind(event);
    if (!kind) return;
    event.preventDefault();
    if (this.stage.draft) this.stage.cancel();
    else if (this.model.session[kind]) this.command({ do: kind });
  }

  key(event) {
    if (!this.stream) return;
    const target = event.target;
    if (target.matches("input, select, textarea")) return;
    if (event.ctrlKey || event.metaKey) {
      this.undoKey(event);
      return;
    }
    if (this.stage.key(event)) {
      event.preventDefault();
      return;
    }
    if (!this.model.ready && !this.camera) return;
    const control = target.matches("button, a, summary");
    const inStage = target === this.stage.element;
    const select = this.model.session.source === "select";
    const acts = {
      " ": () => !control && !select && this.toggle(),
      ArrowLeft: () => !select && this.step(-1),
      ArrowRight: () => !select && this.step(1),
      Enter: () => {
        if (control) return false;
        if (select && this.model.objects.length && this.model.redrawing === null) return this.handOver();
        return inStage && this.stage.beginDraft(this.model.redrawing ?? this.model.selected);
      },
      Delete: () => !control && this.model.selected !== null
        && this.remove(this.model.selected),
      "+": () => this.stage.zoomBy(1.5),
      "=": () => this.stage.zoomBy(1.5),
      "-": () => this.stage.zoomBy(1 / 1.5),
      0: () => this.stage.fit(),
      Escape: () => {
        this.model.redrawing = null;
        this.stage.cancel();
        this.select(null);
        this.updateHint();
      },
    };
    acts.Backspace = acts.Delete; // keyboards of laptops have no other
    if (acts[event.key] && acts[event.key]() !== false) event.preventDefault();
  }
}

function undoKind(event) {
  const key = event.key.toLowerCase();
  if (key === "z") return event.shiftKey ? "redo" : "undo";
  return key === "y" ? "redo" : null;
}

function nextPaint() {
  // A page in the background is not painted; it must not hold up the pictures.
  return document.hidden ? Promise.resolve() : new Promise((resolve) => requestAnimationFrame(resolve));
}
