// The part of the frame that is shown: zoomed in, and moved within the frame.

import { clamp } from "./boxes.js";

const MOST = 16;

export class View {
  constructor() {
    this.size = [16, 9]; // of the video, in pixels
    this.fit();
  }

  fit() {
    this.zoom = 1;
    this.corner = [0, 0]; // the top left point shown, in pixels of the video
  }

  /** Zoom by a factor; the point stays where it is. */
  zoomAt(factor, point) {
    const zoom = clamp(this.zoom * factor, 1, MOST);
    const corner = point.map((v, axis) => v - (v - this.corner[axis]) * this.zoom / zoom);
    this.zoom = zoom;
    this.moveTo(corner);
  }

  /** Zoom by a factor; the point comes to the middle. */
  zoomTo(factor, point) {
    this.zoom = clamp(this.zoom * factor, 1, MOST);
    this.moveTo(point.map((v, axis) => v - this.size[axis] / this.zoom / 2));
  }

  moveBy(dx, dy) {
    this.moveTo([this.corner[0] + dx, this.corner[1] + dy]);
  }

  moveTo(corner) {
    this.corner = corner.map((v, axis) => clamp(v, 0, this.size[axis] * (1 - 1 / this.zoom)));
  }

  get middle() {
    return this.corner.map((v, axis) => v + this.size[axis] / this.zoom / 2);
  }
}

/** Fingers that touch the stage: two of them move and zoom the view. */
export class Fingers {
  constructor() {
    this.places = new Map(); // pointer -> its place
  }

  get several() {
    return this.places.size > 1;
  }

  put(event) {
    if (event.pointerType === "touch") this.places.set(event.pointerId, [event.clientX, event.clientY]);
  }

  lift(event) {
    this.places.delete(event.pointerId);
  }

  /** What moving one of two fingers does: {factor, from, to} of the middle between them. */
  move(event) {
    const before = [...this.places.values()];
    this.put(event);
    const after = [...this.places.values()];
    const middle = (two) => [0, 1].map((axis) => (two[0][axis] + two[1][axis]) / 2);
    const apart = (two) => Math.hypot(two[0][0] - two[1][0], two[0][1] - two[1][1]);
    return { factor: apart(after) / Math.max(1, apart(before)), from: middle(before), to: middle(after) };
  }
}
