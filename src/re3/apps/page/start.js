// The first screen: sample clip, a file, the webcam.

import { request, upload } from "./api.js";
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
      return upload(`/api/sessions/${session.id}/video`, file, (part) => {
        $("busy-bar").value = part;
        if (part === 1) {
          $("busy-text").textContent = "Opening the video …";
          $("busy-bar").removeAttribute("value");
        }
      });
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
    this.on.problem($("start").hidden ? text : "");
    $("busy-text").textContent = text;
    $("busy-bar").removeAttribute("value");
    $("busy").hidden = false;
    $("or-drop").hidden = true;
    try {
      this.on.begin(await make(), camera());
    } catch (error) {
      this.on.problem(error.message);
    } finally {
      this.busy = false;
      $("file").value = "";
      $("busy").hidden = true;
      $("or-drop").hidden = false;
    }
  }
}

function minutes(seconds) {
  return seconds % 60 ? `${seconds} seconds` : `${seconds / 60} minutes`;
}
