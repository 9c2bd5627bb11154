// The line above the picture: what to do next, for those with a keyboard and for those without.

const TOUCH = matchMedia("(hover: none) and (pointer: coarse)");
const press = (button) => (TOUCH.matches ? `Tap ${button}` : "Press Space");

/** What to do next, given the second screen. */
export function hint({ model, camera, connected, stage, playLabel }) {
  const { session } = model;
  if (!session.ready) return camera ? "Waiting for the camera …" : "This session is over.";
  if (!connected) return "Waiting for the server …";
  if (stage.draft) return ofDraft(stage.draft.box);
  const redrawn = model.object(model.redrawing);
  if (redrawn) return `Draw a box around ${redrawn.name}.`;
  if (model.adding) return "Draw a box around the new object.";
  const lost = model.objects.filter((each) => model.result(each.id)?.status === "lost");
  if (lost.length) {
    return `${lost.map((each) => each.name).join(", ")}: lost. `
      + `${TOUCH.matches ? "Tap" : "Press"} Redraw and draw a box${session.ended ? "" : ", or go on"}.`;
  }
  if (!model.objects.length) return first(session, camera);
  if (session.source === "select") return "Draw more boxes, or press Enter to track in the terminal.";
  if (session.broken && session.ended) return `The video ends here: ${session.broken}`;
  if (session.playing || camera?.running) {
    const known = !camera && model.position < session.tracked_until;
    return `${known ? "Playing" : "Tracking"}. ${press("Pause")} to pause.`;
  }
  if (model.unknown.length && !camera) {
    return `Not tracked up to here. ${press(playLabel)} to track, or draw a box.`;
  }
  if (session.ended) {
    return model.anyLost ? "The end of the video. Lost where the chart is red: go there and redraw."
      : "The end of the video. Download the boxes, or go back and correct them.";
  }
  if (!camera && model.position === session.start && session.tracked_until === session.start) {
    return `${press("Track")} to track. Or draw more boxes.`;
  }
  const correct = model.box(model.selected) ? "Drag the box or its corners"
    : `${TOUCH.matches ? "Tap" : "Click"} a box`;
  return `Paused. ${correct} to correct it. ${press(playLabel)} to go on.`;
}

/** While there is no object. */
function first(session, camera) {
  if (session.ended) return "The end. Go back, and draw a box around something.";
  if (session.playing) return "Draw a box as soon as there is something to track.";
  const text = "Draw a box around something to track";
  if (camera || session.source === "select") return `${text}.`;
  return `${text}, or ${TOUCH.matches ? "tap Play" : "press Space"} to get to it.`;
}

/** While a box is made with the keyboard. */
function ofDraft(box) {
  const [x, y, w, h] = box.map(Math.round);
  return `${w} by ${h} pixels at ${x}, ${y}. Arrows move the box, Shift with arrows changes its size, `
    + "Enter accepts it, Esc gives it up.";
}
