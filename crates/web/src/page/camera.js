// The phone's camera and motion sensors: images with their time, and motion in the image axes.

// Motion is sent in batches of this many readings. Images wait for a batch, so batches are small. While the link is
// congested the newest readings are kept, two seconds of them.
const PARCEL = 2;
const KEPT = 120;

// Apple's phones report acceleration with gravity in the opposite sign of the standard; an iPad calls itself a Macintosh, of which
// none has a touch screen.
export function gravitySign({ userAgent, maxTouchPoints }) {
  const isApple = /iPhone|iPad|iPod/.test(userAgent) || (/Macintosh/.test(userAgent) && maxTouchPoints > 1);
  return isApple ? -1 : 1;
}

export class Camera {
  // `pace` decides when and how an image is sent, `coding` makes bytes of it; `clogged` reports whether sent data still waits on
  // this side.
  constructor(video, { image, motion, pace, coding, clogged, ended }) {
    Object.assign(this, { video, image, motion, pace, coder: coding, clogged, ended, running: false, coding: false, parcel: [] });
    Object.assign(this, { canvas: document.createElement('canvas'), light: Object.assign(document.createElement('canvas'), { width: 16, height: 12 }) });
    window.addEventListener('devicemotion', (event) => this.running && this.moved(event));
    document.addEventListener('visibilitychange', () => this.back());
  }

  // Asks for camera and motion; must be called from a tap or a key press, as phones require.
  async start() {
    const ask = window.DeviceMotionEvent?.requestPermission;
    if (ask) await ask.call(DeviceMotionEvent).catch(() => 'denied');
    const wish = { facingMode: 'environment', width: { ideal: 640 }, height: { ideal: 480 }, frameRate: { ideal: 30 } };
    const stream = await navigator.mediaDevices.getUserMedia({ video: wish, audio: false });
    [this.track] = stream.getVideoTracks();
    this.track.onended = () => this.lost();
    this.video.srcObject = stream;
    await this.video.play();
    this.running = true;
    this.stayAwake();
    if (!this.shoots) this.next();
    this.shoots = true;
  }

  // The camera was taken away. In a hidden page that is a call or the lock, and it is asked for again once the page is seen.
  lost() {
    if (document.visibilityState !== 'visible') return;
    this.running = false;
    this.ended();
  }

  back() {
    if (!this.running || document.visibilityState !== 'visible') return;
    this.stayAwake();
    if (this.track.readyState === 'ended') this.start().catch(() => this.lost());
  }

  // The screen may be dark, but the phone must not go to sleep.
  async stayAwake() {
    this.lock = await navigator.wakeLock?.request('screen').catch(() => null);
  }

  // The mean gray of what the camera sees.
  meanGray() {
    const { width, height } = this.light;
    const context = this.light.getContext('2d', { alpha: false, willReadFrequently: true });
    context.drawImage(this.video, 0, 0, width, height);
    const { data } = context.getImageData(0, 0, width, height);
    return data.reduce((sum, value, k) => sum + (k % 4 === 3 ? 0 : value), 0) / (3 * width * height);
  }

  next() {
    if (this.video.requestVideoFrameCallback) {
      this.video.requestVideoFrameCallback((now, data) => {
        this.next();
        this.shoot(data.captureTime > 0 && data.captureTime <= now ? data.captureTime : now);
      });
    } else {
      setInterval(() => this.shoot(performance.now()), 50);
    }
  }

  // Captures, encodes and sends one image; none while the previous one is on its way, so that the newest is sent next.
  async shoot(at) {
    if (this.coding || !this.pace.mayShoot(performance.now())) return;
    const { videoWidth: w, videoHeight: h } = this.video;
    if (!w) return;
    const scale = Math.min(1, this.pace.side / Math.max(w, h));
    const [cw, ch] = [Math.round(w * scale), Math.round(h * scale)];
    if (this.canvas.width !== cw || this.canvas.height !== ch) [this.canvas.width, this.canvas.height] = [cw, ch];
    this.canvas.getContext('2d', { alpha: false, willReadFrequently: this.coder.readsBack }).drawImage(this.video, 0, 0, cw, ch);
    this.coding = true;
    const stamp = performance.timeOrigin + at;
    const bytes = await this.coder.code(this.canvas, stamp, this.pace.quality);
    this.coding = false;
    if (bytes) this.image(stamp, bytes);
  }

  // The device's axes (W3C: x right, y up, z out of the screen) into the image axes: x right, y down, z into the
  // scene, for the rear camera; the image turns with the screen.
  moved(event) {
    const { accelerationIncludingGravity: a, rotationRate: g } = event;
    if (!a || !g || a.x === null || g.alpha === null) return;
    const turn = ((screen.orientation?.angle ?? 0) * Math.PI) / 180;
    const [c, s] = [Math.cos(turn), Math.sin(turn)];
    const sign = gravitySign(navigator);
    const axes = (x, y, z) => [c * x + s * y, -(c * y - s * x), -z];
    const rad = Math.PI / 180;
    // rotationRate: alpha about z, beta about x, gamma about y, degrees a second.
    const rate = axes(g.beta * rad, g.gamma * rad, g.alpha * rad);
    this.parcel.push([performance.timeOrigin + event.timeStamp, ...rate, ...axes(sign * a.x, sign * a.y, sign * a.z)]);
    if (this.parcel.length > KEPT) this.parcel.shift();
    if (this.parcel.length >= PARCEL && !this.clogged()) this.motion(this.parcel.splice(0));
  }
}
