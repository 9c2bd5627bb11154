// The picture with its boxes: drawing them, and drawing new ones by mouse, finger or keyboard.

import { HANDLES, between, clamp, contains, handleAt, handlePoint, largeEnough, moved, resized }
  from "./boxes.js";
import { Fingers, View } from "./view.js";

const TRAIL = 40; // frames
const ROOM = 40; // CSS pixels of a side with a handle in its middle; shorter ones have corners only
const NAME_LENGTH = 28;
const REACH = { mouse: 8, touch: 22, pen: 10 }; // CSS pixels
const CURSORS = { nw: "nwse-resize", se: "nwse-resize", ne: "nesw-resize", sw: "nesw-resize",
  n: "ns-resize", s: "ns-resize", e: "ew-resize", w: "ew-resize" };

/**
 * `on.hold()` before a box is begun; `on.drawn(box)` a new one; `on.changed(id, box)` one of an
 * object; `on.select(id)`; `on.draft()` where one made with the keyboard changes; `on.say(text)`;
 * `on.zoomed()` where another part of the frame is shown.
 */
export class Stage {
  constructor(element, model, on) {
    this.element = element;
    this.model = model;
    this.on = on;
    this.picture = element.querySelector("#picture");
    this.overlay = element.querySelector("#overlay");
    this.drag = null; // a pointer at work
    this.draft = null; // {box, id}: a box being made with the keyboard; id of the object changed
    this.view = new View();
    this.fingers = new Fingers();
    this.panning = null; // where the picture is held
    element.addEventListener("pointerdown", (event) => this.down(event));
    element.addEventListener("pointermove", (event) => this.move(event));
    element.addEventListener("pointerup", (event) => this.up(event));
    element.addEventListener("pointercancel", (event) => {
      this.fingers.lift(event);
      this.panning = null;
      this.cancel();
    });
    element.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    new ResizeObserver(() => this.place()).observe(element);
  }

  /** Width and height of the video, in whose pixels boxes are. */
  setSize(width, height) {
    if (width === this.size[0] && height === this.size[1]) return;
    this.view.size = [width, height];
    this.element.style.aspectRatio = `${width} / ${height}`;
    this.element.style.maxWidth = `calc(min(62vh, 46rem) * ${width / height})`;
    this.fit();
  }

  show(image) {
    if (this.picture.width !== image.width) this.picture.width = image.width;
    if (this.picture.height !== image.height) this.picture.height = image.height;
    this.picture.getContext("2d").drawImage(image, 0, 0);
  }

  get busy() {
    return this.drag !== null || this.draft !== null;
  }

  // Pointers

  point(event) {
    const area = this.element.getBoundingClientRect();
    return [this.corner[0] + (event.clientX - area.left) * this.scale,
      this.corner[1] + (event.clientY - area.top) * this.scale];
  }

  get size() {
    return this.view.size;
  }

  get zoom() {
    return this.view.zoom;
  }

  get corner() {
    return this.view.corner;
  }

  get scale() { // video pixels per CSS pixel
    return this.size[0] / Math.max(1, this.element.clientWidth) / this.zoom;
  }

  // Zoom

  fit() {
    this.view.fit();
    this.place();
  }

  /** Zoom by a factor about a point that stays, or else to the selected box or the middle. */
  zoomBy(factor, about = null) {
    const box = this.draft?.box ?? this.model.box(this.model.selected);
    if (about) this.view.zoomAt(factor, about);
    else this.view.zoomTo(factor, box ? handlePoint(box, "") : this.view.middle);
    this.place();
  }

  pan(dx, dy) {
    this.view.moveBy(dx, dy);
    this.place();
  }

  /** Lay the picture where its part is. */
  place() {
    const [x, y] = this.corner.map((v) => -v / this.scale);
    this.picture.style.transform = `translate(${x}px, ${y}px) scale(${this.zoom})`;
    this.picture.style.imageRendering = this.zoom > 4 ? "pixelated" : "";
    this.draw();
    this.on.zoomed();
  }

  wheel(event) {
    const out = event.deltaY > 0;
    if (this.zoom === 1 && out && !event.ctrlKey) return; // the page scrolls
    event.preventDefault();
    if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
      this.pan((event.deltaX || event.deltaY) * this.scale, 0);
    } else this.zoomBy(Math.exp(clamp(-event.deltaY, -120, 120) / 300), this.point(event));
  }

  /** Two fingers move and zoom the picture. */
  pinch(event) {
    const { factor, from, to } = this.fingers.move(event);
    this.zoomBy(factor, this.point({ clientX: to[0], clientY: to[1] }));
    this.pan((from[0] - to[0]) * this.scale, (from[1] - to[1]) * this.scale);
  }

  /** What a pointer there would do: {kind: "resize" | "move" | "draw", ...}. */
  aim(point, type) {
    const selected = this.model.box(this.model.selected);
    if (selected && this.model.redrawing === null) {
      const handle = handleAt(selected, point, (REACH[type] ?? 10) * this.scale);
      if (handle) return { kind: "resize", handle, id: this.model.selected, box: selected };
      if (contains(selected, point)) return { kind: "move", id: this.model.selected, box: selected };
    }
    return { kind: "draw" };
  }

  down(event) {
    this.fingers.put(event);
    if (this.fingers.several) this.cancel(); // no box, but a zoom
    if (event.button === 1) {
      event.preventDefault();
      this.element.setPointerCapture(event.pointerId);
      this.panning = [event.clientX, event.clientY];
      return;
    }
    if (this.fingers.several) return;
    if (!event.isPrimary || event.button !== 0 || !this.model.ready) return;
    this.element.focus({ preventScroll: true });
    this.element.setPointerCapture(event.pointerId);
    this.draft = null;
    this.on.hold();
    const from = this.point(event);
    this.drag = { ...this.aim(from, event.pointerType), from, at: from, now: null };
  }

  move(event) {
    if (this.fingers.several) {
      this.pinch(event);
      return;
    }
    if (this.panning) {
      const [x, y] = this.panning;
      this.panning = [event.clientX, event.clientY];
      this.pan((x - event.clientX) * this.scale, (y - event.clientY) * this.scale);
      return;
    }
    const point = this.point(event);
    if (!this.drag) {
      const aim = this.model.ready ? this.aim(point, event.pointerType) : { kind: "none" };
      this.element.style.cursor =
        { resize: CURSORS[aim.handle], move: "move", draw: "crosshair", none: "default" }[aim.kind];
      return;
    }
    const drag = this.drag;
    drag.at = point;
    const [dx, dy] = [point[0] - drag.from[0], point[1] - drag.from[1]];
    if (drag.kind === "draw") drag.now = between(drag.from, point, this.size);
    else if (Math.hypot(dx, dy) > 2 * this.scale || drag.now) {
      drag.now = drag.kind === "move" ? moved(drag.box, dx, dy, this.size)
        : resized(drag.box, drag.handle, dx, dy, this.size);
    }
    this.draw();
  }

  up(event) {
    const { drag } = this;
    const { several } = this.fingers;
    this.fingers.lift(event);
    this.panning = null;
    if (!drag || several) return;
    this.move(event);
    this.drag = null;
    if (drag.kind === "draw" && drag.now && largeEnough(drag.now)) this.finish(drag.now, null);
    else if (drag.kind !== "draw" && drag.now) this.finish(drag.now, drag.id);
    else {
      this.on.select(this.objectAt(drag.from));
      this.on.release();
    }
    this.draw();
  }

  cancel() {
    this.drag = this.draft = null;
    this.on.release();
    this.draw();
  }

  objectAt(point) {
    const hit = this.model.results()
      .filter((found) => contains(found.box_xywh, point))
      .sort((a, b) => a.box_xywh[2] * a.box_xywh[3] - b.box_xywh[2] * b.box_xywh[3]);
    return hit.length ? hit[0].object : null;
  }

  finish(exact, id) {
    const box = exact.map((v) => Math.round(v * 100) / 100); // pixels of the video; for people to read
    if (id !== null) this.on.changed(id, box);
    else this.on.drawn(box);
  }

  // Keyboard

  /** Begin a box that the arrow keys move: of an object, or a new one in the middle. */
  beginDraft(id = null) {
    if (!this.model.ready) return;
    this.on.hold();
    const [width, height] = this.size;
    const box = this.model.box(id) ?? [width * 0.375, height * 0.3, width * 0.25, height * 0.4];
    this.draft = { box: [...box], id };
    this.element.focus();
    this.on.draft();
    this.draw();
  }

  /** Whether the key was for the draft. */
  key(event) {
    if (!this.draft) return false;
    const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (by) {
      const step = event.altKey ? 1 : Math.max(1, this.size[0] / 80 / this.zoom);
      const [dx, dy] = by.map((sign) => sign * step);
      this.draft.box = event.shiftKey ? resized(this.draft.box, "se", dx, dy, this.size)
        : moved(this.draft.box, dx, dy, this.size);
    } else if (event.key === "Enter") {
      const { box, id } = this.draft;
      this.draft = null;
      this.finish(box, id);
    } else if (event.key === "Escape") {
      this.cancel();
      this.on.say("Box given up.");
      return true;
    } else {
      return event.key === " "; // no tracking with a box half made
    }
    this.on.draft();
    this.draw();
    return true;
  }

  // Drawing

  draw() {
    const canvas = this.overlay;
    const ratio = devicePixelRatio || 1;
    const [width, height] = [this.element.clientWidth, this.element.clientHeight];
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    const k = width / this.size[0] * this.zoom; // CSS pixels per pixel of the video
    const changing = this.drag?.now ? this.drag.id : this.draft?.id;
    for (const found of this.model.results()) {
      const { colour } = this.model.object(found.object) ?? {};
      if (!colour) continue;
      this.drawTrail(pen, found.object, colour, k);
      if (found.object === changing) continue;
      const selected = found.object === this.model.selected;
      this.drawBox(pen, this.onScreen(found.box_xywh, k), colour, found.status, selected);
      this.drawLabel(pen, found, colour, k, width);
    }
    const now = this.drag?.now ?? this.draft?.box;
    if (now) {
      const owner = this.model.object(changing ?? this.model.redrawing);
      this.drawBox(pen, this.onScreen(now, k), owner?.colour ?? "#ffffff", "tracked", true);
    }
  }

  onScreen([x, y, w, h], k) {
    return [(x - this.corner[0]) * k, (y - this.corner[1]) * k, w * k, h * k];
  }

  drawTrail(pen, id, colour, k) {
    const last = this.model.shown;
    let before = null;
    pen.strokeStyle = colour;
    pen.lineWidth = 2;
    pen.lineCap = "round";
    for (let index = last - TRAIL; index <= last; index++) {
      const found = this.model.results(index).find((each) => each.object === id);
      const centre = found && found.status !== "lost"
        ? handlePoint(this.onScreen(found.box_xywh, k), "") : null;
      if (before && centre) {
        pen.globalAlpha = 0.15 + 0.65 * (index - last + TRAIL) / TRAIL;
        pen.beginPath();
        pen.moveTo(...before);
        pen.lineTo(...centre);
        pen.stroke();
      }
      before = centre;
    }
    pen.globalAlpha = 1;
  }

  drawBox(pen, [x, y, w, h], colour, status, selected) {
    const lost = status === "lost";
    const line = lost ? "#b4b4b4" : colour;
    pen.setLineDash([]);
    pen.lineWidth = selected ? 5 : 4;
    pen.strokeStyle = "rgba(0, 0, 0, .65)";
    pen.strokeRect(x, y, w, h);
    pen.setLineDash(status === "tracked" ? [] : [7, 5]);
    pen.lineWidth = selected ? 3 : 2;
    pen.strokeStyle = line;
    pen.strokeRect(x, y, w, h);
    if (lost) {
      pen.beginPath();
      pen.moveTo(x, y);
      pen.lineTo(x + w, y + h);
      pen.moveTo(x, y + h);
      pen.lineTo(x + w, y);
      pen.stroke();
    }
    pen.setLineDash([]);
    if (!selected) return;
    for (const handle of HANDLES) {
      // The handles of a small box would hide what is in it.
      if (handle.length === 1 && (handle === "n" || handle === "s" ? w : h) < ROOM) continue;
      const side = Math.min(w, h) < ROOM ? 5 : 8;
      const [px, py] = handlePoint([x, y, w, h], handle);
      pen.fillStyle = "#ffffff";
      pen.strokeStyle = "#000000";
      pen.lineWidth = 1;
      pen.fillRect(px - side / 2, py - side / 2, side, side);
      pen.strokeRect(px - side / 2, py - side / 2, side, side);
    }
  }

  drawLabel(pen, found, colour, k, width) {
    const whole = this.model.object(found.object).name;
    const name = whole.length > NAME_LENGTH ? `${whole.slice(0, NAME_LENGTH - 1)}…` : whole;
    const score = found.score === null ? "" : ` ${found.score.toFixed(2)}`;
    const text = `${name}${score}${found.status === "tracked" ? "" : ` ${found.status}`}`;
    pen.font = "600 13px system-ui, sans-serif";
    const plate = Math.min(pen.measureText(text).width + 10, width);
    const [x, y, w, h] = this.onScreen(found.box_xywh, k);
    if (x + w < 0 || y + h < 0 || x > width || y > this.element.clientHeight) return;
    const left = Math.min(Math.max(0, x - 1), width - plate);
    const below = Math.max(0, Math.min(y + h + 2, this.element.clientHeight - 20));
    // Of a box larger than what is shown the label is in its corner.
    const top = y - 22 >= 0 ? y - 22 : this.zoom > 1 && below < y + h ? Math.max(0, y) : below;
    pen.fillStyle = found.status === "lost" ? "#b4b4b4" : colour;
    pen.fillRect(left, top, plate, 20);
    pen.fillStyle = dark(pen.fillStyle) ? "#ffffff" : "#141414";
    pen.fillText(text, left + 5, top + 15, plate - 8);
  }
}

function dark(css) {
  const [r, g, b] = [1, 3, 5].map((at) => parseInt(css.slice(at, at + 2), 16) / 255)
    .map((v) => (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b < 0.18;
}
