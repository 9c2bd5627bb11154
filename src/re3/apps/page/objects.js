// The list of objects: name, colour, score, and what can be done with each.

/** `on.rename(id, name)` (throws what is wrong), `on.recolour`, `on.redraw`, `on.end`, `on.remove`,
 *  `on.select`. */
export class ObjectList {
  constructor(list, none, model, on) {
    this.list = list;
    this.none = none;
    this.model = model;
    this.on = on;
    this.rows = new Map();
  }

  /** Bring the rows up to the objects there are. */
  update() {
    const ids = new Set(this.model.objects.map((each) => each.id));
    for (const [id, row] of this.rows) {
      if (ids.has(id)) continue;
      const focused = row.item.contains(document.activeElement);
      row.item.remove();
      this.rows.delete(id);
      if (focused) document.getElementById("stage").focus();
    }
    for (const object of this.model.objects) {
      const row = this.rows.get(object.id) ?? this.build(object.id);
      if (document.activeElement !== row.name) row.name.value = object.name;
      row.name.title = object.name;
      row.colour.value = object.colour;
      row.item.style.setProperty("--colour", object.colour);
      row.item.classList.toggle("selected", object.id === this.model.selected);
      row.name.setAttribute("aria-label", `Name of ${object.name}`);
      row.colour.setAttribute("aria-label", `Colour of ${object.name}`);
      for (const [button, verb] of row.buttons) button.setAttribute("aria-label", `${verb} ${object.name}`);
    }
    this.none.hidden = ids.size > 0;
    this.updateScores();
  }

  /** What was found in the frame shown. */
  updateScores() {
    for (const [id, row] of this.rows) {
      const found = this.model.result(id);
      row.status.textContent = this.status(this.model.object(id), found);
      row.item.classList.toggle("lost", found?.status === "lost");
    }
  }

  status(object, found) {
    const { shown } = this.model;
    if (object.given.includes(shown)) return "drawn here";
    if (!found && shown < object.first) return `from frame ${object.first} on`;
    if (!found) return this.model.follows(object) ? "not tracked yet" : "ended";
    return found.score === null ? found.status : `${found.score.toFixed(2)} ${found.status}`;
  }

  build(id) {
    const item = make("li", { className: "object" });
    const line = make("div", { className: "object-row" });
    const colour = make("input", { type: "color" });
    const name = make("input", { type: "text", maxLength: 80, spellcheck: false });
    const status = make("span", { className: "status" });
    const problem = make("p", { className: "problem", hidden: true });
    problem.setAttribute("role", "alert");
    line.append(colour, name, status);
    const keys = make("div", { className: "object-buttons" });
    const buttons = [
      ["Redraw", "Draw its box anew in this frame", () => this.on.redraw(id)],
      ["End here", "Keep its boxes before this frame; from here on it is not followed, until a box that is drawn later",
        () => this.on.end(id)],
      ["Remove", "Forget it and all its boxes", () => this.on.remove(id)],
    ].map(([verb, title, act]) => {
      const button = make("button", { type: "button", textContent: verb, title });
      button.dataset.verb = verb;
      button.addEventListener("click", act);
      keys.append(button);
      return [button, verb];
    });
    item.append(line, keys, problem);
    item.addEventListener("pointerdown", () => this.on.select(id));
    colour.addEventListener("change", () => this.on.recolour(id, colour.value));
    name.addEventListener("change", async () => {
      const wrong = await this.on.rename(id, name.value);
      problem.textContent = wrong ?? "";
      problem.hidden = !wrong;
      if (wrong) name.value = this.model.object(id)?.name ?? "";
    });
    name.addEventListener("keydown", (event) => {
      if (event.key === "Enter") name.blur();
      event.stopPropagation();
    });
    this.list.append(item);
    const row = { item, name, colour, status, buttons };
    this.rows.set(id, row);
    return row;
  }

  /** Let the name be typed. */
  focusName(id) {
    this.rows.get(id)?.name.select();
  }
}

function make(tag, properties) {
  return Object.assign(document.createElement(tag), properties);
}
