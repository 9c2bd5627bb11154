// The server, as the page sees it: REST requests, and the WebSocket of a session.

export class ServerError extends Error {
  constructor(message, status) {
    super(message);
    this.status = status;
  }
}

const NO_ANSWER = "The server does not answer. Is re3 serve still running?";

/** A REST request; its JSON. Throws ServerError with what the server says. */
export async function request(method, path, body) {
  const options = { method };
  if (body !== undefined) {
    options.body = JSON.stringify(body);
    options.headers = { "Content-Type": "application/json" };
  }
  let answer;
  try {
    answer = await fetch(path, options);
  } catch {
    throw new ServerError(NO_ANSWER, 0);
  }
  if (!answer.ok) throw new ServerError(await detail(answer), answer.status);
  return answer.status === 204 ? null : answer.json();
}

async function detail(answer) {
  const told = await answer.json().catch(() => ({}));
  return told.detail ?? `The server answered ${answer.status}.`;
}

/** The message of what was cancelled; nobody need be told of it. */
export const CANCELLED = "Cancelled.";

/** Upload a file as the body of a request, telling of progress from 0 to 1; `signal` cancels it. */
export function upload(path, file, onProgress, signal) {
  return new Promise((resolve, reject) => {
    const sending = new XMLHttpRequest(); // fetch does not tell how far an upload is
    sending.open("PUT", path);
    sending.upload.onprogress = (event) => onProgress(event.loaded / Math.max(1, event.total));
    sending.onabort = () => reject(new ServerError(CANCELLED, 0));
    signal.addEventListener("abort", () => sending.abort());
    sending.onerror = () => reject(new ServerError(
      "The upload broke off: the server refused it or has stopped. Is the file too large?", 0));
    sending.onload = () => {
      let told = {};
      try {
        told = JSON.parse(sending.responseText);
      } catch { /* told below */ }
      if (sending.status < 300) resolve(told);
      else reject(new ServerError(told.detail ?? `The server answered ${sending.status}.`, sending.status));
    };
    sending.send(file);
  });
}

/** Download what takes a while to make; [its name, its content]. Aborting the signal cancels it. */
export async function download(path, signal) {
  let answer;
  try {
    answer = await fetch(path, { signal });
    if (!answer.ok) throw new ServerError(await detail(answer), answer.status);
    const said = answer.headers.get("Content-Disposition") ?? "";
    const [, starred] = said.match(/filename\*=utf-8''([^;]+)/i) ?? [];
    const [, plain] = said.match(/filename="([^"]+)"/) ?? [];
    return [starred ? decodeURIComponent(starred) : plain ?? "download", await answer.blob()];
  } catch (error) {
    if (error instanceof ServerError) throw error;
    throw new ServerError(signal.aborted ? CANCELLED : NO_ANSWER, 0);
  }
}

const RETRY_MS = 1500;

/** The WebSocket of a session; connects again by itself. Calls `on.message`, `on.lost`, `on.back`. */
export class Stream {
  constructor(sessionId, on) {
    this.on = on;
    this.over = false;
    this.url = new URL(`/api/sessions/${sessionId}/stream`, location.href);
    this.url.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    this.connect();
  }

  connect() {
    const socket = this.socket = new WebSocket(this.url);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => this.on.back();
    socket.onmessage = ({ data }) => {
      if (typeof data === "string") this.on.message(JSON.parse(data), null);
      else this.on.message(...unpacked(data));
    };
    socket.onclose = () => {
      if (this.over) return;
      this.on.lost();
      setTimeout(() => this.over || this.connect(), RETRY_MS);
    };
  }

  get open() {
    return this.socket.readyState === WebSocket.OPEN;
  }

  /** Whether it could be sent. */
  send(command) {
    if (!this.open) return false;
    this.socket.send(command instanceof Blob ? command : JSON.stringify(command));
    return true;
  }

  close() {
    this.over = true;
    this.socket.close();
  }
}

function unpacked(data) {
  const size = new DataView(data).getUint32(0);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, size)));
  return [head, new Blob([new Uint8Array(data, 4 + size)], { type: "image/jpeg" })];
}
