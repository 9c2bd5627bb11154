// The scores over time, a line an object, a dot where it was drawn; click or arrow keys go to a frame,
// dragging looks through the video.

const PAD = 6;
const STILL = 4; // CSS pixels that a click may move

export class Chart {
  /** `seek(frame)` goes to a frame, tracking on the way; `look(frame)` only shows it. */
  constructor(canvas, model, seek, look) {
    this.canvas = canvas;
    this.model = model;
    this.wanted = false;
    let from = null; // where a pointer went down
    let scrubbing = false;
    canvas.addEventListener("pointerdown", (event) => {
      if (!event.isPrimary || event.button !== 0) return;
      [from, scrubbing] = [event.clientX, false];
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (from !== null && Math.abs(event.clientX - from) > STILL) scrubbing = true;
      if (scrubbing) look(this.frameAt(event));
      const frame = this.frameAt(event);
      const { fps } = this.model.session;
      canvas.title = this.model.live ? `Frame ${frame}` : `Frame ${frame}, ${(frame / fps).toFixed(1)} s`;
    });
    canvas.addEventListener("pointerup", (event) => {
      if (from !== null && !scrubbing) seek(this.frameAt(event));
      [from, scrubbing] = [null, false];
    });
    canvas.addEventListener("pointercancel", () => {
      [from, scrubbing] = [null, false];
    });
    canvas.addEventListener("keydown", (event) => {
      const last = this.length - 1;
      const to = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 }[event.key];
      const frame = { Home: 0, End: last }[event.key] ?? (to && this.model.position + to);
      if (frame === undefined) return;
      event.preventDefault();
      event.stopPropagation();
      seek(Math.min(Math.max(frame, 0), last));
    });
    new ResizeObserver(() => this.draw()).observe(canvas);
    document.addEventListener("themechange", () => this.draw());
  }

  get length() {
    return Math.max(this.model.frameCount, 2);
  }

  frameAt(event) {
    const area = this.canvas.getBoundingClientRect();
    const part = (event.clientX - area.left - PAD) / Math.max(1, area.width - 2 * PAD);
    return Math.round(Math.min(Math.max(part, 0), 1) * (this.length - 1));
  }

  /** Draw at the next chance, once for any number of calls. */
  update() {
    if (this.wanted) return;
    this.wanted = true;
    requestAnimationFrame(() => {
      this.wanted = false;
      this.draw();
    });
  }

  draw() {
    const canvas = this.canvas;
    const { position } = this.model;
    canvas.setAttribute("aria-valuemax", this.length - 1);
    canvas.setAttribute("aria-valuenow", position);
    canvas.setAttribute("aria-valuetext", `frame ${position} of ${this.length - 1}`);
    const ratio = devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width) return;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    const style = getComputedStyle(document.documentElement);
    const x = (frame) => PAD + frame / (this.length - 1) * (width - 2 * PAD);
    const y = (score) => height - PAD - score * (height - 2 * PAD);
    pen.strokeStyle = style.getPropertyValue("--line");
    pen.lineWidth = 1;
    for (const score of [0, 0.5, 1]) line(pen, [[PAD, y(score)], [width - PAD, y(score)]]);
    for (const object of this.model.objects) {
      let part = [];
      pen.strokeStyle = object.colour;
      pen.lineWidth = 2;
      const flush = () => {
        if (part.length === 1) part.push([part[0][0] + 1.5, part[0][1]]);
        line(pen, part);
        part = [];
      };
      for (const [index, found] of this.model.history(object.id)) {
        if (!found || found.score === null) flush();
        else part.push([x(index), y(found.score)]);
        if (found && object.given.includes(index)) {
          pen.fillStyle = object.colour;
          pen.beginPath();
          pen.arc(x(index), y(found.score ?? 1), 3.5, 0, 2 * Math.PI);
          pen.fill();
        }
        if (found?.status === "lost") {
          pen.fillStyle = style.getPropertyValue("--bad");
          pen.fillRect(x(index) - 1, height - 4, 2, 4);
        }
      }
      flush();
    }
    pen.strokeStyle = style.getPropertyValue("--text");
    pen.lineWidth = 1.5;
    line(pen, [[x(position), 0], [x(position), height]]);
  }
}

function line(pen, points) {
  if (points.length < 2) return;
  pen.beginPath();
  points.forEach((point, index) => (index ? pen.lineTo(...point) : pen.moveTo(...point)));
  pen.stroke();
}
