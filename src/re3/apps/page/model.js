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
    const known = new Map(this.objects.map((each) => [each.id, each.tracked]));
    for (const [index, frame] of this.frames) {
      frame.results = frame.results.filter((found) =>
        known.get(found.object)?.some(([first, last]) => first <= index && index <= last));
    }
    const ids = new Set(known.keys());
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

  /** Whether the object is followed in a frame: from a box drawn on, and until it is ended. */
  follows(object, index = this.shown) {
    const latest = (frames) => frames.filter((frame) => frame <= index).at(-1) ?? -1;
    return latest(object.given) > latest(object.ends);
  }

  /** The objects that should be in the frame shown, but are not tracked up to it yet. */
  get unknown() {
    return this.objects.filter((each) => this.follows(each) && !this.result(each.id));
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
    const object = this.object(id);
    const until = Math.max(this.position, object.tracked.at(-1)?.[1] ?? 0);
    for (let index = object.first; index <= until; index++) {
      yield [index, this.result(id, index)];
    }
  }
}
