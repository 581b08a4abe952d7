// Audio and haptic output: the browser's own voice or a screen reader's live regions, short sounds, vibration.
//
// Each message is announced once, by the voice or by the screen reader, never by both. At most one line waits; it is
// dropped when it is old, when a more urgent one arrives, or when its reason no longer holds.

// Synthesised earcons: tones of [frequency in Hz, start and duration in s, amplitude].
const SOUNDS = {
  'on-course': [[880, 0, 0.05, 0.15]],
  'off-course': [[330, 0, 0.12, 0.4], [262, 0.14, 0.16, 0.4]],
  turn: [[660, 0, 0.09, 0.4], [880, 0.1, 0.09, 0.4]],
  // Deeper by 1.5 octaves for each half turn that is left.
  turning: [[1047, 0, 0.07, 0.2]],
  waypoint: [[988, 0, 0.12, 0.3]],
  arrival: [[523, 0, 0.15, 0.4], [659, 0.16, 0.15, 0.4], [784, 0.32, 0.3, 0.4]],
  stop: [[196, 0, 0.18, 0.6], [196, 0.25, 0.18, 0.6]],
};
// Milliseconds of vibration and pause. Left is two short pulses, right is three, around is one long one; stop is
// clearly different.
const SHAKES = { left: [80, 80, 80], right: [80, 80, 80, 80, 80], around: [500], stop: [300, 100, 300, 100, 300], arrival: [100, 60, 100, 60, 400] };

// A line waits at most this long for the voice; the same text within SAME_MS counts as one message.
const WAIT_MS = 2000;
const SAME_MS = 1500;
// A screen reader does not say when it has read the name of a note.
const READ_MS = 3000;

export class Senses {
  constructor({ polite, urgent }) {
    Object.assign(this, { polite, urgent, told: 'voice', language: 'en', rate: 1.1, volume: 1, sounds: true, vibrate: true });
    Object.assign(this, { speaking: null, waiting: null, said: { text: '', at: -Infinity }, urgentAt: -Infinity });
    setInterval(() => this.next(), 100);
  }

  set(name, value) {
    this[name] = value;
    if (name === 'told' && value !== 'voice') this.hush();
  }

  hush() {
    [this.speaking, this.waiting] = [null, null];
    window.speechSynthesis?.cancel();
  }

  // The reason of these messages no longer holds: those being spoken are stopped, those waiting are dropped.
  drop(kind) {
    if (this.waiting?.kind === kind) this.waiting = null;
    if (this.speaking?.kind === kind) {
      this.speaking = null;
      window.speechSynthesis?.cancel();
    }
    for (const region of [this.polite, this.urgent]) if (region.dataset.kind === kind) region.textContent = '';
  }

  // Browsers play no sound until the user has touched the page.
  wake() {
    if (!this.audio) {
      try {
        this.audio = new AudioContext();
      } catch {
        this.audio = null;
      }
      if (window.speechSynthesis && this.told === 'voice') speechSynthesis.speak(new SpeechSynthesisUtterance(''));
    }
    this.audio?.resume();
  }

  // `after` is called once the text has been heard to its end; `tooOld` says of one that waited whether it may not be said any more.
  say({ text, priority, interrupts, turn_rad, kind, language, after, tooOld }) {
    const now = performance.now();
    if (text === this.said.text && now - this.said.at < SAME_MS) return;
    this.said = { text, at: now };
    if (priority === 0) {
      this.urgentAt = now;
      this.shake('stop');
    } else if (typeof turn_rad === 'number' && priority === 1) this.shake(Math.abs(turn_rad) > 2.6 ? 'around' : turn_rad > 0 ? 'left' : 'right');
    const line = { text, priority, kind: kind ?? '', at: now, language: language ?? this.language, after, tooOld };
    if (this.told === 'reader') {
      this.show(line);
      if (after) setTimeout(after, READ_MS);
    } else if (this.told === 'voice' && window.speechSynthesis) this.queue(line, interrupts || priority === 0);
  }

  show({ text, priority, kind, language }) {
    const region = priority <= 1 ? this.urgent : this.polite;
    // What is outside of an open dialog is not read.
    const home = [...document.querySelectorAll('dialog[open]')].pop() ?? document.body;
    if (region.isConnected && region.parentNode !== home) home.append(region);
    region.dataset.kind = kind;
    region.lang = language;
    // A repeated text must still be a change, or the screen reader does not read it.
    region.textContent = region.textContent === text ? `${text}\u00a0` : text;
  }

  queue(line, now) {
    if (now || !this.speaking) this.speak(line);
    else if (!this.waiting || line.priority <= this.waiting.priority || line.at - this.waiting.at > WAIT_MS) this.waiting = line;
  }

  speak(line) {
    speechSynthesis.cancel();
    [this.speaking, this.waiting] = [line, null];
    const words = new SpeechSynthesisUtterance(line.text);
    [words.rate, words.volume, words.lang] = [this.rate, this.volume, line.language];
    words.onend = () => {
      if (this.speaking !== line) return;
      this.speaking = null;
      line.after?.();
    };
    words.onerror = words.onend;
    // Not every browser reports the end of speech: two words a second is a slow voice.
    line.until = performance.now() + 2000 + (500 * line.text.split(' ').length) / this.rate;
    speechSynthesis.speak(words);
  }

  next() {
    const now = performance.now();
    if (this.speaking && now > this.speaking.until) this.speaking = null;
    if (this.speaking || !this.waiting) return;
    const line = this.waiting;
    this.waiting = null;
    if (now - line.at <= WAIT_MS && !line.tooOld?.()) this.speak(line);
  }

  shake(name) {
    if (this.vibrate && navigator.vibrate && navigator.userActivation?.hasBeenActive !== false) navigator.vibrate(SHAKES[name]);
  }

  // An earcon from its direction: bearing in radians, positive to the left.
  sound(name, bearing) {
    if (name === 'arrival') this.shake('arrival');
    if (!this.sounds || !this.audio || this.told === 'silent' || this.volume === 0) return;
    const pan = this.audio.createStereoPanner();
    pan.pan.value = -Math.sin(bearing || 0);
    pan.connect(this.audio.destination);
    const now = this.audio.currentTime + 0.01;
    const pitch = name === 'turning' ? 2 ** (-1.5 * Math.min(Math.abs(bearing), Math.PI) / Math.PI) : 1;
    for (const [frequency, begin, length, loud] of SOUNDS[name] ?? []) {
      const wave = this.audio.createOscillator();
      const gain = this.audio.createGain();
      wave.frequency.value = frequency * pitch;
      gain.gain.setValueAtTime(0, now + begin);
      gain.gain.linearRampToValueAtTime(loud * this.volume, now + begin + 0.01);
      gain.gain.linearRampToValueAtTime(0, now + begin + length);
      wave.connect(gain).connect(pan);
      wave.start(now + begin);
      wave.stop(now + begin + length + 0.02);
    }
  }
}
