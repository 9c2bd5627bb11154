// Frames of the webcam, never more than two in flight: what comes meanwhile is not sent at all.

const IN_FLIGHT = 2;
const QUALITY = 0.9;
const WIDTH = 960;

/** Why there is no picture, for people. */
const WHY = {
  NotAllowedError: "The browser may not use the camera. Allow it for this page, and try again.",
  NotFoundError: "No camera was found. Plug one in, or choose a video.",
  NotReadableError: "The camera is in use by another program. Close that, and try again.",
};

export async function openCamera() {
  if (!navigator.mediaDevices) {
    throw new Error("Browsers give the camera to secure pages only: open this page as "
      + "http://127.0.0.1 or http://localhost, or behind HTTPS.");
  }
  try {
    const media = await navigator.mediaDevices.getUserMedia(
      { video: { width: { ideal: WIDTH }, facingMode: "environment" }, audio: false });
    const video = document.createElement("video");
    video.muted = video.playsInline = true;
    video.srcObject = media;
    await video.play();
    return new Camera(media, video);
  } catch (error) {
    throw new Error(WHY[error.name] ?? `The camera cannot be used: ${error.message}`);
  }
}

export class Camera {
  constructor(media, video) {
    this.media = media;
    this.video = video;
    this.running = false;
    this.number = 0; // of the next frame, as the server counts them
    this.sent = new Map(); // number -> {image, at}
    this.most = 0; // ever in flight, for tests
  }

  /** Send frames as they come, by `send(blob)`, which says whether it could; `onEnd()` where the camera goes away. */
  start(send, onEnd) {
    this.send = send;
    this.media.getVideoTracks()[0].addEventListener("ended", onEnd);
    this.running = true;
    const next = async () => {
      if (!this.media.active) return;
      if (this.running && this.sent.size < IN_FLIGHT) await this.grab();
      if (this.video.requestVideoFrameCallback) this.video.requestVideoFrameCallback(next);
      else setTimeout(next, 33);
    };
    next();
  }

  async grab() {
    const { videoWidth: width, videoHeight: height } = this.video;
    if (!width) return;
    const at = performance.now();
    const canvas = document.createElement("canvas");
    canvas.width = width;
    canvas.height = height;
    canvas.getContext("2d").drawImage(this.video, 0, 0);
    const blob = await new Promise((resolve) => canvas.toBlob(resolve, "image/jpeg", QUALITY));
    if (!blob || !this.running || this.sent.size >= IN_FLIGHT) return;
    if (!this.send(blob)) return;
    this.sent.set(this.number++, { image: canvas, at });
    this.most = Math.max(this.most, this.sent.size);
  }

  /** The frame with that number is answered: its picture, and how long that took; or null. */
  answered(number) {
    const frame = this.sent.get(number);
    this.sent.delete(number);
    return frame ? { image: frame.image, ms: performance.now() - frame.at } : null;
  }

  /** After the connection was lost: the server counts anew. */
  restart() {
    this.sent.clear();
    this.number = 0;
  }

  stop() {
    this.running = false;
    for (const track of this.media.getTracks()) track.stop();
  }
}
