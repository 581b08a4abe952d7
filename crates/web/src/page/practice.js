// A practice route of ten metres, with the buttons of every route: each step is said when it comes, shown, and said again on request.

const $ = (id) => document.getElementById(id);
const METRES = 10;

// Each step with what ends it; the last is the end of practice.
const STEPS = [
  ['page-practice-camera', (s) => s?.frames > 0],
  ['page-practice-record', (s) => s?.recording],
  ['page-practice-out', (s) => !s?.recording || (s.metric && s.recording.length >= METRES)],
  ['page-practice-stop', (s) => !s?.recording],
  ['page-practice-home', (s) => s?.guiding],
  // Guidance speaks for itself.
  [null, (s) => !s?.guiding],
  ['page-practice-done', () => false],
];

export class Practice {
  // `say` speaks a text, `t` gives the page's sentences.
  constructor({ say, t }) {
    Object.assign(this, { say, t, step: null });
    $('practice').addEventListener('click', () => this.go(0));
    $('practice-again').addEventListener('click', () => this.speak());
    $('practice-end').addEventListener('click', () => this.go(null));
  }

  // The newest status; a step that is done already is left out.
  status(status) {
    $('practice').hidden = this.step !== null || Boolean(status?.recording || status?.guiding);
    if (this.step === null) return;
    let next = this.step;
    while (STEPS[next][1](status)) next += 1;
    if (next !== this.step) this.go(next);
  }

  go(step) {
    this.step = step;
    $('practice-part').hidden = step === null;
    this.speak();
  }

  // Also in another language.
  show() {
    if (this.step !== null && STEPS[this.step][0]) $('practice-words').textContent = this.t(STEPS[this.step][0]);
  }

  speak() {
    this.show();
    if (this.step !== null && STEPS[this.step][0]) this.say($('practice-words').textContent);
  }
}
