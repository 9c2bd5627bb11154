// The first screen: sample clip, a file, the webcam.

import { CANCELLED, request, upload } from "./api.js";
import { openCamera } from "./camera.js";

const $ = (id) => document.getElementById(id);

/** `on.begin(session, camera)` once there is a session; `on.problem(text)`. */
export class StartScreen {
  constructor(about, on) {
    this.about = about;
    this.on = on;
    this.busy = false;
    const { limits, samples } = about;
    $("limits").textContent = `Videos up to ${limits.upload_mb} MB, ${minutes(limits.duration_s)}, `
      + `${limits.width} × ${limits.height} pixels.`;
    $("sample").hidden = !samples.length;
    if (samples.length) $("credit").textContent = `Sample clip: ${samples[0].credit}.`;
    $("busy-cancel").addEventListener("click", () => this.cancelling?.abort());
    $("sample").addEventListener("click", () => this.fromSample(samples[0].name));
    $("choose").addEventListener("click", () => $("file").click());
    $("file").addEventListener("change", () => this.fromFile($("file").files[0]));
    $("camera").addEventListener("click", () => this.fromCamera());
    for (const id of ["sample", "choose", "camera"]) $(id).disabled = false;
    addEventListener("dragover", (event) => {
      if (!event.dataTransfer.types.includes("Files")) return;
      event.preventDefault();
      document.body.classList.add("over");
    });
    addEventListener("dragleave", (event) => {
      if (!event.relatedTarget) document.body.classList.remove("over");
    });
    addEventListener("drop", (event) => {
      if (!event.dataTransfer.files.length) return;
      event.preventDefault();
      document.body.classList.remove("over");
      this.fromFile(event.dataTransfer.files[0]);
    });
    this.fromFile($("file").files[0]); // chosen before the server had answered
  }

  fromSample(name) {
    return this.work("Opening the sample clip …", () =>
      request("POST", "/api/sessions", { source: "sample", name }));
  }

  fromFile(file) {
    if (!file) return undefined;
    const most = this.about.limits.upload_mb;
    return this.work(`Uploading ${file.name} …`, async () => {
      if (file.size > most * 1e6) {
        throw new Error(`${file.name} has ${(file.size / 1e6).toFixed(0)} MB; this server takes `
          + `${most} MB at most. Shorten it or make it smaller, or start the server with a larger `
          + "--max-upload.");
      }
      const session = await request("POST", "/api/sessions", { source: "upload", name: file.name });
      const at = `/api/sessions/${session.id}`;
      const { signal } = this.cancelling;
      try {
        return await upload(`${at}/video`, file, (part) => {
          $("busy-text").textContent = part === 1 ? "Opening the video …"
            : `Uploading ${file.name}: ${Math.floor(100 * part)} % of ${megabytes(file.size)}`;
          if (part === 1) $("busy-bar").removeAttribute("value");
          else $("busy-bar").value = part;
        }, signal);
      } catch (error) {
        // What is half there makes room at once.
        if (signal.aborted) await request("DELETE", at).catch(() => {});
        throw error;
      }
    });
  }

  fromCamera() {
    let camera = null;
    return this.work("Waiting for the camera; the browser may ask you …", async () => {
      camera = await openCamera();
      try {
        return await request("POST", "/api/sessions", { source: "camera", name: "webcam" });
      } catch (error) {
        camera.stop();
        throw error;
      }
    }, () => camera);
  }

  async work(text, make, camera = () => null) {
    if (this.busy) return;
    this.busy = true;
    this.cancelling = new AbortController();
    this.on.problem("");
    $("busy-text").textContent = text;
    $("busy-bar").removeAttribute("value");
    $("busy").hidden = false;
    $("busy-cancel").hidden = !text.startsWith("Uploading");
    try {
      this.on.begin(await make(), camera());
    } catch (error) {
      if (error.message !== CANCELLED) this.on.problem(error.message);
    } finally {
      this.busy = false;
      this.cancelling = null;
      $("file").value = "";
      $("busy").hidden = true;
    }
  }
}

function megabytes(size) {
  return `${(size / 1e6).toFixed(size < 1e7 ? 1 : 0)} MB`;
}

function minutes(seconds) {
  return seconds % 60 ? `${seconds} seconds` : `${seconds / 60} minutes`;
}
