// What the page knows of the session: its state, and the boxes of every frame told so far.

export class Model {
  constructor() {
    this.session = null;
    this.frames = new Map(); // index -> {timestamp, results}
    this.position = 0; // the frame the server is at
    this.shown = 0; // the frame whose picture is shown
    this.selected = null;
    this.redrawing = null; // the object that the next box is for
    this.adding = false; // whether the next box was asked to be a new object's
  }

  get ready() {
    return Boolean(this.session?.ready);
  }

  get live() {
    return this.session?.source === "camera";
  }

  get objects() {
    return this.session?.objects ?? [];
  }

  get frameCount() {
    return Math.max(this.session?.frame_count ?? 0, this.position + 1);
  }

  setSession(session) {
    this.session = session;
    if (!session.ready) return;
    this.position = session.position;
    const until = session.tracked_until ?? -1;
    const start = session.start ?? Infinity;
    for (const index of this.frames.keys()) {
      if (index > until || index < start) this.frames.delete(index);
    }
    const ids = new Set(this.objects.map((each) => each.id));
    for (const frame of this.frames.values()) {
      frame.results = frame.results.filter((found) => ids.has(found.object));
    }
    if (!ids.has(this.selected)) this.selected = null;
    if (!ids.has(this.redrawing)) this.redrawing = null;
  }

  setFrame(frame) {
    this.frames.set(frame.index, frame);
  }

  object(id) {
    return this.objects.find((each) => each.id === id) ?? null;
  }

  results(index = this.shown) {
    return this.frames.get(index)?.results ?? [];
  }

  result(id, index = this.shown) {
    return this.results(index).find((found) => found.object === id) ?? null;
  }

  box(id) {
    return id === null ? null : this.result(id)?.box_xywh ?? null;
  }

  /** Frames in which the object was found, or looked for. */
  count(id) {
    return [...this.frames.values()].filter((frame) =>
      frame.results.some((found) => found.object === id)).length;
  }

  /** Whether an object is lost in any frame. */
  get anyLost() {
    return [...this.frames.values()].some((frame) =>
      frame.results.some((found) => found.status === "lost"));
  }

  /** [index, result or null] of an object, in order. */
  *history(id) {
    const until = this.session?.tracked_until ?? this.position;
    for (let index = this.session?.start ?? 0; index <= Math.max(until, this.position); index++) {
      yield [index, this.result(id, index)];
    }
  }
}
