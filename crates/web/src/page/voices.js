// Notes in the walker's own voice: recorded with a landmark, kept in this browser, and played when the guide says the note's name.

// The longest such note.
const MOST_MS = 15000;

// The answer to one request of the browser's store.
async function ask(mode, request) {
  const answer = (asked) => new Promise((done, failed) => {
    asked.onsuccess = () => done(asked.result);
    asked.onerror = () => failed(asked.error);
  });
  const opening = indexedDB.open('cairn-voices', 1);
  opening.onupgradeneeded = () => opening.result.createObjectStore('voices');
  return answer(request((await answer(opening)).transaction('voices', mode).objectStore('voices')));
}

// Whether the guide's words are those of the note with this name: it begins them, and is no longer number.
export function isNamed(text, name) {
  return text.toLowerCase().startsWith(name.toLowerCase()) && !/^\d/.test(text.slice(name.length));
}

export class Voices {
  constructor() {
    Object.assign(this, { clips: new Map(), playing: null, recorder: null });
    // A private window keeps nothing.
    this.load().catch(() => {});
  }

  async load() {
    const [names, clips] = await Promise.all([ask('readonly', (s) => s.getAllKeys()), ask('readonly', (s) => s.getAll())]);
    names.forEach((name, k) => this.clips.set(name, clips[k]));
  }

  // Records until `end`; `done` takes what was recorded.
  async begin(done) {
    const stream = await navigator.mediaDevices.getUserMedia({ audio: true });
    const parts = [];
    this.recorder = new MediaRecorder(stream);
    this.recorder.ondataavailable = ({ data }) => parts.push(data);
    this.recorder.onstop = () => {
      stream.getTracks().forEach((track) => track.stop());
      done(new Blob(parts, { type: parts[0]?.type }));
      this.recorder = null;
    };
    this.recorder.start();
    setTimeout(() => this.end(), MOST_MS);
  }

  end() {
    if (this.recorder?.state === 'recording') this.recorder.stop();
  }

  // A name that no other note has.
  next() {
    const numbers = [...this.clips.keys()].map((name) => Number(/\d+$/.exec(name)?.[0] ?? 0));
    return Math.max(0, ...numbers) + 1;
  }

  keep(name, clip) {
    this.clips.set(name, clip);
    return ask('readwrite', (store) => store.put(clip, name));
  }

  // What plays the note that these words name, if they name one.
  named(text) {
    const [, clip] = [...this.clips].find(([name]) => isNamed(text, name)) ?? [];
    return clip && (() => {
      this.hush();
      this.playing = new Audio(URL.createObjectURL(clip));
      this.playing.play().catch(() => {});
    });
  }

  // Something more important is said.
  hush() {
    this.playing?.pause();
    this.playing = null;
  }
}
