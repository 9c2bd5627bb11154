// Boxes being drawn or changed, in pixels of the video: [x, y, width, height].

export const SMALLEST = 3;
export const HANDLES = ["nw", "n", "ne", "e", "se", "s", "sw", "w"];

/** The box between two points, inside the frame. */
export function between(a, b, size) {
  const [x0, x1] = [a[0], b[0]].map((v) => clamp(v, 0, size[0])).sort((p, q) => p - q);
  const [y0, y1] = [a[1], b[1]].map((v) => clamp(v, 0, size[1])).sort((p, q) => p - q);
  return [x0, y0, x1 - x0, y1 - y0];
}

export function largeEnough(box) {
  return box[2] >= SMALLEST && box[3] >= SMALLEST;
}

/** The box moved, kept inside the frame where it fits. */
export function moved(box, dx, dy, size) {
  const [x, y, w, h] = box;
  return [
    clamp(x + dx, Math.min(0, size[0] - w), Math.max(0, size[0] - w)),
    clamp(y + dy, Math.min(0, size[1] - h), Math.max(0, size[1] - h)), w, h];
}

/** The box with a side or corner dragged by so much. */
export function resized(box, handle, dx, dy, size) {
  let [left, top] = box;
  let [right, bottom] = [box[0] + box[2], box[1] + box[3]];
  if (handle.includes("w")) left = clamp(left + dx, 0, right - SMALLEST);
  if (handle.includes("e")) right = clamp(right + dx, left + SMALLEST, size[0]);
  if (handle.includes("n")) top = clamp(top + dy, 0, bottom - SMALLEST);
  if (handle.includes("s")) bottom = clamp(bottom + dy, top + SMALLEST, size[1]);
  return [left, top, right - left, bottom - top];
}

export function handlePoint([x, y, w, h], handle) {
  const across = handle.includes("w") ? 0 : handle.includes("e") ? 1 : 0.5;
  const down = handle.includes("n") ? 0 : handle.includes("s") ? 1 : 0.5;
  return [x + across * w, y + down * h];
}

/** The handle within reach of a point, or null. Inside a small box they reach less far, so that it
 *  can still be moved. */
export function handleAt(box, point, reach) {
  const near = (at, axis) => {
    const inside = point[axis] > box[axis] && point[axis] < box[axis] + box[axis + 2];
    return Math.abs(at - point[axis]) <= (inside ? Math.min(reach, box[axis + 2] / 4) : reach);
  };
  return HANDLES.find((handle) => handlePoint(box, handle).every(near)) ?? null;
}

export function contains([x, y, w, h], [px, py]) {
  return px >= x && py >= y && px <= x + w && py <= y + h;
}

export function clamp(value, low, high) {
  return Math.min(Math.max(value, low), Math.max(low, high));
}
